"""Files without an image size: what is known all the same, and a size from the images beside them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from calibrary import parsers
from calibrary.admission import refuse_implausible, why_implausible, why_no_lens
from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.distortion import BrownConrady
from calibrary.errors import InputError, MissingSizeError, ParseError
from calibrary.parsers.unsized import UnsizedCalibration
from calibrary.records import replace
from tests.jobs.extract.fleet import P4R, picture

K = {
    "camera_matrix": [[3660.5, 0, 2731.0], [0, 3655.25, 1823.5], [0, 0, 1]],
    "dist_coeffs": [0.1, 0, 0, 0, 0],
}
BUNDLE = "# Bundle file v0.3\n1 0\n700 0.1 0\n1 0 0\n0 1 0\n0 0 1\n0 0 0\n"


@pytest.fixture
def camera(tmp_path: Path) -> Path:
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(K))
    return path


def test_what_does_not_depend_on_the_size_is_known(camera: Path) -> None:
    [found] = parsers.read_unsized(camera)
    assert isinstance(found, UnsizedCalibration)
    assert found.camera.image_size is None
    numbers = found.intrinsics
    assert (numbers.fx, numbers.fy, numbers.cx, numbers.cy) == (3660.5, 3655.25, 2731.5, 1824.0)
    assert found.distortion is not None
    assert "--image-size" in found.notes[-1]


def test_what_depends_on_the_size_is_left_open_and_named(tmp_path: Path) -> None:
    path = tmp_path / "bundle.out"
    path.write_text(BUNDLE)
    [found] = parsers.read_unsized(path)
    assert isinstance(found, UnsizedCalibration)
    assert (found.intrinsics.fx, found.intrinsics.cx, found.intrinsics.cy) == (700.0, None, None)
    assert "cx, cy depend on the image size" in found.notes
    with pytest.raises(MissingSizeError, match="the size cannot come from it"):
        parsers.read(path, size_from_centre=True)


def test_a_size_from_the_centre_is_an_assumption_that_is_told(camera: Path) -> None:
    [found] = parsers.read(camera, size_from_centre=True)
    assert found.intrinsics.image_size == (5463, 3648)
    assert "twice the principal point" in found.notes[-1]
    assert found.provenance.assumptions[-1] == found.notes[-1]
    assert parsers.decode(camera.read_bytes(), name="camera.json", size_from_centre=True)[0] == found


def test_the_images_beside_a_file_tell_its_size_where_they_agree(camera: Path) -> None:
    with pytest.raises(MissingSizeError, match="--image-size"):
        parsers.read(camera)
    picture(camera.with_name("a.jpg"), **P4R)
    picture(camera.with_name("b.jpg"), **P4R)
    [found] = parsers.read(camera)
    assert found.intrinsics.image_size == (5472, 3648)
    assert "that of a.jpg and 1 more images beside the file" in found.notes[-1]
    assert found.provenance.assumptions[-1] == found.notes[-1]
    assert parsers.read(camera, image_size=(5474, 3650))[0].intrinsics.image_size == (5474, 3650)
    picture(camera.with_name("c.jpg"), **{**P4R, "size": (4000, 3000)})
    with pytest.raises(MissingSizeError):
        parsers.read(camera)


def test_images_that_the_principal_point_does_not_fit_tell_nothing(tmp_path: Path) -> None:
    path = tmp_path / "camera.json"
    path.write_text(json.dumps({**K, "camera_matrix": [[900, 0, 640], [0, 900, 360], [0, 0, 1]]}))
    picture(tmp_path / "a.jpg", **P4R)
    with pytest.raises(MissingSizeError):
        parsers.read(path)


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        ({"fx": 35.7, "fy": 35.7}, "perhaps mm"),
        ({"fx": 4.95}, "perhaps mm"),
        ({"fx": 5e6, "fy": 5e6}, "image sides"),
        ({"fx": 9000.0}, "differ"),
        ({"cx": 0.5, "cy": 0.49}, "corner"),
        ({"cx": 5e4}, "outside"),
        ({}, None),
        ({"fx": 170.0, "fy": 170.0}, None),
        ({"cx": -300.0, "cy": 2.0}, None),
    ],
)
def test_numbers_that_are_no_cameras_are_told(numbers: dict[str, float], said: str | None) -> None:
    K = {"fx": 1200.0, "fy": 1200.0, "cx": 750.0, "cy": 500.0, **numbers}
    reason = why_implausible(Intrinsics(**K, image_size=(1500, 1000)))
    assert (reason is None) if said is None else (reason is not None and said in reason)


def test_a_distortion_that_is_of_no_lens_says_that_its_order_is_perhaps_another(tmp_path: Path) -> None:
    """Nine numbers that are width, height, f, cx, cy, k1, …, and are read as fx, fy, cx, cy, k1, and so on."""
    (tmp_path / "nine.txt").write_text("4000 3000 2914.65 1978.25 1513.0 -0.03 0.01 0 0\n")
    [camera] = parsers.read(tmp_path / "nine.txt", format="droid_calib", image_size=(4000, 3000))
    assert (camera.intrinsics.fx, camera.distortion.coefficients["k1"]) == (4000.0, 1513.0)  # type: ignore[union-attr]
    reason = why_no_lens(camera)
    assert reason is not None
    assert "in another order or unit" in reason
    with pytest.raises(InputError, match="is that of no lens"):
        refuse_implausible([camera], "nine.txt")


def test_nine_bare_numbers_of_another_order_are_refused_unless_the_format_is_named(tmp_path: Path) -> None:
    (tmp_path / "nine.txt").write_text("4000 3000 2914.65 1978.25 1513.0 -0.03 0.01 0 0\n")
    with pytest.raises(
        ParseError, match=r"nothing in the file says that it is DROID-SLAM.*--format droid_calib"
    ):
        parsers.read(tmp_path / "nine.txt", image_size=(4000, 3000))
    (tmp_path / "nine.txt").write_text("2914.65 2914.65 1978.25 1513.0 -0.03 0.01 0.0001 0.0002 0\n")
    [camera] = parsers.read(tmp_path / "nine.txt", image_size=(4000, 3000))
    assert camera.intrinsics.fx == 2914.65


@pytest.mark.parametrize("k1", [-0.6, -0.3, 0.0, 0.3, 1.0])
def test_the_distortion_of_real_lenses_is_taken(k1: float) -> None:
    """A GoPro's k1 is about -0.3 with f = 0.45 W; a converter's is twice that."""
    assert why_no_lens(barrelled(k1)) is None


@pytest.mark.parametrize("k1", [-8.0, 60.0, 1513.0])
def test_a_distortion_that_folds_or_throws_the_image_is_of_no_lens(k1: float) -> None:
    assert why_no_lens(barrelled(k1)) is not None


@pytest.mark.parametrize(
    "order",
    [
        ("k1", "k2", "k3", "p1", "p2"),  # Metashape's and Pix4D's
        ("p1", "p2", "k1", "k2", "k3"),
        ("k3", "k2", "k1", "p1", "p2"),  # DBAT's
        ("k1", "p1", "p2", "k2", "k3"),
    ],
)
def test_a_sheet_in_another_order_is_of_no_lens(order: tuple[str, ...]) -> None:
    """An action camera's five numbers, read as OpenCV's k1 k2 p1 p2 k3."""
    lens = {"k1": -0.281, "k2": 0.124, "k3": -0.0412, "p1": 0.0004, "p2": -0.0011}
    read = dict(zip(("k1", "k2", "p1", "p2", "k3"), (lens[name] for name in order), strict=True))
    right, wrong = (replace(barrelled(0.0), distortion=BrownConrady(**terms)) for terms in (lens, read))
    assert why_no_lens(right) is None
    reason = why_no_lens(wrong)
    assert reason is not None
    assert "in another order" in reason


@pytest.mark.parametrize(
    "lens",
    [
        {"k1": -0.28, "k2": 0.07, "p1": 0.0, "p2": 0.0002, "k3": 1.8e-05},  # k1 k2 k3 p1 p2 without a k3
        {"k1": -0.28, "k2": 0.07, "p1": -0.01, "p2": 0.0, "k3": 0.0},  # the same without p1 and p2
    ],
)
def test_a_zero_that_only_another_order_leaves_is_of_no_lens(lens: dict[str, float]) -> None:
    reason = why_no_lens(replace(barrelled(0.0), distortion=BrownConrady(**lens)))
    assert reason is not None
    assert "in another order" in reason


@pytest.mark.parametrize("k3", [-0.21, 0.0])
def test_large_tangential_terms_below_a_larger_k3_or_without_one_are_of_a_lens(k3: float) -> None:
    """What a board gives where the principal point was fixed to the middle."""
    lens = BrownConrady(k1=-0.04, k2=0.12, p1=0.006, p2=0.02, k3=k3)
    assert why_no_lens(replace(barrelled(0.0), distortion=lens)) is None
    assert why_no_lens(replace(barrelled(0.0), distortion=replace(lens, p2=0.2))) is not None


def barrelled(k1: float) -> Calibration:
    size = (4000, 3000)
    return Calibration(
        camera=CameraKey(image_size=size),
        intrinsics=Intrinsics(fx=2000.0, fy=2000.0, cx=2000.0, cy=1500.0, image_size=size),
        distortion=BrownConrady(k1=k1, k2=0.0, p1=0.0, p2=0.0, k3=0.0),
        grade=Grade.CALIBRATED,
        provenance=Provenance(kind="test"),
    )
