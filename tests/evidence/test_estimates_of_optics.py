"""K from focal length, field of view and the size of pixels: what each tag gives, and when it is not believed."""

from __future__ import annotations

import math

import pytest

from calibrary.calibration import Grade
from calibrary.evidence.context import Scene, Source
from calibrary.evidence.metadata import FocalPlaneUnit, ImageMetadata
from calibrary.evidence.weighing import evidence_of
from calibrary.known_camera import KnownCamera
from calibrary.records import replace
from tests.evidence.estimating import estimate
from tests.evidence.scenes import M3T_THERMAL, M3T_WIDE, P4_RTK, PHANTOM_3, micasense, xmp


def test_horizontal_field_of_view_gives_the_focal_length() -> None:
    metadata = ImageMetadata(size=(4624, 3472), xmp=xmp("exif", CameraHorizontalFOV="68.0"))
    chosen = evidence_of(Scene(metadata=metadata)).chosen
    assert chosen is not None
    assert chosen.intrinsics.fx == pytest.approx(2312 / math.tan(math.radians(34)))


@pytest.mark.parametrize(
    ("unit", "resolution"),
    [
        (FocalPlaneUnit.INCH, 16393.44262),
        (FocalPlaneUnit.CENTIMETRE, 6454.1112),
        (FocalPlaneUnit.MILLIMETRE, 645.41112),
        (FocalPlaneUnit.MICROMETRE, 0.64541112),
        (None, 16393.44262),
    ],
)
def test_focal_plane_resolution_counts_in_each_unit(unit: FocalPlaneUnit | None, resolution: float) -> None:
    metadata = ImageMetadata(
        size=(4000, 3000),
        focal_mm=4.5,
        focal_plane_resolution=(resolution, resolution),
        focal_plane_unit=unit,
    )
    chosen = evidence_of(Scene(metadata=metadata)).chosen
    assert chosen is not None
    assert chosen.intrinsics.fx == pytest.approx(2904.35, abs=0.01)


def test_each_axis_of_a_focal_plane_has_its_own_resolution() -> None:
    metadata = ImageMetadata(
        size=(4000, 3000),
        focal_mm=4.5,
        focal_plane_resolution=(640.0, 480.0),
        focal_plane_unit=FocalPlaneUnit.MILLIMETRE,
    )
    chosen = evidence_of(Scene(metadata=metadata)).chosen
    assert chosen is not None
    assert (chosen.intrinsics.fx, chosen.intrinsics.fy) == (4.5 * 640, 4.5 * 480)
    # 4000 px at 60 /mm are 67 mm and 3000 px at 34 /mm are 88 mm: together more than 100 mm across.
    broad = replace(metadata, focal_plane_resolution=(60.0, 34.0))
    assert evidence_of(Scene(metadata=broad)).chosen is None
    assert (
        evidence_of(Scene(metadata=replace(metadata, focal_plane_resolution=(60.0, 60.0)))).chosen is not None
    )


def test_the_35_mm_equivalent_of_a_wide_frame_is_given_what_a_crop_to_16_9_hides() -> None:
    def slack(size: tuple[int, int], **known: object) -> float:
        metadata = ImageMetadata(size=size, focal_mm=4.5, focal_35mm=50.0)
        return estimate(evidence_of(Scene(metadata=metadata, **known)), Source.FOCAL_35MM).tolerance  # type: ignore[arg-type]

    assert slack((4000, 2250)) == 0.09
    assert slack((2250, 4000)) == slack((4000, 3000)) == 1 / 50
    assert slack((4000, 2250), known=PHANTOM_3) == 1 / 50


def test_a_thermal_camera_without_a_focal_length_has_the_catalogues_design() -> None:
    chosen = evidence_of(Scene(metadata=ImageMetadata(size=(640, 512)), known=M3T_THERMAL)).chosen
    assert chosen is not None
    assert (chosen.source, chosen.grade) == (Source.CATALOGUE_DESIGN, Grade.DESIGN)
    assert chosen.intrinsics.fx == pytest.approx(1.185 * 640)


@pytest.mark.parametrize("known", [P4_RTK, M3T_WIDE], ids=["drone", "visible camera beside a thermal one"])
def test_another_camera_without_a_focal_length_has_lost_it(known: KnownCamera) -> None:
    assert known.native_size is not None
    assert evidence_of(Scene(metadata=ImageMetadata(size=known.native_size), known=known)).chosen is None


@pytest.mark.parametrize(("focal_mm", "fx"), [(2.6, 0.396 * 3840), (5.2, None)])
def test_a_catalogues_fx_without_a_pitch_is_of_its_focal_length(focal_mm: float, fx: float | None) -> None:
    action = KnownCamera(
        make="SONY",
        models=("HDR-AS300",),
        title="action camera",
        native_size=(3840, 2160),
        focal_mm=2.6,
        fx_over_w=0.396,
    )
    chosen = evidence_of(
        Scene(metadata=ImageMetadata(size=(3840, 2160), focal_mm=focal_mm), known=action)
    ).chosen
    assert (chosen.intrinsics.fx if chosen is not None else None) == fx


