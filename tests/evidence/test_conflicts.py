"""Of two estimates that are more than 5 % apart the likely cause is named."""

from __future__ import annotations

import math

import pytest

from calibrary.evidence.context import Scene, Source
from calibrary.evidence.metadata import FocalPlaneUnit, ImageMetadata
from calibrary.evidence.weighing import Cause, disagreement, evidence_of
from calibrary.records import replace
from tests.evidence.scenes import M3T_THERMAL, M3T_WIDE, P4_RTK, micasense, p4_rtk, xmp


def causes(scene: Scene) -> set[Cause]:
    evidence = evidence_of(scene)
    found = {evidence.cause(one.tag) for one in evidence.estimates}
    return {one for one in found if one is not None}


def test_sources_that_agree_within_five_per_cent_need_no_cause() -> None:
    assert not causes(Scene(metadata=p4_rtk(), known=P4_RTK))


def test_a_whole_number_of_35_mm_is_given_its_rounding() -> None:
    metadata = ImageMetadata(size=(5472, 3648), focal_mm=8.8, focal_35mm=23.0)
    assert not causes(Scene(metadata=metadata, known=P4_RTK))


@pytest.mark.parametrize(("tolerance", "excused"), [(0.0, False), (0.19, False), (0.26, True)])
def test_the_rounding_of_either_of_two_sources_excuses_both(tolerance: float, excused: bool) -> None:
    [sure] = (w for w in evidence_of(Scene(metadata=p4_rtk())).estimates if w.source is Source.DJI_DEWARP)
    K = sure.intrinsics
    rounded = replace(sure, intrinsics=replace(K, fx=K.fx * 0.8), tolerance=tolerance)
    assert disagreement(sure, rounded) == pytest.approx(0.0 if excused else -0.2)
    assert disagreement(rounded, sure) == pytest.approx(0.0 if excused else 0.25)


def test_a_35_mm_equivalent_written_as_the_focal_length_is_a_leak() -> None:
    metadata = ImageMetadata(size=(5472, 3648), focal_mm=24.0, focal_35mm=24.0)
    assert causes(Scene(metadata=metadata, known=P4_RTK)) == {Cause.LEAK_35MM}


def test_digital_zoom_that_one_source_does_not_know_is_named() -> None:
    metadata = ImageMetadata(
        size=(5472, 3648),
        focal_mm=17.6,
        digital_zoom=2.0,
        focal_plane_resolution=(416.67, 416.67),
        focal_plane_unit=FocalPlaneUnit.MILLIMETRE,
        focal_35mm=24.0,
    )
    assert causes(Scene(metadata=metadata)) == {Cause.DIGITAL_ZOOM}


def test_another_sub_cameras_focal_length_is_named() -> None:
    metadata = ImageMetadata(size=(640, 512), focal_mm=4.4, focal_35mm=40.0)
    found = causes(Scene(metadata=metadata, known=M3T_THERMAL, siblings=(M3T_WIDE,)))
    assert found == {Cause.OTHER_SUB_CAMERA}


def test_a_wrong_given_sensor_is_named() -> None:
    metadata = ImageMetadata(size=(5472, 3648), focal_mm=8.8, focal_35mm=24.0)
    found = causes(Scene(metadata=metadata, known=P4_RTK, given_sensor_mm=(6.17, 4.63)))
    assert found == {Cause.SENSOR_SIZE}


def test_a_stale_exif_size_is_named() -> None:
    metadata = ImageMetadata(
        size=(640, 512),
        exif_size=(1280, 1024),
        focal_mm=9.1,
        focal_plane_resolution=(83.333, 83.333),
        focal_plane_unit=FocalPlaneUnit.MILLIMETRE,
        xmp=xmp("exif", CameraHorizontalFOV="45.75"),
    )
    assert causes(Scene(metadata=metadata)) == {Cause.STALE_EXIF_SIZE}


def test_a_crop_one_source_does_not_know_of_is_named() -> None:
    full_frames_angle = str(2 * math.degrees(math.atan(5472 / 2 / 3666.7)))
    metadata = ImageMetadata(
        size=(4864, 3648), focal_mm=8.8, xmp=xmp("exif", CameraHorizontalFOV=full_frames_angle)
    )
    assert causes(Scene(metadata=metadata, known=P4_RTK)) == {Cause.CROP}


def test_a_focal_plane_resolution_of_another_frame_is_not_believed_of_a_known_camera() -> None:
    metadata = ImageMetadata(
        size=(1368, 912),
        exif_size=(1368, 912),
        focal_mm=8.8,
        focal_plane_resolution=(416.67, 416.67),
        focal_plane_unit=FocalPlaneUnit.MILLIMETRE,
    )
    evidence = evidence_of(Scene(metadata=metadata, known=P4_RTK))
    assert evidence.chosen is not None
    assert evidence.chosen.source is Source.CATALOGUE_PITCH
    assert [d.source for d in evidence.dropped] == [Source.FOCAL_PLANE]


def test_millimetres_taken_for_pixels_do_not_get_past_the_cross_check() -> None:
    evidence = evidence_of(Scene(metadata=micasense("5.45", unit="pixels")))
    assert evidence.chosen is not None
    assert evidence.chosen.intrinsics.fx == pytest.approx(5.5 * 266.666667)
    assert "another image size" in evidence.dropped[0].reason


def test_a_conflict_without_a_known_pattern_says_so() -> None:
    metadata = replace(p4_rtk(), focal_35mm=31.0)
    assert causes(Scene(metadata=metadata, known=P4_RTK)) == {Cause.UNKNOWN}
