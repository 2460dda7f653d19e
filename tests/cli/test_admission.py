"""A K that is hardly a camera's is told in the same words by every command that a file enters by."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibrary.admission import admission
from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.cli.main import main
from calibrary.distortion import BrownConrady
from calibrary.parsers import write
from calibrary.registry.init import init
from tests.jobs.extract.fleet import picture
from tests.thorough import every

LENS = BrownConrady(k1=-0.1, k2=0.02, p1=0.0005, p2=-0.0004)
FORMATS = {
    "opencv_storage": "a.yml",
    "ros_camera_info": "a.yaml",
    "colmap_text": "a.txt",
    "transforms_json": "a.json",
    "numpy_npz": "a.npz",
    "keyed_text": "a.txt",
    "kalibr": "a.yaml",
    "ros_ini": "a.ini",
}
"""A file's name by its format."""


def camera(
    fx: float = 800.0,
    fy: float = 801.0,
    cx: float = 640.0,
    cy: float = 360.0,
    size: tuple[int, int] = (1280, 720),
    lens: BrownConrady = LENS,
) -> Calibration:
    return Calibration(
        camera=CameraKey(make="Example", model="One"),
        intrinsics=Intrinsics(fx=fx, fy=fy, cx=cx, cy=cy, image_size=size),
        distortion=lens,
        grade=Grade.CALIBRATED,
        provenance=Provenance(kind="calibration-file"),
    )


UNLIKELY = {
    "centre outside": (
        camera(cx=956.0, cy=542.0, size=(400, 300)),
        "the principal point (956, 542) lies outside 400×300; it fits 1912×1084",
    ),
    "sides exchanged": (
        camera(size=(720, 1280)),
        "lies 39% of a side from the middle of 720×1280; it fits 1280×720: the sides are exchanged",
    ),
    "fx and fy apart": (camera(820.0, 310.0), "fx and fy differ by 62.20%"),
    "another order": (camera(800.0, 640.0, 801.0, 360.0), "its numbers fit as fx, cx, fy, cy"),
    "from the middle": (camera(cx=12.0, cy=-9.0), "the principal point is counted from the middle"),
    "a lens that folds": (
        camera(lens=BrownConrady(k1=-0.55, k2=0.0, p1=0.0, p2=0.0)),
        "the distortion folds the image back",
    ),
    "a field of view": (
        camera(200.0, 200.0, lens=BrownConrady(k1=0.0, k2=0.0, p1=0.0, p2=0.0)),
        "field of view of 145°",
    ),
}

OF_LENS = {"a lens that folds", "a field of view"}
"""Those that a matrix alone cannot show."""


@pytest.mark.parametrize("name", UNLIKELY)
def test_what_is_unlikely_is_told_with_the_reading_that_makes_a_camera(name: str) -> None:
    K, told = UNLIKELY[name]
    found = admission(K)
    assert found is not None
    assert told in found.message