def test_72_dpi_is_no_focal_plane() -> None:
    metadata = ImageMetadata(size=(4056, 3040), focal_mm=3.7, focal_plane_resolution=(72.0, 72.0))
    evidence = evidence_of(Scene(metadata=metadata))
    assert evidence.chosen is None
    assert "1 … 100 mm" in evidence.dropped[0].reason


def test_focal_plane_resolution_of_a_resized_file_counts_in_exifs_frame() -> None:
    metadata = ImageMetadata(
        size=(1000, 750),
        exif_size=(4000, 3000),
        focal_mm=4.5,
        focal_plane_resolution=(16393.44262, 16393.44262),
        focal_plane_unit=FocalPlaneUnit.INCH,
    )
    chosen = evidence_of(Scene(metadata=metadata)).chosen
    assert chosen is not None
    assert chosen.intrinsics.fx == pytest.approx(2904.35 / 4, abs=0.01)


def test_catalogue_pitch_keeps_its_pixels_through_a_16_9_crop() -> None:
    metadata = ImageMetadata(size=(4000, 2250), exif_size=(4000, 2250), focal_mm=3.61, focal_35mm=20.0)
    chosen = evidence_of(Scene(metadata=metadata, known=PHANTOM_3)).chosen
    assert chosen is not None
    assert (chosen.intrinsics.fx, chosen.intrinsics.fy) == pytest.approx((3610 / 1.54, 3610 / 1.54))
    assert (chosen.intrinsics.cx, chosen.intrinsics.cy) == (2000, 1125)


def test_thermal_of_a_shared_model_is_not_touched_by_an_exif_size_of_super_resolution() -> None:
    metadata = ImageMetadata(size=(640, 512), exif_size=(1280, 1024), focal_mm=9.1, focal_35mm=40.0)
    chosen = evidence_of(Scene(metadata=metadata, known=M3T_THERMAL, siblings=(M3T_WIDE,))).chosen
    assert chosen is not None
    assert chosen.intrinsics.fx == pytest.approx(758.33, abs=0.01)


def test_super_resolution_doubles_the_pixels() -> None:
    metadata = ImageMetadata(size=(1280, 1024), exif_size=(1280, 1024), focal_mm=9.1)
    chosen = evidence_of(Scene(metadata=metadata, known=M3T_THERMAL)).chosen
    assert chosen is not None
    assert chosen.intrinsics.fx == pytest.approx(1516.67, abs=0.01)


def test_a_35_mm_equivalent_alone_is_a_prior_and_never_a_k() -> None:
    evidence = evidence_of(Scene(metadata=ImageMetadata(size=(5472, 3648), focal_35mm=24.0)))
    assert [w.grade for w in evidence.estimates] == [Grade.PRIOR]
    assert evidence.chosen is None


def test_the_35_mm_equivalent_refers_to_the_native_diagonal_not_the_crops() -> None:
    metadata = ImageMetadata(size=(4000, 2250), focal_mm=3.61, focal_35mm=20.0)
    prior = estimate(evidence_of(Scene(metadata=metadata, known=PHANTOM_3)), Source.FOCAL_35MM)
    assert prior.intrinsics.fx == pytest.approx(20.0 / math.hypot(36, 24) * 5000)


def test_a_given_sensor_is_heard_before_the_catalogue() -> None:
    metadata = ImageMetadata(size=(5472, 3648), focal_mm=8.8)
    scene = Scene(metadata=metadata, known=P4_RTK, given_sensor_mm=(13.2, 8.8), assumed_sensor_mm=None)
    chosen = evidence_of(scene).chosen
    assert chosen is not None
    assert chosen.source is Source.GIVEN_SENSOR
    assert chosen.intrinsics.fx == (8.8 / 13.2) * 5472


def test_a_sensor_is_assumed_only_when_nothing_else_tells_the_pitch() -> None:
    metadata = ImageMetadata(size=(5472, 3648), focal_mm=8.8)
    chosen = evidence_of(Scene(metadata=metadata, assumed_sensor_mm=(13.2, 8.8))).chosen
    assert chosen is not None
    assert chosen.source is Source.ASSUMED_SENSOR
    assert chosen.assumptions == ("the sensor is 13.2 × 8.8 mm",)
    with_plane = replace(
        metadata, focal_plane_resolution=(416.67, 416.67), focal_plane_unit=FocalPlaneUnit.MILLIMETRE
    )
    sources = {
        w.source for w in evidence_of(Scene(metadata=with_plane, assumed_sensor_mm=(13.2, 8.8))).estimates
    }
    assert Source.ASSUMED_SENSOR not in sources


def test_pixels_in_xmp_are_independent_of_the_focal_plane_resolution() -> None:
    evidence = evidence_of(Scene(metadata=micasense("1449.36")))
    calibrated, derived = (
        estimate(evidence, source) for source in (Source.CAMERA_PERSPECTIVE, Source.FOCAL_PLANE)
    )
    assert calibrated.is_independent_of(derived)
