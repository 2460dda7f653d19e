"""What each maker's tags mean, in numbers; the rules were read off real cameras' files."""

from __future__ import annotations

import math

import pytest

from calibrary.calibration import CameraKey, Grade
from calibrary.distortion import BrownConrady, NoDistortion, Rational
from calibrary.evidence.collect import Evidence, collect
from calibrary.evidence.context import Scene
from calibrary.evidence.estimate import Source, SourceEstimate
from calibrary.evidence.identity import camera_key
from calibrary.evidence.metadata import FocalPlaneUnit, ImageMetadata
from calibrary.known_camera import KnownCamera
from calibrary.records import replace
from tests.evidence.scenes import M3T_THERMAL, M3T_WIDE, P4_RTK, PHANTOM_3, SKYDIO_2, micasense, p4_rtk, xmp


def estimate(evidence: Evidence, source: Source) -> SourceEstimate:
    return next(w for w in evidence.estimates if w.source is source)


def test_dewarp_data_counts_the_principal_point_from_the_middle_y_down() -> None:
    chosen = collect(Scene(metadata=p4_rtk(), known=P4_RTK)).chosen
    assert chosen is not None
    K = chosen.intrinsics
    assert (K.fx, K.fy, K.cx, K.cy) == (3660.5, 3655.25, 2736 - 4.5, 1824 + 22.75)
    assert chosen.grade is Grade.CALIBRATED
    assert chosen.distortion == BrownConrady(k1=-0.268, k2=0.112, p1=0.0008, p2=-0.0001, k3=-0.034)


def test_dewarp_data_of_a_resized_file_is_scaled_from_exifs_frame() -> None:
    chosen = collect(Scene(metadata=p4_rtk(size=(1368, 912)), known=P4_RTK)).chosen
    assert chosen is not None
    assert chosen.intrinsics.fx == pytest.approx(3660.5 / 4)
    assert chosen.reference_size == (5472, 3648)


@pytest.mark.parametrize(
    ("stated", "date", "notes"),
    [
        ("2019-03-05", "2019-03-05", 0),
        (" 2019-03-05", "2019-03-05", 0),
        ("03/05/2019", None, 1),
        ("", None, 0),
    ],
)
def test_the_date_before_dewarp_datas_numbers_is_the_calibrations(
    stated: str, date: str | None, notes: int
) -> None:
    text = f"{stated};3660.5,3655.25,-4.5,22.75,-0.268,0.112,0.0008,-0.0001,-0.034"
    calibration = collect(Scene(metadata=p4_rtk(dewarp=text), known=P4_RTK)).calibration(CameraKey())
    assert calibration is not None
    assert calibration.provenance.date == date
    assert len(calibration.notes) == notes


def test_the_day_of_the_photograph_is_no_date_of_a_design_value() -> None:
    calibration = collect(Scene(metadata=p4_rtk(dewarp=""), known=P4_RTK)).calibration(CameraKey())
    assert calibration is not None
    assert calibration.provenance.date is None


def test_dewarp_data_with_a_leading_blank_is_read() -> None:
    text = " 2018-09-07;3657.0,3650.5,-4,23,-0.267,0.11,0.0008,0.0001,-0.03"
    chosen = collect(Scene(metadata=p4_rtk(dewarp=text), known=P4_RTK)).chosen
    assert chosen is not None
    assert chosen.source is Source.DJI_DEWARP


def test_dewarp_flag_1_keeps_k_and_says_that_there_is_no_distortion_left() -> None:
    chosen = collect(Scene(metadata=p4_rtk(DewarpFlag="1"), known=P4_RTK)).chosen
    assert chosen is not None
    assert chosen.intrinsics.fx == 3660.5
    assert chosen.distortion == NoDistortion()


def test_dewarp_data_k6_is_opencvs_rational_model() -> None:
    k6 = "3725.1,3724.9,1.5,-2.5,0.1,0.02,0.0003,-0.0004,0.005,0.06,0.007,0.0008"
    metadata = replace(p4_rtk(), xmp=xmp("drone-dji", DewarpDataK6=k6))
    chosen = collect(Scene(metadata=metadata, known=P4_RTK)).chosen
    assert chosen is not None
    assert chosen.distortion == Rational(
        k1=0.1, k2=0.02, p1=0.0003, p2=-0.0004, k3=0.005, k4=0.06, k5=0.007, k6=0.0008
    )