@pytest.mark.parametrize(
    "K",
    [
        camera(),
        camera(cx=560.0),
        camera(1011.4, 1008.5, 645.5, 508.8),
        camera(1800.0, 1800.0, 640.0, 715.0),
        camera(
            534.25,
            534.06,
            640.07,
            368.5,
            lens=BrownConrady(k1=-0.0592, k2=0.0358, p1=0.0, p2=0.0, k3=-0.01446),
        ),
        camera(fy=820.0),
        camera(size=(720, 1280), cx=360.0, cy=640.0),
        camera(20_000.0, 20_000.0),
    ],
    ids=[
        "usual",
        "a crop",
        "a crop of 4:3",
        "a projector",
        "a fold at the corners",
        "hardly oblong",
        "upright",
        "telephoto",
    ],
)
def test_a_camera_is_admitted(K: Calibration) -> None:
    assert admission(K) is None


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A registry, which stays empty because every entry is refused."""
    place = tmp_path_factory.mktemp("registry") / "fleet"
    init(place)
    return place


READ_OTHERWISE = {
    ("sides exchanged", "numpy_npz"),
    ("from the middle", "numpy_npz"),
    ("from the middle", "opencv_storage"),
}
"""What the reader of hand-made files settles before there is a K: exchanged sides, with a note, or by a question."""


def tells(printed: str, told: str) -> bool:
    words = " ".join(printed.split())
    return told in words or (
        "principal point" in words and told == "the principal point is counted from the middle"
    )


@pytest.mark.parametrize(
    ("name", "K", "told"),
    # Every K and every format is one of a few, too.
    every(
        4,
        (
            pytest.param(name, K, told.rpartition("; ")[2], id=f"{which}-{name}")
            for name in FORMATS
            for which, (K, told) in UNLIKELY.items()
            if (which, name) not in READ_OTHERWISE
        ),
    ),
)
def test_every_command_tells_it_and_its_exit_code_is_not_0(
    name: str,
    K: Calibration,
    told: str,
    fleet: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "400")
    file = tmp_path / FORMATS[name]
    write([K], file, name, max_error_px=1e9)
    (tmp_path / "im").mkdir()
    picture(tmp_path / "im" / "a.jpg", K.intrinsics.image_size, make="Example", model="One")
    for command in (
        ["inspect", str(file)],
        ["convert", str(file), "out.yml", "--to", "opencv"],
        ["check", "im", str(file)],
        ["diff", str(file), str(file)],
        [
            "registry",
            "add",
            str(file),
            "--make",
            "Example",
            "--model",
            "One",
            "--registry",
            str(fleet),
            "--yes",
        ],
    ):
        assert main(command) != 0, command
        said = capsys.readouterr()
        assert tells(f"{said.out} {said.err}", told), (command, said)


def test_an_unlikely_k_is_converted_and_force_says_that_it_is_meant(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "a.yaml"
    write([UNLIKELY["sides exchanged"][0]], file, "ros_camera_info")
    assert main(["convert", str(file), str(tmp_path / "b.yml"), "--to", "opencv"]) == 1
    assert "of a K that is unlikely: the principal point" in " ".join(capsys.readouterr().out.split())
    assert main(["convert", str(file), str(tmp_path / "c.yml"), "--to", "opencv", "--force"]) == 0


@pytest.mark.parametrize("name", [name for name in UNLIKELY if name not in {*OF_LENS, "from the middle"}])
def test_extract_refuses_a_fallback_in_the_same_words(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    K, told = UNLIKELY[name]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "400")
    picture(tmp_path / "a.jpg", K.intrinsics.image_size, make="Example", model="One")
    np.save("K.npy", K.intrinsics.matrix)
    assert (
        main(["extract", ".", "--fallback-k", "K.npy", "--output-matrix", "out.npy", "--registry", "none"])
        == 1
    )
    said = capsys.readouterr()
    assert tells(f"{said.out} {said.err}", told)
    assert not Path("out.npy").exists()


@pytest.mark.parametrize("command", [["extract", "im"], ["onboard", "im", "--for", "model", "--yes"]])
def test_a_file_of_exchanged_sides_beside_the_images_is_told_of(
    command: list[str],
    fleet: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    K, told = UNLIKELY["sides exchanged"]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "400")
    picture(tmp_path / "im" / "a.jpg", (1280, 720), make="Example", model="One")
    write([K], tmp_path / "im" / "a.yaml", "ros_camera_info")
    assert main([*command, "--registry", str(fleet)]) == 1
    said = capsys.readouterr()
    assert tells(f"{said.out} {said.err}", told)


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("centre outside", camera(cx=956.0, cy=542.0, size=(1912, 1084))),
        ("sides exchanged", camera(size=(1280, 720))),
        ("another order", camera(800.0, 801.0, 640.0, 360.0)),
        ("from the middle", camera(cx=652.0, cy=351.0)),
    ],
)
def test_the_reading_that_is_named_is_admitted(name: str, meant: Calibration) -> None:
    assert admission(UNLIKELY[name][0]) is not None
    assert admission(meant) is None


def test_what_no_camera_has_is_converted_by_the_force_that_is_advised(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "a.yaml"
    write([camera(8.8, 8.8)], file, "ros_camera_info", max_error_px=1e9)
    convert = ["convert", str(file), str(tmp_path / "b.yml"), "--to", "opencv"]
    assert main(convert) == 3
    assert "give --force to take it all the same" in " ".join(capsys.readouterr().err.split())
    assert main([*convert, "--force"]) == 0
