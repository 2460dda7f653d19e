"""What each maker's tags mean, in numbers; the rules were read off real cameras' files."""

from __future__ import annotations

import math

import numpy as np
import pytest

from calibrary.calibration import CameraKey, Grade
from calibrary.distortion import BrownConrady, NoDistortion, Rational
from calibrary.evidence.context import Scene, Source
from calibrary.evidence.identity import camera_key
from calibrary.evidence.metadata import FocalPlaneUnit, ImageMetadata
from calibrary.evidence.weighing import evidence_of
from calibrary.records import replace
from tests.evidence.estimating import estimate
from tests.evidence.scenes import P4_RTK, SKYDIO_2, micasense, p4_rtk, xmp


def test_dewarp_data_counts_the_principal_point_from_the_middle_y_down() -> None:
    chosen = evidence_of(Scene(metadata=p4_rtk(), known=P4_RTK)).chosen
    assert chosen is not None
    K = chosen.intrinsics
    assert (K.fx, K.fy, K.cx, K.cy) == (3660.5, 3655.25, 2736 - 4.5, 1824 + 22.75)
    assert chosen.grade is Grade.CALIBRATED
    assert chosen.distortion == BrownConrady(k1=-0.268, k2=0.112, p1=0.0008, p2=-0.0001, k3=-0.034)


def test_dewarp_data_of_a_resized_file_is_scaled_from_exifs_frame() -> None:
    chosen = evidence_of(Scene(metadata=p4_rtk(size=(1368, 912)), known=P4_RTK)).chosen
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
    calibration = evidence_of(Scene(metadata=p4_rtk(dewarp=text), known=P4_RTK)).calibration(CameraKey())
    assert calibration is not None
    assert calibration.provenance.date == date
    assert len(calibration.notes) == notes


def test_the_day_of_the_photograph_is_no_date_of_a_design_value() -> None:
    calibration = evidence_of(Scene(metadata=p4_rtk(dewarp=""), known=P4_RTK)).calibration(CameraKey())
    assert calibration is not None
    assert calibration.provenance.date is None


def test_dewarp_data_with_a_leading_blank_is_read() -> None:
    text = " 2018-09-07;3657.0,3650.5,-4,23,-0.267,0.11,0.0008,0.0001,-0.03"
    chosen = evidence_of(Scene(metadata=p4_rtk(dewarp=text), known=P4_RTK)).chosen
    assert chosen is not None
    assert chosen.source is Source.DJI_DEWARP


def test_dewarp_flag_1_keeps_k_and_says_that_there_is_no_distortion_left() -> None:
    chosen = evidence_of(Scene(metadata=p4_rtk(DewarpFlag="1"), known=P4_RTK)).chosen
    assert chosen is not None
    assert chosen.intrinsics.fx == 3660.5
    assert chosen.distortion == NoDistortion()


def test_dewarp_data_k6_is_opencvs_rational_model() -> None:
    k6 = "3725.1,3724.9,1.5,-2.5,0.1,0.02,0.0003,-0.0004,0.005,0.06,0.007,0.0008"
    metadata = replace(p4_rtk(), xmp=xmp("drone-dji", DewarpDataK6=k6))
    chosen = evidence_of(Scene(metadata=metadata, known=P4_RTK)).chosen
    assert chosen is not None
    assert chosen.distortion == Rational(
        k1=0.1, k2=0.02, p1=0.0003, p2=-0.0004, k3=0.005, k4=0.06, k5=0.007, k6=0.0008
    )


@pytest.mark.parametrize(
    "text", ["2020-01-01;0,0,0,0,0,0,0,0,0", "2020-01-01;1,2,3", "nonsense", "1;nan,1,1,1,1,1,1,1,1"]
)
def test_dewarp_data_that_is_no_calibration_is_dropped_with_a_reason(text: str) -> None:
    evidence = evidence_of(Scene(metadata=p4_rtk(dewarp=text), known=P4_RTK))
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
    design = estimate(evidence_of(Scene(metadata=metadata, known=P4_RTK)), Source.DJI_DESIGN)
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
    design = estimate(evidence_of(Scene(metadata=metadata, known=P4_RTK)), Source.DJI_DESIGN)
    assert design.reference_size == (5472, 3648)
    assert design.intrinsics.fx == pytest.approx(3666.666504 / 2)