@pytest.mark.parametrize(
    "text", ["2020-01-01;0,0,0,0,0,0,0,0,0", "2020-01-01;1,2,3", "nonsense", "1;nan,1,1,1,1,1,1,1,1"]
)
def test_dewarp_data_that_is_no_calibration_is_dropped_with_a_reason(text: str) -> None:
    evidence = collect(Scene(metadata=p4_rtk(dewarp=text), known=P4_RTK))
    assert [d.source for d in evidence.dropped] == [Source.DJI_DEWARP]
    assert evidence.chosen is not None
    assert evidence.chosen.source is Source.CATALOGUE_PITCH


def test_calibrated_focal_length_is_the_design_value_and_not_a_calibration() -> None:
    metadata = replace(
        p4_rtk(),
        xmp=xmp(
            "drone-dji",
            CalibratedFocalLength="3666.666504",
            CalibratedOpticalCenterX="2736.000000",
            CalibratedOpticalCenterY="1824.000000",
        ),
    )
    design = estimate(collect(Scene(metadata=metadata, known=P4_RTK)), Source.DJI_DESIGN)
    assert design.grade is Grade.DESIGN
    assert not design.measured_centre


def test_the_design_centre_tells_the_frame_of_a_file_whose_exif_size_lies() -> None:
    metadata = ImageMetadata(
        size=(2736, 1824),
        exif_size=(2736, 1824),
        make="DJI",
        model="FC6310R",
        focal_mm=8.8,
        xmp=xmp(
            "drone-dji",
            CalibratedFocalLength="3666.666504",
            CalibratedOpticalCenterX="2736.0",
            CalibratedOpticalCenterY="1824.0",
        ),
    )
    design = estimate(collect(Scene(metadata=metadata, known=P4_RTK)), Source.DJI_DESIGN)
    assert design.reference_size == (5472, 3648)
    assert design.intrinsics.fx == pytest.approx(3666.666504 / 2)


def test_rededge_firmware_2_writes_pixels_without_a_unit() -> None:
    chosen = collect(Scene(metadata=micasense("1449.36"))).chosen
    assert chosen is not None
    assert chosen.source is Source.CAMERA_PERSPECTIVE
    assert chosen.intrinsics.fx == 1449.36


def test_rededge_firmware_3_writes_millimetres_with_a_unit() -> None:
    chosen = collect(Scene(metadata=micasense("5.4522", unit="mm"))).chosen
    assert chosen is not None
    assert chosen.intrinsics.fx == pytest.approx(5.4522 * 266.666667)


def test_camera_principal_point_is_in_millimetres_from_the_upper_left() -> None:
    chosen = collect(Scene(metadata=micasense("1449.36"))).chosen
    assert chosen is not None
    assert (chosen.intrinsics.cx, chosen.intrinsics.cy) == pytest.approx(
        (2.36 * 266.666667, 1.81 * 266.666667)
    )
    assert chosen.measured_centre


def test_camera_perspective_distortion_is_k1_k2_k3_p1_p2() -> None:
    chosen = collect(Scene(metadata=micasense("1449.36"))).chosen
    assert chosen is not None
    assert chosen.distortion == BrownConrady(k1=-0.1, k2=0.14, k3=-0.02, p1=0.0003, p2=-0.0004)


def test_a_focal_length_that_fits_in_neither_unit_is_dropped() -> None:
    evidence = collect(Scene(metadata=micasense("90")))
    assert evidence.dropped[0].source is Source.CAMERA_PERSPECTIVE
    assert "neither in mm nor in pixels" in evidence.dropped[0].reason


def test_an_unknown_unit_is_not_guessed() -> None:
    evidence = collect(Scene(metadata=micasense("5.45", unit="furlong")))
    assert "furlong" in evidence.dropped[0].reason


def test_a_fisheye_is_heard_but_gives_no_k() -> None:
    metadata = ImageMetadata(
        size=(1280, 960),
        make="Parrot",
        model="Sequoia",
        focal_mm=3.98,
        focal_plane_resolution=(266.67, 266.67),
        focal_plane_unit=FocalPlaneUnit.MILLIMETRE,
        xmp=xmp("Camera", ModelType="fisheye", FisheyeAffineMatrix="1657.9,0.0,0.0,1657.9"),
    )
    evidence = collect(Scene(metadata=metadata))
    fisheye = estimate(evidence, Source.CAMERA_FISHEYE)
    assert fisheye.intrinsics.fx == pytest.approx(2 * 1657.9 / math.pi)
    assert fisheye.intrinsics.fx == pytest.approx(
        estimate(evidence, Source.FOCAL_PLANE).intrinsics.fx, rel=0.01
    )
    assert evidence.chosen is None


