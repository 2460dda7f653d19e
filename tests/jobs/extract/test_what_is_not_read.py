"""What an image carries and cannot be used leaves a line, and no file in the way is replaced in silence."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrary.errors import InputError
from calibrary.evidence.context import numbers
from calibrary.evidence.metadata import ImageMetadata
from calibrary.jobs.extract import extract
from calibrary.jobs.extract.cameras import group_cameras
from calibrary.jobs.extract.judging import judge
from calibrary.jobs.extract.knowledge import Knowledge
from calibrary.jobs.extract.outputs import check_place
from calibrary.jobs.images.accumulator import undated
from calibrary.policy import FLEET
from calibrary.validation import Verdict
from tests.imagery import ExifTags, write_jpeg, write_tiff
from tests.jobs.extract.fleet import DEWARP, P4R, gate, only, picture, plan

DTD = b'<!DOCTYPE x [<!ENTITY a "b">]><x:xmpmeta xmlns:x="adobe:ns:meta/"/>'
FULL_WIDTH = str.maketrans("0123456789", "０１２３４５６７８９")


def test_xmp_with_a_document_type_is_told(tmp_path: Path) -> None:
    write_jpeg(tmp_path / "a.jpg", (5472, 3648), exif=ExifTags(**P4R), xmp=DTD)
    outcome = gate(tmp_path)
    [warning] = outcome.warnings
    assert warning.startswith("a.jpg: XMP is not read")
    assert "document type" in warning
    assert only(outcome).verdict is Verdict.VALID


def test_xmp_that_is_too_long_is_told(tmp_path: Path) -> None:
    write_tiff(tmp_path / "a.tif", (5472, 3648), exif=ExifTags(**P4R), xmp=bytes(3 << 20))
    [warning] = gate(tmp_path).warnings
    assert warning.startswith("a.tif: XMP is not read: 3145728 ")
    assert "at most" in warning


def test_nan_in_one_images_calibration_is_told_with_a_count(tmp_path: Path) -> None:
    for name in ("a", "b"):
        picture(tmp_path / f"{name}.jpg", **P4R, dewarp=DEWARP, body_serial="1")
    picture(tmp_path / "c.jpg", **P4R, dewarp=",".join(["nan"] * 9), body_serial="1")
    camera = only(gate(tmp_path)).camera
    [(dropped, count)] = camera.dropped
    assert (dropped.tag, count) == ("drone-dji:DewarpData", 1)


def test_what_an_earlier_run_wrote_among_the_images_changes_nothing(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg", make="FarEye", model="X9", focal_mm=(88, 10), focal_35mm=24)
    first, second = extract(tmp_path, out=tmp_path / "K.npy"), extract(tmp_path, out=tmp_path / "K.npy")
    assert (tmp_path / "K.json").exists()
    assert (second.cameras[0].why, second.warnings) == (first.cameras[0].why, first.warnings)


@pytest.mark.parametrize("text", ["１.５", "1_5", "nan", "inf", "0x10", "1,５"])
def test_only_ascii_numbers_are_numbers(text: str) -> None:
    assert numbers(text) is None


def test_a_calibration_in_full_width_digits_is_none(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg", **P4R, dewarp=DEWARP.translate(FULL_WIDTH))
    camera = only(gate(tmp_path)).camera
    assert [dropped.tag for dropped, _ in camera.dropped] == ["drone-dji:DewarpData"]


def test_a_zoom_that_the_camera_writes_and_does_not_apply_is_left_out() -> None:
    """H20N, 44.5 mm: 196 mm ÷ 43.27 of the diagonal is 3713 px, f ÷ pitch 3708 px, and a zoom of 1.19 beside."""
    frame = ImageMetadata(
        size=(640, 512),
        make="DJI",
        model="ZH20N",
        focal_mm=44.5,
        focal_35mm=196.0,
        digital_zoom=1.19,
        has_exif=True,
    )
    [(key, group)] = group_cameras(undated({frame: ["a.jpg"]}), Knowledge.load(None)).items()
    [camera] = judge(key, group, policy=FLEET)
    assert camera.calibration is not None
    assert camera.calibration.intrinsics.fx == pytest.approx(44.5 / 0.012)
    assert camera.verdict is Verdict.VALID


class TestAFileInTheWay:
    def test_a_link_is_not_replaced(self, tmp_path: Path) -> None:
        (tmp_path / "kept.npy").write_bytes(b"mine")
        (tmp_path / "K_matrix.npy").symlink_to("kept.npy")
        with pytest.raises(InputError, match="is a link"):
            check_place(tmp_path / "K_matrix.npy")

    def test_a_write_protected_file_is_not_replaced(self, tmp_path: Path) -> None:
        (tmp_path / "K_matrix.npy").write_bytes(b"mine")
        (tmp_path / "K_matrix.npy").chmod(0o444)
        with pytest.raises(InputError, match="write-protected"):
            check_place(tmp_path / "K_matrix.npy")

    def test_nor_are_the_files_beside_it(self, tmp_path: Path) -> None:
        picture(tmp_path / "flight" / "a.jpg", **P4R)
        (tmp_path / "K_matrix.json").write_bytes(b"{}")
        (tmp_path / "K_matrix.json").chmod(0o444)
        with pytest.raises(InputError, match="write-protected"):
            plan(gate(tmp_path / "flight"), tmp_path / "K_matrix.npy", None)

    def test_a_file_of_an_earlier_run_is(self, tmp_path: Path) -> None:
        picture(tmp_path / "flight" / "a.jpg", **P4R)
        (tmp_path / "K_matrix.npy").write_bytes(b"old")
        assert (
            tmp_path / "K_matrix.npy"
            in plan(gate(tmp_path / "flight"), tmp_path / "K_matrix.npy", None).outputs.files
        )