def test_rededge_firmware_2_writes_pixels_without_a_unit() -> None:
    chosen = evidence_of(Scene(metadata=micasense("1449.36"))).chosen
    assert chosen is not None
    assert chosen.source is Source.CAMERA_PERSPECTIVE
    assert chosen.intrinsics.fx == 1449.36


def test_rededge_firmware_3_writes_millimetres_with_a_unit() -> None:
    chosen = evidence_of(Scene(metadata=micasense("5.4522", unit="mm"))).chosen
    assert chosen is not None
    assert chosen.intrinsics.fx == pytest.approx(5.4522 * 266.666667)


def test_camera_principal_point_is_in_millimetres_from_the_upper_left() -> None:
    chosen = evidence_of(Scene(metadata=micasense("1449.36"))).chosen
    assert chosen is not None
    assert (chosen.intrinsics.cx, chosen.intrinsics.cy) == pytest.approx(
        (2.36 * 266.666667, 1.81 * 266.666667)
    )
    assert chosen.measured_centre


def test_camera_perspective_distortion_is_k1_k2_k3_p1_p2() -> None:
    chosen = evidence_of(Scene(metadata=micasense("1449.36"))).chosen
    assert chosen is not None
    assert chosen.distortion == BrownConrady(k1=-0.1, k2=0.14, k3=-0.02, p1=0.0003, p2=-0.0004)


def test_a_focal_length_that_fits_in_neither_unit_is_dropped() -> None:
    evidence = evidence_of(Scene(metadata=micasense("90")))
    assert evidence.dropped[0].source is Source.CAMERA_PERSPECTIVE
    assert "neither in mm nor in pixels" in evidence.dropped[0].reason


@pytest.mark.parametrize(
    ("value", "fx"), [("1449.36", 1449.36), ("5.4522", 5.4522 * 266.666667), ("1.05", None)]
)
def test_where_no_other_tag_tells_only_a_possible_field_of_view_decides_the_unit(
    value: str, fx: float | None
) -> None:
    bare = replace(micasense(value), focal_mm=None)
    chosen = evidence_of(Scene(metadata=bare)).chosen
    assert (chosen and chosen.intrinsics.fx) == (fx and pytest.approx(fx))
    without_pitch = evidence_of(Scene(metadata=replace(bare, focal_plane_resolution=None))).chosen
    assert (without_pitch is None) == (value != "1449.36")


def test_a_sensor_that_no_camera_has_is_said_to_be_of_another_unit() -> None:
    metadata = replace(
        micasense("1449.36"), size=(12000, 4000), xmp=(), focal_plane_resolution=(150.0, 150.0)
    )
    [dropped] = evidence_of(Scene(metadata=metadata, weighs=True)).dropped
    assert "a sensor 80 mm wide" in dropped.reason


def test_an_unknown_unit_is_not_guessed() -> None:
    evidence = evidence_of(Scene(metadata=micasense("5.45", unit="furlong")))
    assert "furlong" in evidence.dropped[0].reason


def fisheye_band(**tags: str) -> ImageMetadata:
    """A band of a Sequoia, with the numbers of a real one."""
    return ImageMetadata(
        size=(1280, 960),
        make="Parrot",
        model="Sequoia",
        focal_mm=3.98,
        focal_plane_resolution=(266.67, 266.67),
        focal_plane_unit=FocalPlaneUnit.MILLIMETRE,
        xmp=xmp("Camera", ModelType="fisheye", **tags),
    )


def test_a_fisheye_without_its_polynomial_is_heard_but_gives_no_k() -> None:
    evidence = evidence_of(Scene(metadata=fisheye_band(FisheyeAffineMatrix="1657.9,0.0,0.0,1657.9")))
    fisheye = estimate(evidence, Source.CAMERA_FISHEYE)
    assert fisheye.intrinsics.fx == pytest.approx(2 * 1657.9 / math.pi)
    assert fisheye.intrinsics.fx == pytest.approx(
        estimate(evidence, Source.FOCAL_PLANE).intrinsics.fx, rel=0.01
    )
    assert evidence.chosen is None