def skydio(**over: object) -> ImageMetadata:
    values = {
        "CalibratedFocalLength__X": "2378.5",
        "CalibratedFocalLength__Y": "2376.9",
        "CalibratedOpticalCenter__X": "2028.7",
        "CalibratedOpticalCenter__Y": "1519.8",
    }
    metadata = ImageMetadata(
        size=(4056, 3040),
        exif_size=(4056, 3040),
        make="Skydio",
        model="2",
        focal_mm=4.7,
        xmp=xmp("drone-skydio", **values),
    )
    return replace(metadata, **over)


def test_skydio_counts_from_the_centre_of_the_first_pixel() -> None:
    chosen = collect(Scene(metadata=skydio(), known=SKYDIO_2)).chosen
    assert chosen is not None
    assert (chosen.intrinsics.cx, chosen.intrinsics.cy) == (2029.2, 1520.3)


def test_skydio_counts_in_the_full_sensor_whatever_the_file_shows() -> None:
    cropped = skydio(size=(1500, 844), exif_size=(4056, 2282))
    chosen = collect(Scene(metadata=cropped, known=SKYDIO_2)).chosen
    assert chosen is not None
    assert chosen.intrinsics.fx == pytest.approx(2378.5 * 1500 / 4056)
    assert chosen.intrinsics.cy == pytest.approx((1520.3 - 379) * 844 / 2282)


def test_a_camera_known_to_write_a_wrong_focal_length_is_not_believed_about_it() -> None:
    evidence = collect(Scene(metadata=replace(skydio(), xmp=()), known=SKYDIO_2))
    assert evidence.chosen is None
    assert "wrong focal length" in evidence.dropped[0].reason


def test_a_thermal_frame_with_the_colour_cameras_calibration_drops_it() -> None:
    thermal = replace(SKYDIO_2, title="thermal", native_size=(640, 512), pitch_um=12.0, fx_over_w=1.1)
    values = {
        "CalibratedFocalLength__X": "4892",
        "CalibratedFocalLength__Y": "4890",
        "CalibratedOpticalCenter__X": "1989",
        "CalibratedOpticalCenter__Y": "1500",
    }
    metadata = ImageMetadata(size=(640, 512), make="Skydio", model="X2", xmp=xmp("drone-skydio", **values))
    evidence = collect(Scene(metadata=metadata, known=thermal))
    assert "outside the 640×512 image" in evidence.dropped[0].reason
    assert evidence.chosen is None


def test_a_calibration_a_fifth_off_the_optics_is_another_cameras() -> None:
    text = "2020-01-01;900,900,0,0,0,0,0,0,0"
    evidence = collect(Scene(metadata=p4_rtk(dewarp=text), known=P4_RTK))
    assert "another sub-camera" in evidence.dropped[0].reason


def test_horizontal_field_of_view_gives_the_focal_length() -> None:
    metadata = ImageMetadata(size=(4624, 3472), xmp=xmp("exif", CameraHorizontalFOV="68.0"))
    chosen = collect(Scene(metadata=metadata)).chosen
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
    chosen = collect(Scene(metadata=metadata)).chosen
    assert chosen is not None
    assert chosen.intrinsics.fx == pytest.approx(2904.35, abs=0.01)


def test_each_axis_of_a_focal_plane_has_its_own_resolution() -> None:
    metadata = ImageMetadata(
        size=(4000, 3000),
        focal_mm=4.5,
        focal_plane_resolution=(640.0, 480.0),
        focal_plane_unit=FocalPlaneUnit.MILLIMETRE,
    )
    chosen = collect(Scene(metadata=metadata)).chosen
    assert chosen is not None
    assert (chosen.intrinsics.fx, chosen.intrinsics.fy) == (4.5 * 640, 4.5 * 480)
    # 4000 px at 60 /mm are 67 mm and 3000 px at 34 /mm are 88 mm: together more than 100 mm across.
    broad = replace(metadata, focal_plane_resolution=(60.0, 34.0))
    assert collect(Scene(metadata=broad)).chosen is None
    assert collect(Scene(metadata=replace(metadata, focal_plane_resolution=(60.0, 60.0)))).chosen is not None


