"""Which frames belong to one shot: by folders, by the names payloads give, by a pattern; and no guesses."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrary.errors import InputError
from calibrary.jobs.calibrate.pairing import RigFrames, find_rig


def rig(tmp_path: Path, *names: str) -> Path:
    for name in names:
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    return tmp_path


def printed(found: RigFrames) -> dict[str, dict[str, str]]:
    return {shot: {name: path.name for name, path in frames.items()} for shot, frames in found.shots.items()}


def test_folders_whose_frames_have_the_same_names(tmp_path: Path) -> None:
    root = rig(tmp_path, "a/01.png", "a/02.png", "a/03.png", "b/02.png", "b/03.png", "b/04.png")
    found = find_rig([root / "a", root / "b"])
    assert found.cameras == ("a", "b")
    assert printed(found) == {
        "01": {"a": "01.png"},
        "02": {"a": "02.png", "b": "02.png"},
        "03": {"a": "03.png", "b": "03.png"},
        "04": {"b": "04.png"},
    }


def test_folders_whose_frames_have_the_cameras_name_in_theirs(tmp_path: Path) -> None:
    root = rig(tmp_path, "left/left01.jpg", "left/left02.jpg", "right/right01.jpg", "right/right02.jpg")
    found = find_rig([root / "left", root / "right"])
    assert printed(found)["01"] == {"left": "left01.jpg", "right": "right01.jpg"}


def test_folders_whose_frames_are_numbered_the_same(tmp_path: Path) -> None:
    root = rig(tmp_path, "a/DSC_0007.png", "a/DSC_0008.png", "b/IMG7.png", "b/IMG8.png")
    found = find_rig([root / "a", root / "b"])
    assert printed(found)["8"] == {"a": "DSC_0008.png", "b": "IMG8.png"}


def test_folders_whose_names_do_not_tell_are_paired_in_order_only_when_asked(tmp_path: Path) -> None:
    root = rig(tmp_path, "a/101.png", "a/102.png", "b/7.png", "b/8.png")
    folders = [root / "a", root / "b"]
    with pytest.raises(InputError, match="--in-order"):
        find_rig(folders)
    assert printed(find_rig(folders, in_order=True))["0002"] == {"a": "102.png", "b": "8.png"}
    rig(tmp_path, "b/9.png")
    with pytest.raises(InputError, match="2 of a, 3 of b"):
        find_rig(folders, in_order=True)


def test_a_micasense_set_in_its_folders(tmp_path: Path) -> None:
    root = rig(
        tmp_path,
        *(
            f"SET/{folder}/IMG_{n:04}_{band}.tif"
            for folder in ("000", "001")
            for n in (0, 1)
            for band in range(1, 6)
        ),
    )
    found = find_rig([root / "SET"], reference="5")
    assert found.cameras == ("5", "1", "2", "3", "4")
    assert len(found.shots) == 4
    assert all(len(frames) == 5 for frames in found.shots.values())
    assert "MicaSense" in found.how


def test_a_phantom_4_multispectral(tmp_path: Path) -> None:
    names = [f"DJI_00{n}0.JPG" for n in (1, 2)] + [
        f"DJI_00{n}{band}.TIF" for n in (1, 2) for band in range(1, 6)
    ]
    found = find_rig([rig(tmp_path, *names)])
    assert set(found.cameras) == {"RGB", "Blue", "Green", "Red", "RedEdge", "NIR"}
    assert printed(found)["DJI_2"]["NIR"] == "DJI_0025.TIF"


def test_a_mavic_3_multispectral(tmp_path: Path) -> None:
    names = [
        f"DJI_20230701103012_{n:04}_{end}"
        for n in (1, 2)
        for end in ("D.JPG", "MS_G.TIF", "MS_R.TIF", "MS_RE.TIF", "MS_NIR.TIF")
    ]
    found = find_rig([rig(tmp_path, *names)])
    assert set(found.cameras) == {"D", "MS_G", "MS_R", "MS_RE", "MS_NIR"}
    assert len(found.shots) == 2


def test_left_and_right_in_one_folder(tmp_path: Path) -> None:
    root = rig(tmp_path, "left01.jpg", "left02.jpg", "right01.jpg", "right02.jpg", "stereo_calib.xml")
    found = find_rig([root])
    assert found.cameras == ("left", "right")
    assert printed(found)["02"] == {"left": "left02.jpg", "right": "right02.jpg"}


def test_a_pattern_of_the_users_own(tmp_path: Path) -> None:
    root = rig(tmp_path, "x-7-top.png", "x-7-low.png", "x-8-top.png", "x-8-low.png", "readme.png")
    found = find_rig([root], pattern="*-{shot}-{camera}.png")
    assert printed(found) == {s: {c: f"x-{s}-{c}.png" for c in ("low", "top")} for s in ("7", "8")}
    assert found.notes == ("1 files do not fit the pattern and were not read",)
    folders = rig(tmp_path / "deep", "top/7.png", "low/7.png")
    assert printed(find_rig([folders], pattern="{camera}/{shot}.png"))["7"] == {
        "low": "7.png",
        "top": "7.png",
    }


@pytest.mark.parametrize(
    ("pattern", "match"),
    [
        ("{camera}.png", "0 times {shot}"),
        ("{camera}_{shot}_{shot}.png", "2 times"),
        ("q{camera}_{shot}.png", "no name"),
    ],
)
def test_a_pattern_that_is_none(pattern: str, match: str, tmp_path: Path) -> None:
    root = rig(tmp_path, "a_1.png", "b_1.png")
    with pytest.raises(InputError, match=match):
        find_rig([root], pattern=pattern)


def test_names_that_say_nothing(tmp_path: Path) -> None:
    root = rig(tmp_path, "DSC1.png", "DSC2.png")
    with pytest.raises(InputError, match="do not say camera and shot"):
        find_rig([root])


def test_two_frames_of_one_camera_in_one_shot(tmp_path: Path) -> None:
    root = rig(tmp_path, "000/a_1.png", "001/a_1.png", "000/b_1.png")
    with pytest.raises(InputError, match="two frames of camera a in shot 1"):
        find_rig([root], pattern="{camera}_{shot}.png")


def test_a_reference_that_is_not_there(tmp_path: Path) -> None:
    root = rig(tmp_path, "left1.png", "right1.png")
    with pytest.raises(InputError, match="no camera 'middle' among left, right"):
        find_rig([root], reference="middle")