def test_a_fisheyes_polynomial_projects_as_pix4d_defines_it() -> None:
    c, p2, p3 = 1657.895610464, 0.007360142, -0.137502734
    tags = {"FisheyeAffineMatrix": f"{c},0,0,{c}", "FisheyePolynomial": f"0,1,{p2},{p3}"}
    evidence = evidence_of(Scene(metadata=fisheye_band(PrincipalPoint="2.331556,1.804807", **tags)))
    K = evidence.calibration(CameraKey())
    assert K is not None
    assert K.grade is Grade.CALIBRATED
    rays = np.array([[0.0, 0.0, 1.0], [0.3, -0.2, 1.0], [-0.7, 0.5, 1.0]])
    r = np.hypot(rays[:, 0], rays[:, 1])
    t = 2 / np.pi * np.arctan2(r, rays[:, 2])
    rho = t + p2 * t**2 + p3 * t**3
    scale = c * np.divide(rho, r, out=np.zeros_like(r), where=r > 0)
    middle = np.array([2.331556, 1.804807]) * 266.67
    assert K.project(rays) == pytest.approx(middle + scale[:, None] * rays[:, :2], abs=1e-9)


@pytest.mark.parametrize("polynomial", ["0.1,1,0.007,-0.13", "0,0,0.007", "0,1,nothing", "0,1,2,3,4,5"])
def test_a_polynomial_that_is_none_gives_no_k(polynomial: str) -> None:
    tags = {"FisheyeAffineMatrix": "1657.9,0,0,1657.9", "FisheyePolynomial": polynomial}
    assert evidence_of(Scene(metadata=fisheye_band(**tags))).chosen is None


def test_a_turned_affine_matrix_is_dropped() -> None:
    tags = {"FisheyeAffineMatrix": "1657.9,0,3.5,1657.9", "FisheyePolynomial": "0,1,0.007,-0.13"}
    assert evidence_of(Scene(metadata=fisheye_band(**tags))).dropped[0].source is Source.CAMERA_FISHEYE


@pytest.mark.parametrize(
    "lens", ["EF8-15mm f/4L FISHEYE USM", "AF DX Fisheye-Nikkor 10.5mm f/2.8G ED", "TTArtisan 11mm fish-eye"]
)
def test_a_lens_named_fisheye_is_no_pinhole(lens: str) -> None:
    metadata = ImageMetadata(
        size=(6000, 4000),
        make="Canon",
        model="Canon EOS 80D",
        lens=lens,
        focal_mm=10.0,
        focal_plane_resolution=(6825.939, 6825.939),
        focal_plane_unit=FocalPlaneUnit.INCH,
    )
    evidence = evidence_of(Scene(metadata=metadata, weighs=True))
    assert evidence.estimates
    assert evidence.chosen is None


def band_of_a_p(principal_point: str | None) -> ImageMetadata:
    """A band of a RedEdge-P: a focal length in millimetres, and the pitch by FocalPlaneResolution alone."""
    tags = {"PrincipalPoint": principal_point} if principal_point is not None else {}
    return ImageMetadata(
        size=(1456, 1088),
        make="MicaSense",
        model="RedEdge-P",
        focal_mm=5.5,
        focal_plane_resolution=(289.855072, 289.855072),
        focal_plane_unit=FocalPlaneUnit.MILLIMETRE,
        xmp=xmp("Camera", PerspectiveFocalLength="5.4512", PerspectiveFocalLengthUnits="mm", **tags),
    )