def test_a_design_centre_below_the_frame_is_another_sub_cameras() -> None:
    text = "2019-03-05;3660.5,3655.25,-4.5,1900.0,-0.268,0.112,0.0008,-0.0001,-0.034"
    evidence = collect(Scene(metadata=p4_rtk(dewarp=text), known=P4_RTK))
    reason = next(d.reason for d in evidence.dropped if d.source is Source.DJI_DEWARP)
    assert "the optical centre (2731.5, 3724.0) lies outside the 5472×3648 image" in reason


@pytest.mark.parametrize("factor", [0.75, 1.25])
def test_a_calibration_a_quarter_off_either_way_is_another_cameras(factor: float) -> None:
    text = f"2019-03-05;{3660.5 * factor},{3655.25 * factor},-4.5,22.75,-0.268,0.112,0.0008,-0.0001,-0.034"
    evidence = collect(Scene(metadata=p4_rtk(dewarp=text), known=P4_RTK))
    assert Source.DJI_DEWARP in {dropped.source for dropped in evidence.dropped}


@pytest.mark.parametrize("pair", ["0,3655.25", "3660.5,0"])
def test_one_focal_length_of_zero_is_enough_to_distrust_dewarp_data(pair: str) -> None:
    text = f"2019-03-05;{pair},-4.5,22.75,-0.268,0.112,0.0008,-0.0001,-0.034"
    evidence = collect(Scene(metadata=p4_rtk(dewarp=text), known=P4_RTK))
    reason = next(d.reason for d in evidence.dropped if d.source is Source.DJI_DEWARP)
    assert "contains zeros" in reason


def test_the_35_mm_equivalent_of_a_wide_frame_is_given_what_a_crop_to_16_9_hides() -> None:
    def slack(size: tuple[int, int], **known: object) -> float:
        metadata = ImageMetadata(size=size, focal_mm=4.5, focal_35mm=50.0)
        return estimate(collect(Scene(metadata=metadata, **known)), Source.FOCAL_35MM).tolerance  # type: ignore[arg-type]

    assert slack((4000, 2250)) == 0.09
    assert slack((2250, 4000)) == slack((4000, 3000)) == 1 / 50
    assert slack((4000, 2250), known=PHANTOM_3) == 1 / 50


def test_a_thermal_camera_without_a_focal_length_has_the_catalogues_design() -> None:
    chosen = collect(Scene(metadata=ImageMetadata(size=(640, 512)), known=M3T_THERMAL)).chosen
    assert chosen is not None
    assert (chosen.source, chosen.grade) == (Source.CATALOGUE_DESIGN, Grade.DESIGN)
    assert chosen.intrinsics.fx == pytest.approx(1.185 * 640)


@pytest.mark.parametrize("known", [P4_RTK, M3T_WIDE], ids=["drone", "visible camera beside a thermal one"])
def test_another_camera_without_a_focal_length_has_lost_it(known: KnownCamera) -> None:
    assert known.native_size is not None
    assert collect(Scene(metadata=ImageMetadata(size=known.native_size), known=known)).chosen is None


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
    chosen = collect(Scene(metadata=ImageMetadata(size=(3840, 2160), focal_mm=focal_mm), known=action)).chosen
    assert (chosen.intrinsics.fx if chosen is not None else None) == fx


def test_72_dpi_is_no_focal_plane() -> None:
    metadata = ImageMetadata(size=(4056, 3040), focal_mm=3.7, focal_plane_resolution=(72.0, 72.0))
    evidence = collect(Scene(metadata=metadata))
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
    chosen = collect(Scene(metadata=metadata)).chosen
    assert chosen is not None
    assert chosen.intrinsics.fx == pytest.approx(2904.35 / 4, abs=0.01)


def test_catalogue_pitch_keeps_its_pixels_through_a_16_9_crop() -> None:
    metadata = ImageMetadata(size=(4000, 2250), exif_size=(4000, 2250), focal_mm=3.61, focal_35mm=20.0)
    chosen = collect(Scene(metadata=metadata, known=PHANTOM_3)).chosen
    assert chosen is not None
    assert (chosen.intrinsics.fx, chosen.intrinsics.fy) == pytest.approx((3610 / 1.54, 3610 / 1.54))
    assert (chosen.intrinsics.cx, chosen.intrinsics.cy) == (2000, 1125)


