"""``undistort``: pictures from the command line, the K beside them, and nothing overwritten."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from calibrary import parsers
from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.cli.main import main
from calibrary.distortion import KannalaBrandt, NoDistortion
from calibrary.jobs.undistort import run as undistorting
from calibrary.parsers import files
from calibrary.records import replace
from calibrary.schemas import require
from tests.jobs.extract.fleet import DEWARP, P4R, picture

BROWN = (-0.21, 0.05, 0.002, -0.0015, -0.004)
K = np.array([[140.0, 0, 121.0], [0, 141.0, 78.5], [0, 0, 1]])


@pytest.fixture
def camera(tmp_path: Path) -> Path:
    """A 240×160 camera, written as OpenCV would."""
    path = tmp_path / "camera.json"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 240)
    storage.write("image_height", 160)
    storage.write("camera_matrix", K)
    storage.write("distortion_coefficients", np.array([BROWN]))
    storage.release()
    return path


def pixels(size: tuple[int, int] = (240, 160)) -> NDArray[np.uint8]:
    grain = np.random.default_rng(2).random((size[1], size[0], 3)).astype(np.float32)
    smooth = cv2.GaussianBlur(grain, (0, 0), 3)
    image: NDArray[np.uint8] = ((smooth - smooth.min()) / np.ptp(smooth) * 255).astype(np.uint8)
    return image


def shown(path: Path) -> NDArray[Any]:
    read = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert read is not None
    return np.asarray(read)


@pytest.fixture
def image(tmp_path: Path) -> Path:
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), pixels())
    return path


def run(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> tuple[int, str, str]:
    code = main(["undistort", *(str(argument) for argument in arguments)])
    said = capsys.readouterr()
    return code, said.out, said.err


def test_the_picture_is_opencvs_and_the_k_beside_it_has_no_distortion(
    image: Path, camera: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = image.parent / "out"
    arguments = (image, "--calibration", camera, "--out", out, "--interpolation", "linear", "--mask")
    code, text, _ = run(capsys, *arguments)
    assert code == 0
    assert "undistorted 1 of 1 images" in text
    ours = shown(out / "a.png").astype(int)
    theirs = cv2.undistort(pixels(), K, np.array(BROWN)).astype(int)
    seen = cv2.erode(shown(out / "camera.mask.png"), np.ones((5, 5), np.uint8)) > 0
    assert np.abs(ours - theirs)[seen].max() <= 1
    [written] = parsers.read(out / "camera.yml")
    assert isinstance(written.distortion, NoDistortion)
    assert np.allclose(written.intrinsics.matrix[:2, 2] - 0.5, K[:2, 2], atol=1e-12)


def test_a_picture_between_valid_and_all(
    image: Path, camera: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    focal = {}
    for name, flags in {
        "all": ["--keep", "all"],
        "half": ["--keep", "0.5"],
        "valid": ["--keep", "valid"],
    }.items():
        out = image.parent / name
        assert run(capsys, image, "--calibration", camera, "--out", out, *flags)[0] == 0
        focal[name] = parsers.read(out / "camera.yml")[0].intrinsics.fx
    assert focal["half"] == pytest.approx((focal["all"] + focal["valid"]) / 2)
    assert shown(image.parent / "valid/a.png").any(axis=2).all()
    assert not shown(image.parent / "all/a.png")[0, 0].any()


def test_the_size_follows_the_focal_length(
    image: Path, camera: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = image.parent / "out"
    flags = ("--keep", "all", "--size", "same-focal")
    assert run(capsys, image, "--calibration", camera, "--out", out, *flags)[0] == 0
    made = parsers.read(out / "camera.yml")[0].intrinsics
    assert (made.fx, made.fy) == (140.0, 141.0)
    assert shown(out / "a.png").shape[1::-1] == made.image_size
    assert made.image_size > (240, 160)


def test_what_was_done_matches_its_schema(
    image: Path, camera: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = image.with_name("b.png")
    broken.write_bytes(b"no picture")
    out = image.parent / "out"
    code, text, _ = run(capsys, "--json", image, broken, "--calibration", camera, "--out", out)
    document = json.loads(text)
    require(document, "undistort-1")
    assert code == 3
    assert [one["output"] for one in document["images"]] == ["a.png", None]
    assert "b.png" in document["images"][1]["error"]
    assert document["cameras"][0]["calibration"]["distortion"] == {"model": "none"}


def test_folders_keep_their_shape(camera: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    flight = tmp_path / "flight"
    for name in ("day1/a.png", "day2/a.png"):
        (flight / name).parent.mkdir(parents=True)
        cv2.imwrite(str(flight / name), pixels())
    out = flight / "undistorted"
    for force in ([], ["--force"]):
        assert run(capsys, flight, "--calibration", camera, "--out", out, *force)[0] == 0
    written = sorted(path.relative_to(out).as_posix() for path in out.rglob("*.*"))
    assert written == ["camera.yml", "day1/a.png", "day2/a.png"]


def test_the_new_k_is_written_in_the_format_asked_for(
    image: Path, camera: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = image.parent / "out"
    assert run(capsys, image, "--calibration", camera, "--out", out, "--to", "colmap_text")[0] == 0
    assert " 240 160 140.0 141.0 121.5 79.0" in (out / "camera.txt").read_text()


def test_another_kind_of_file_is_written_where_asked_for(
    image: Path, camera: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = image.parent / "out"
    assert (
        run(capsys, image, "--calibration", camera, "--out", out, "--kind", "jpg", "--quality", "80")[0] == 0
    )
    assert (out / "a.jpg").read_bytes().startswith(b"\xff\xd8")


def test_an_image_of_the_same_shape_is_a_scaled_one_and_that_is_said(
    camera: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cv2.imwrite(str(tmp_path / "half.png"), pixels((120, 80)))
    cv2.imwrite(str(tmp_path / "full.png"), pixels())
    out = tmp_path / "out"
    images = (tmp_path / "full.png", tmp_path / "half.png")
    _, text, _ = run(capsys, *images, "--calibration", camera, "--out", out)
    assert "the calibration is of 240×160 px; it was scaled to 120×80" in text
    assert parsers.read(out / "camera-120x80.yml")[0].intrinsics.fx == 70.0
    assert parsers.read(out / "camera.yml")[0].intrinsics.fx == 140.0


def test_an_image_of_another_shape_is_refused_and_the_others_are_made(
    image: Path, camera: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cv2.imwrite(str(image.with_name("turned.png")), pixels((160, 240)))
    out = image.parent / "out"
    code, text, _ = run(capsys, image.with_name("turned.png"), image, "--calibration", camera, "--out", out)
    assert code == 3
    assert "turned.png" in text
    assert "cannot be scaled to 160×240" in text
    assert sorted(path.name for path in out.iterdir()) == ["a.png", "camera.yml"]


def test_what_is_there_is_replaced_only_by_force(
    image: Path, camera: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = image.parent / "out"
    out.mkdir()
    (out / "a.png").write_text("precious")
    code, _, err = run(capsys, image, "--calibration", camera, "--out", out)
    assert code == 3
    assert "is there already; --force replaces it" in err
    assert (out / "a.png").read_text() == "precious"
    assert not (out / "camera.yml").exists()
    assert run(capsys, image, "--calibration", camera, "--out", out, "--force")[0] == 0
    assert (out / "a.png").read_bytes() != b"precious"


def test_an_image_is_never_overwritten_by_its_own_picture(
    image: Path, camera: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = image.read_bytes()
    code, _, err = run(capsys, image, "--calibration", camera, "--out", image.parent, "--force")
    assert code == 3
    assert "would overwrite an image" in err
    assert image.read_bytes() == before


def test_the_calibration_is_never_overwritten(
    image: Path, camera: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    precious = image.with_name("camera.yml")
    parsers.write(parsers.read(camera), precious, "opencv_storage")
    before = precious.read_bytes()
    elsewhere = image.parent / "images/a.png"
    elsewhere.parent.mkdir()
    image.rename(elsewhere)
    code, _, err = run(capsys, elsewhere, "--calibration", precious, "--out", precious.parent, "--force")
    assert code == 3
    assert "would overwrite the calibration" in err
    assert precious.read_bytes() == before


def test_two_images_of_one_name_do_not_share_a_picture(
    camera: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for folder in ("one", "two"):
        (tmp_path / folder).mkdir()
        cv2.imwrite(str(tmp_path / folder / "a.png"), pixels())
    code, _, err = run(
        capsys, tmp_path / "one", tmp_path / "two", "--calibration", camera, "--out", tmp_path / "out"
    )
    assert code == 3
    assert "would be written there" in err
    assert not (tmp_path / "out").exists()


def test_exif_stays_with_a_jpeg(camera: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    exif = Image.Exif()
    exif[0x0110], exif[0x0112] = "FC6310R", 6
    Image.fromarray(pixels()).save(tmp_path / "a.jpg", exif=exif)
    out = tmp_path / "out"
    assert run(capsys, tmp_path / "a.jpg", "--calibration", camera, "--out", out)[0] == 0
    with Image.open(out / "a.jpg") as made:
        assert made.size == (240, 160)
        assert (made.getexif()[0x0110], made.getexif()[0x0112]) == ("FC6310R", 6)


@pytest.mark.parametrize(("keep", "stays"), [("same", True), ("all", False)])
def test_tags_of_the_focal_length_stay_where_it_does(
    camera: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], keep: str, stays: bool
) -> None:
    image = picture(tmp_path / "a.jpg", (240, 160), **P4R)
    out = tmp_path / "out"
    assert run(capsys, image, "--calibration", camera, "--out", out, "--keep", keep)[0] == 0
    with Image.open(out / "a.jpg") as made:
        assert (0x920A in made.getexif().get_ifd(0x8769)) is stays


def test_a_picture_the_camera_has_undistorted_itself_is_doubted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tags: dict[str, Any] = {**P4R, "drone_dji:DewarpFlag": "1"}
    corrected = picture(tmp_path / "a.jpg", dewarp=DEWARP, **tags)
    lens = tmp_path / "lens.xml"
    lens.write_text(
        "<calibration><projection>frame</projection><width>5472</width><height>3648</height>"
        "<f>3660</f><k1>-0.1</k1></calibration>"
    )
    flags = ("--size", "547x365", "--keep", "all", "--out", tmp_path / "out")
    _, text, _ = run(capsys, corrected, "--calibration", lens, *flags)
    assert "has undistorted this picture itself" in text


def test_unknown_distortion_is_refused_with_a_hint_before_any_image_is_read(
    image: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lens = image.with_name("K.npy")
    np.save(lens, K)
    flags = ("--image-size", "240x160", "--out", image.parent / "out")
    code, text, err = run(capsys, image, "--calibration", lens, *flags)
    assert (code, text) == (3, "")
    assert "is unknown, so it cannot be removed; expected a calibration that states its distortion" in err
    assert not (image.parent / "out").exists()


def test_a_format_that_is_not_written_is_refused_before_any_image_is_read(
    image: Path, camera: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = image.parent / "out"
    code, _, err = run(capsys, image, "--calibration", camera, "--out", out, "--to", "basalt")
    assert code == 3
    assert "basalt is read but not written" in err
    assert not out.exists()


def test_a_guess_is_no_calibration(
    image: Path, camera: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    [known] = parsers.read(camera)
    monkeypatch.setattr(parsers, "read", lambda *_, **__: [replace(known, grade=Grade.PRIOR)])
    code, _, err = run(capsys, image, "--calibration", camera, "--out", image.parent / "out")
    assert code == 3
    assert "is a prior, a guess" in err


def test_what_an_interruption_left_is_said(
    image: Path, camera: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    second = image.with_name("b.png")
    second.write_bytes(image.read_bytes())
    reading = files.read_regular_file

    def interrupted(path: Path, **limits: int) -> bytes:
        if path == second:
            raise KeyboardInterrupt
        return reading(path, **limits)

    monkeypatch.setattr(undistorting, "read_regular_file", interrupted)
    code, _, err = run(capsys, image, second, "--calibration", camera, "--out", image.parent / "out")
    assert code == 130
    assert "1 of 2 images were undistorted" in err


def test_of_several_cameras_one_must_be_chosen(image: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rig = image.with_name("cameras.txt")
    rig.write_text("1 SIMPLE_RADIAL 240 160 140 120 80 -0.1\n2 SIMPLE_RADIAL 240 160 150 120 80 -0.1\n")
    out = image.parent / "out"
    code, _, err = run(capsys, image, "--calibration", rig, "--out", out)
    assert code == 3
    assert "holds 2 cameras" in err
    assert run(capsys, image, "--calibration", rig, "--out", out, "--camera", "2")[0] == 0
    assert parsers.read(out / "camera.yml")[0].intrinsics.fx == 150
    assert run(capsys, image, "--calibration", rig, "--out", out, "--camera", "3")[0] == 3


@pytest.mark.parametrize(
    "flags",
    [
        ["--keep", "2"],
        ["--keep", "most"],
        ["--quality", "0"],
        ["--size", "big"],
    ],
)
def test_a_wish_that_makes_no_sense_is_a_usage_error(flags: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["undistort", "a.png", "--calibration", "c.yml", *flags])
    assert ended.value.code == 2


@pytest.fixture
def wide(tmp_path: Path) -> tuple[Path, ...]:
    """An image of a fisheye, and its calibration."""
    K = Intrinsics(fx=60.0, fy=60.0, cx=120.0, cy=80.0, image_size=(240, 160))
    lens = KannalaBrandt(k1=0.01, k2=0.0, k3=0.0, k4=0.0)
    key, made = CameraKey(image_size=(240, 160)), Provenance(kind="test")
    known = Calibration(camera=key, intrinsics=K, distortion=lens, grade=Grade.CALIBRATED, provenance=made)
    parsers.write([known], tmp_path / "wide.yml", "opencv_storage")
    cv2.imwrite(str(tmp_path / "a.png"), pixels())
    return tmp_path / "a.png", Path("--calibration"), tmp_path / "wide.yml"


def kept(text: str) -> float:
    """How much of the images the last line of a camera says is kept, in per cent."""
    return float(text.split(" px images: ")[1].partition("%")[0])


def test_a_wide_lens_gets_the_view_that_saves_most_of_its_images(
    wide: tuple[Path, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, text, _ = run(capsys, *wide, "--out", tmp_path / "auto")
    printed = " ".join(text.split())
    assert code == 0
    assert "with its own K (fx 60.0) only" in printed
    assert "--keep same keeps K" in printed
    _, same, _ = run(capsys, *wide, "--out", tmp_path / "same", "--keep", "same")
    assert kept(same) < 80
    assert kept(text) > kept(same) + 10
    assert parsers.read(tmp_path / "auto" / "camera.yml")[0].intrinsics.fx < 60
    assert parsers.read(tmp_path / "same" / "camera.yml")[0].intrinsics.fx == 60


def test_what_is_lost_by_keeping_k_is_told_with_what_would_keep_it(
    wide: tuple[Path, ...], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, text, _ = run(capsys, *wide, "--out", tmp_path / "same", "--keep", "same")
    printed = " ".join(text.split())
    assert "K stays as it is, so only" in printed
    assert "--keep all keeps" in printed
    _, text, _ = run(capsys, *wide, "--out", tmp_path / "all", "--keep", "all")
    assert "K stays as it is" not in " ".join(text.split())


def test_a_lens_that_loses_little_keeps_its_k(
    image: Path, camera: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, text, _ = run(capsys, image, "--calibration", camera, "--out", image.parent / "out")
    assert "widened" not in text
    before, after = parsers.read(camera)[0], parsers.read(image.parent / "out" / "camera.yml")[0]
    assert (after.intrinsics.fx, after.intrinsics.cx) == (before.intrinsics.fx, before.intrinsics.cx)