@pytest.mark.parametrize(
    ("principal_point", "confirms"), [("2.49,1.91", True), ("2.9,1.91", False), (None, False)]
)
def test_a_principal_point_in_millimetres_confirms_the_pitch_of_the_focal_length(
    principal_point: str | None, confirms: bool
) -> None:
    evidence = evidence_of(Scene(metadata=band_of_a_p(principal_point), weighs=True))
    measured = estimate(evidence, Source.CAMERA_PERSPECTIVE)
    assert measured.intrinsics.fx == pytest.approx(5.4512 * 289.855072)
    assert measured.is_independent_of(estimate(evidence, Source.FOCAL_PLANE)) is confirms


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
    chosen = evidence_of(Scene(metadata=skydio(), known=SKYDIO_2)).chosen
    assert chosen is not None
    assert (chosen.intrinsics.cx, chosen.intrinsics.cy) == (2029.2, 1520.3)


def test_skydio_counts_in_the_full_sensor_whatever_the_file_shows() -> None:
    cropped = skydio(size=(1500, 844), exif_size=(4056, 2282))
    chosen = evidence_of(Scene(metadata=cropped, known=SKYDIO_2)).chosen
    assert chosen is not None
    assert chosen.intrinsics.fx == pytest.approx(2378.5 * 1500 / 4056)
    assert chosen.intrinsics.cy == pytest.approx((1520.3 - 379) * 844 / 2282)


def test_a_camera_known_to_write_a_wrong_focal_length_is_not_believed_about_it() -> None:
    evidence = evidence_of(Scene(metadata=replace(skydio(), xmp=()), known=SKYDIO_2))
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
    evidence = evidence_of(Scene(metadata=metadata, known=thermal))
    assert "outside the 640×512 image" in evidence.dropped[0].reason
    assert evidence.chosen is None


def test_a_calibration_a_fifth_off_the_optics_is_another_cameras() -> None:
    text = "2020-01-01;900,900,0,0,0,0,0,0,0"
    evidence = evidence_of(Scene(metadata=p4_rtk(dewarp=text), known=P4_RTK))
    assert "another sub-camera" in evidence.dropped[0].reason


def test_a_design_centre_below_the_frame_is_another_sub_cameras() -> None:
    text = "2019-03-05;3660.5,3655.25,-4.5,1900.0,-0.268,0.112,0.0008,-0.0001,-0.034"
    evidence = evidence_of(Scene(metadata=p4_rtk(dewarp=text), known=P4_RTK))
    reason = next(d.reason for d in evidence.dropped if d.source is Source.DJI_DEWARP)
    assert "the optical centre (2731.5, 3724.0) lies outside the 5472×3648 image" in reason


@pytest.mark.parametrize("factor", [0.75, 1.25])
def test_a_calibration_a_quarter_off_either_way_is_another_cameras(factor: float) -> None:
    text = f"2019-03-05;{3660.5 * factor},{3655.25 * factor},-4.5,22.75,-0.268,0.112,0.0008,-0.0001,-0.034"
    evidence = evidence_of(Scene(metadata=p4_rtk(dewarp=text), known=P4_RTK))
    assert Source.DJI_DEWARP in {dropped.source for dropped in evidence.dropped}


@pytest.mark.parametrize("pair", ["0,3655.25", "3660.5,0"])
def test_one_focal_length_of_zero_is_enough_to_distrust_dewarp_data(pair: str) -> None:
    text = f"2019-03-05;{pair},-4.5,22.75,-0.268,0.112,0.0008,-0.0001,-0.034"
    evidence = evidence_of(Scene(metadata=p4_rtk(dewarp=text), known=P4_RTK))
    reason = next(d.reason for d in evidence.dropped if d.source is Source.DJI_DEWARP)
    assert "contains zeros" in reason


def test_orientation_is_not_applied_and_said_so() -> None:
    metadata = replace(micasense("1449.36"), orientation=3)
    evidence = evidence_of(Scene(metadata=metadata))
    calibration = evidence.calibration(camera_key(metadata))
    assert calibration is not None
    assert "Orientation is 3" in calibration.notes[0]


def test_dewarp_flag_1_without_dewarp_data_still_says_that_there_is_no_distortion() -> None:
    metadata = replace(p4_rtk(), xmp=xmp("drone-dji", DewarpFlag="1"))
    calibration = evidence_of(Scene(metadata=metadata, known=P4_RTK)).calibration(camera_key(metadata))
    assert calibration is not None
    assert calibration.distortion == NoDistortion()