def test_thermal_of_a_shared_model_is_not_touched_by_an_exif_size_of_super_resolution() -> None:
    metadata = ImageMetadata(size=(640, 512), exif_size=(1280, 1024), focal_mm=9.1, focal_35mm=40.0)
    chosen = collect(Scene(metadata=metadata, known=M3T_THERMAL, siblings=(M3T_WIDE,))).chosen
    assert chosen is not None
    assert chosen.intrinsics.fx == pytest.approx(758.33, abs=0.01)


def test_super_resolution_doubles_the_pixels() -> None:
    metadata = ImageMetadata(size=(1280, 1024), exif_size=(1280, 1024), focal_mm=9.1)
    chosen = collect(Scene(metadata=metadata, known=M3T_THERMAL)).chosen
    assert chosen is not None
    assert chosen.intrinsics.fx == pytest.approx(1516.67, abs=0.01)


def test_a_35_mm_equivalent_alone_is_a_prior_and_never_a_k() -> None:
    evidence = collect(Scene(metadata=ImageMetadata(size=(5472, 3648), focal_35mm=24.0)))
    assert [w.grade for w in evidence.estimates] == [Grade.PRIOR]
    assert evidence.chosen is None


def test_the_35_mm_equivalent_refers_to_the_native_diagonal_not_the_crops() -> None:
    metadata = ImageMetadata(size=(4000, 2250), focal_mm=3.61, focal_35mm=20.0)
    prior = estimate(collect(Scene(metadata=metadata, known=PHANTOM_3)), Source.FOCAL_35MM)
    assert prior.intrinsics.fx == pytest.approx(20.0 / math.hypot(36, 24) * 5000)


def test_a_given_sensor_is_heard_before_the_catalogue() -> None:
    metadata = ImageMetadata(size=(5472, 3648), focal_mm=8.8)
    scene = Scene(metadata=metadata, known=P4_RTK, given_sensor_mm=(13.2, 8.8), assumed_sensor_mm=None)
    chosen = collect(scene).chosen
    assert chosen is not None
    assert chosen.source is Source.GIVEN_SENSOR
    assert chosen.intrinsics.fx == (8.8 / 13.2) * 5472


def test_a_sensor_is_assumed_only_when_nothing_else_tells_the_pitch() -> None:
    metadata = ImageMetadata(size=(5472, 3648), focal_mm=8.8)
    chosen = collect(Scene(metadata=metadata, assumed_sensor_mm=(13.2, 8.8))).chosen
    assert chosen is not None
    assert chosen.source is Source.ASSUMED_SENSOR
    assert chosen.assumptions == ("the sensor is 13.2 × 8.8 mm",)
    with_plane = replace(
        metadata, focal_plane_resolution=(416.67, 416.67), focal_plane_unit=FocalPlaneUnit.MILLIMETRE
    )
    sources = {w.source for w in collect(Scene(metadata=with_plane, assumed_sensor_mm=(13.2, 8.8))).estimates}
    assert Source.ASSUMED_SENSOR not in sources


def test_orientation_is_not_applied_and_said_so() -> None:
    metadata = replace(micasense("1449.36"), orientation=3)
    evidence = collect(Scene(metadata=metadata))
    calibration = evidence.calibration(camera_key(metadata))
    assert calibration is not None
    assert "Orientation is 3" in calibration.notes[0]


def test_dewarp_flag_1_without_dewarp_data_still_says_that_there_is_no_distortion() -> None:
    metadata = replace(p4_rtk(), xmp=xmp("drone-dji", DewarpFlag="1"))
    calibration = collect(Scene(metadata=metadata, known=P4_RTK)).calibration(camera_key(metadata))
    assert calibration is not None
    assert calibration.distortion == NoDistortion()


def test_two_readings_of_one_focal_plane_resolution_are_not_independent() -> None:
    evidence = collect(Scene(metadata=micasense("5.4522", unit="mm")))
    calibrated, derived = (
        estimate(evidence, source) for source in (Source.CAMERA_PERSPECTIVE, Source.FOCAL_PLANE)
    )
    assert not calibrated.is_independent_of(derived)


def test_pixels_in_xmp_are_independent_of_the_focal_plane_resolution() -> None:
    evidence = collect(Scene(metadata=micasense("1449.36")))
    calibrated, derived = (
        estimate(evidence, source) for source in (Source.CAMERA_PERSPECTIVE, Source.FOCAL_PLANE)
    )
    assert calibrated.is_independent_of(derived)
