"""Images that are no originals, in a flight and in files: what is visible of a manipulation is never valid."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from calibrary import check, write
from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.distortion import BrownConrady, NoDistortion
from calibrary.evidence.metadata import Encoding, ImageMetadata
from calibrary.evidence.originality import Pixels
from calibrary.jobs.extract.calibration_files import Rightness
from calibrary.records import replace
from calibrary.validation import Use, Verdict
from tests.evidence.scenes import p4_rtk, xmp
from tests.imagery import ExifTags, Namespace, XmpDescription, XmpPacket, attributes, write_jpeg
from tests.imagery.jpeg import JFIF, assemble, exif_segment, flat_scan
from tests.jobs.extract.fleet import DEWARP, P4R, entry, files, gate, judged, only, picture

GPANO = Namespace("GPano", "http://ns.google.com/photos/1.0/panorama/")

CAMERA = Encoding(segments=("Exif", "MPF"), sampling=((2, 1), (1, 1), (1, 1)))
PROGRAM = Encoding(segments=("JFIF", "Exif"), sampling=((2, 2), (1, 1), (1, 1)), standard_tables=True)
FRAME = replace(
    p4_rtk(), encoding=CAMERA, byte_order="<", has_exif=True, has_thumbnail=True, has_maker_note=True
)
"""A frame with a calibration of its own in DewarpData."""


def flight_with(other: ImageMetadata) -> dict[ImageMetadata, list[str]]:
    return {FRAME: [f"{number}.jpg" for number in range(9)], other: ["other.jpg"]}


@pytest.mark.parametrize(
    "change",
    [
        {"size": (2736, 1824), "exif_size": (5472, 3648)},
        {"size": (4924, 3282), "exif_size": (5472, 3648)},
        {"size": (4104, 2736), "exif_size": (4104, 2736), "encoding": PROGRAM},
        {"size": (4377, 2919), "exif_size": (4377, 2919)},
        {"size": (5472, 3648), "encoding": PROGRAM},
        {"software": "GIMP 2.10.30"},
    ],
    ids=["half of EXIF's size", "-10 %", "sizes rewritten", "odd", "saved again", "named"],
)
def test_one_manipulated_image_among_nine_originals_is_unproven_and_seen(change: dict[str, object]) -> None:
    cameras = judged(flight_with(replace(FRAME, **change)))
    of_size = {camera.key.image_size: camera for camera in cameras}
    found = of_size[replace(FRAME, **change).size]
    assert found.verdict is Verdict.UNPROVEN
    assert found.remedy is not None
    assert "original files" in found.remedy
    if len(of_size) > 1:
        assert of_size[FRAME.size].verdict is Verdict.VALID


def test_a_k_that_a_named_editor_alone_speaks_against_is_a_start_and_that_of_a_crop_is_none(
    tmp_path: Path,
) -> None:
    picture(tmp_path / "saved/a.jpg", **P4R, software="GIMP 2.10.30")
    picture(tmp_path / "cropped/a.jpg", (2736, 1824), **P4R, pixel_size=(5472, 3648))
    saved, cropped = (only(gate(tmp_path / name)) for name in ("saved", "cropped"))
    assert saved.verdict is cropped.verdict is Verdict.UNPROVEN
    assert saved.use is not None
    assert cropped.use is not None
    assert saved.use.use is Use.START
    assert "saved the images again" in saved.use.why
    assert cropped.use.use is Use.NONE


def test_a_frame_that_was_resized_as_a_whole_is_scaled() -> None:
    whole = replace(FRAME, size=(2736, 1824), exif_size=(5472, 3648), encoding=PROGRAM, whole_frame=True)
    cameras = {camera.key.image_size: camera for camera in judged(flight_with(whole))}
    assert cameras[2736, 1824].verdict is Verdict.VALID
    [small, large] = [cameras[size].calibration for size in ((2736, 1824), (5472, 3648))]
    assert small is not None
    assert large is not None
    assert small.intrinsics.fx == pytest.approx(large.intrinsics.fx / 2)


@pytest.mark.parametrize(
    "change",
    [
        {"software": "DxO PhotoLab 6.3"},
        {"software": "darktable 4.2.1"},
        {"xmp": (*FRAME.xmp, *xmp("crs", LensProfileEnable="1", AlreadyApplied="True"))},
    ],
)
def test_a_corrected_lens_has_no_distortion_that_is_known(change: dict[str, object]) -> None:
    [original] = judged({FRAME: ["a.jpg"]})
    [corrected] = judged({replace(FRAME, **change): ["a.jpg"]})
    assert original.calibration is not None
    assert original.calibration.distortion is not None
    assert corrected.calibration is not None
    assert corrected.calibration.distortion is None
    assert corrected.calibration.grade is Grade.DERIVED
    assert corrected.verdict is Verdict.UNPROVEN
    assert "its distortion is unknown" in str(corrected.reason)


def test_a_panorama_among_originals_has_no_k_and_leaves_theirs(tmp_path: Path) -> None:
    for number in range(3):
        picture(tmp_path / f"{number}.jpg", dewarp=DEWARP, **P4R)
    stitched = XmpPacket(
        descriptions=(XmpDescription(items=attributes(GPANO, ProjectionType="cylindrical")),)
    )
    write_jpeg(tmp_path / "panorama.jpg", (9000, 3000), exif=ExifTags(**P4R), xmp=stitched)
    outcome = gate(tmp_path)
    assert only(outcome).camera.count == 3
    assert only(outcome).verdict is Verdict.VALID
    [skipped] = outcome.rejected
    assert skipped.name == "panorama.jpg"
    assert skipped.reason.startswith("it is a panorama (GPano states the projection cylindrical)")


def test_a_file_that_a_program_saved_again_is_unproven_and_the_report_shows_why(tmp_path: Path) -> None:
    write_jpeg(tmp_path / "a.jpg", (5472, 3648), exif=ExifTags(**P4R), segments=())
    again = assemble([JFIF, exif_segment(ExifTags(**P4R))], flat_scan((5472, 3648)))
    (tmp_path / "b.jpg").write_bytes(again)
    [camera] = gate(tmp_path).cameras
    shown = {name: state for state in camera.states for name in state.images}
    assert shown["b.jpg"].pixels is Pixels.RESAVED
    assert "it begins with a JFIF segment, which DJI cameras do not write" in shown["b.jpg"].seen
    assert shown["b.jpg"].verdict is Verdict.UNPROVEN


UNIT = Calibration(
    camera=CameraKey(image_size=(5472, 3648)),
    intrinsics=Intrinsics(fx=3661.25, fy=3661.25, cx=2736.0, cy=1824.0, image_size=(5472, 3648)),
    distortion=BrownConrady(k1=-0.26, k2=0.11, p1=0.0, p2=0.0, k3=-0.03),
    grade=Grade.CALIBRATED,
    provenance=Provenance(kind="test"),
)
HALVED: dict[str, Any] = {"size": (2736, 1824), "pixel_size": (5472, 3648)}
"""Resized, or a quarter cut out: the header is the same."""
CORRECTED: dict[str, Any] = {"software": "DxO PhotoLab 6.3"}


def moved_by(one: Calibration, px: float) -> Calibration:
    return replace(one, intrinsics=replace(one.intrinsics, fx=one.intrinsics.fx + px))


@pytest.mark.parametrize("change", [HALVED, CORRECTED], ids=["resized or cropped", "lens corrected"])
@pytest.mark.parametrize("by", ["file", "entry"])
def test_a_k_measured_elsewhere_is_not_that_of_images_that_a_program_changed(
    tmp_path: Path, change: dict[str, Any], by: str
) -> None:
    folder, fleet = tmp_path / "flight", tmp_path / "fleet"
    picture(folder / "original/a.jpg", **P4R)
    picture(folder / "changed/a.jpg", **P4R, **change)
    entry(fleet)
    for name in ("original", "changed"):
        write(UNIT, folder / name / "lens.xml", format="agisoft_xml")
    asked = {"registry": files(fleet)} if by == "entry" else {}
    if by == "entry":
        assert only(gate(folder / "original", **asked)).verdict is Verdict.VALID
    found = only(gate(folder / "changed", **asked))
    assert found.verdict is Verdict.UNPROVEN
    assert found.calibration is not None
    assert found.calibration.grade is Grade.DERIVED
    assert "is not used: nothing shows that what it describes is left" in str(found.reason)
    [one] = check(folder / "changed").files
    assert one.verdict is Rightness.UNKNOWN
    assert str(found.camera.reason) in one.message


def test_a_k_of_the_very_size_of_resized_images_is_theirs(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg", **P4R, **HALVED)
    write(UNIT.scaled((2736, 1824)), tmp_path / "lens.xml", format="agisoft_xml")
    found = only(gate(tmp_path))
    assert found.verdict is Verdict.VALID
    assert found.calibration is not None
    assert found.calibration.intrinsics.fx == pytest.approx(3661.25 / 2)
    assert check(tmp_path).is_right


def test_a_k_without_distortion_is_of_images_whose_lens_was_corrected(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg", **P4R, **CORRECTED)
    write(replace(UNIT, distortion=NoDistortion()), tmp_path / "lens.xml", format="agisoft_xml")
    assert check(tmp_path).is_right
    assert only(gate(tmp_path)).verdict is Verdict.VALID
    picture(tmp_path / "b.jpg", **P4R)
    assert not check(tmp_path).is_right, "of an original it is not"


def test_what_is_of_another_size_is_no_rival_of_a_k_of_the_very_size_of_resized_images(
    tmp_path: Path,
) -> None:
    picture(tmp_path / "a.jpg", **P4R, **HALVED)
    write(UNIT, tmp_path / "camera.xml", format="agisoft_xml")
    write(moved_by(UNIT, 3.0).scaled((2736, 1824)), tmp_path / "lens.xml", format="agisoft_xml")
    found = only(gate(tmp_path))
    assert found.verdict is Verdict.VALID
    assert found.calibration is not None
    assert found.calibration.intrinsics.fx == pytest.approx(3664.25 / 2)


def test_of_several_changes_the_one_that_puts_a_k_of_this_size_in_doubt_is_told(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg", **P4R, software="Microsoft Windows Photo Viewer 10")
    write(UNIT, tmp_path / "lens.xml", format="agisoft_xml")
    assert check(tmp_path).is_right
    picture(tmp_path / "b.jpg", **P4R, **CORRECTED)
    [one] = check(tmp_path).files
    assert one.verdict is Rightness.UNKNOWN
    assert "1 of 2 images was developed by DxO PhotoLab" in one.message
    assert "Photo Viewer" not in one.message
