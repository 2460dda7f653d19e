"""The K of a camera is one that an image carries, and the others must agree with it."""

from __future__ import annotations

import pytest

from calibrary.calibration import Grade
from calibrary.evidence.metadata import FocalPlaneUnit, ImageMetadata
from calibrary.jobs.extract.cameras import Camera
from calibrary.policy import FLEET, SOURCE, Policy
from calibrary.records import replace
from calibrary.validation import Finding, Severity, Verdict
from tests.evidence.scenes import p4_rtk, xmp
from tests.jobs.extract.fleet import judged


def unit(fx: float) -> ImageMetadata:
    """A Phantom 4 RTK whose tag says this focal length."""
    return p4_rtk(dewarp=f"2019-03-05;{fx},{fx},-4.5,22.75,-0.268,0.112,0.0008,-0.0001,-0.034")


def fx_of(camera: Camera) -> float:
    assert camera.calibration is not None
    return camera.calibration.intrinsics.fx


def spread_of(camera: Camera) -> Finding:
    assert camera.report is not None
    return next(f for f in camera.report.findings if f.rule == "one-k-per-camera")


def test_k_is_the_commonest_one_and_no_average() -> None:
    [camera] = judged({unit(3660.5): ["a", "b"], unit(3662.0): ["c"]})
    assert fx_of(camera) == 3660.5
    assert camera.verdict is Verdict.VALID
    assert camera.calibration is not None
    assert camera.calibration.provenance.source == "a"


def test_k_of_a_better_grade_counts_more_than_many_images_of_one_unit() -> None:
    one = replace(unit(3660.5), serial="5f1d0c7a9be24d3c")
    [camera] = judged({replace(one, xmp=()): ["a", "b", "c"], one: ["d"]})
    assert camera.calibration is not None
    assert (camera.calibration.grade, fx_of(camera)) == (Grade.CALIBRATED, 3660.5)
    assert camera.spread == 0.0


PAGE = replace(SOURCE, focal_over_width=(0.5, 1.5))


@pytest.mark.parametrize(
    ("spread", "policy", "verdict"),
    [
        (0.0004, FLEET, Verdict.VALID),
        (0.0006, FLEET, Verdict.UNPROVEN),
        (0.0049, FLEET, Verdict.UNPROVEN),
        (0.0051, FLEET, Verdict.REJECTED),
        (0.0049, PAGE, Verdict.VALID),
        (0.0051, PAGE, Verdict.REJECTED),
    ],
)
def test_a_spread_above_half_a_per_cent_fails(spread: float, verdict: Verdict, policy: Policy) -> None:
    states = {unit(3660.0): ["a", "b"], unit(3660.0 * (1 + spread)): ["c"]}
    [camera] = judged(states, policy=policy)
    assert camera.verdict is verdict
    assert spread_of(camera).measured == pytest.approx(spread)


def test_the_spread_is_from_end_to_end_and_not_from_k() -> None:
    [camera] = judged({unit(3660.0): ["a", "b"], unit(3649.0): ["c"], unit(3671.0): ["d"]})
    assert camera.spread == pytest.approx(22 / 3660)
    assert spread_of(camera).severity is Severity.ERROR


@pytest.mark.parametrize("place", [2, 3])
def test_a_principal_point_that_moves_spreads_as_a_focal_length_does(place: int) -> None:
    numbers = ["3660", "3660", "-4.5", "22.75"]
    moved = [*numbers[:place], f"{float(numbers[place]) + 22}", *numbers[place + 1 :]]
    states = {
        p4_rtk(dewarp=f"2019-03-05;{','.join(tag)},-0.268,0.112,0.0008,-0.0001,-0.034"): [name]
        for name, tag in (("a", numbers), ("b", moved))
    }
    [camera] = judged(states)
    assert camera.spread == pytest.approx(22 / 3660)
    assert spread_of(camera).severity is Severity.ERROR


def test_a_state_without_calibration_tags_counts_where_its_focal_length_is_another_cameras() -> None:
    def stripped(per_mm: float) -> ImageMetadata:
        return ImageMetadata(
            size=(5472, 3648),
            make="Example",
            model="Survey One",
            focal_mm=8.8,
            focal_plane_resolution=(per_mm, per_mm),
            focal_plane_unit=FocalPlaneUnit.MILLIMETRE,
            serial="5f1d0c7a9be24d3c",
            has_exif=True,
        )

    tagged = replace(
        stripped(415.9), xmp=xmp("Camera", ModelType="perspective", PerspectiveFocalLength="3660.0")
    )
    [same] = judged({tagged: ["a", "b"], stripped(416.5): ["c"]})
    assert same.spread == 0.0
    [other] = judged({tagged: ["a", "b"], stripped(500.0): ["c"]})
    assert other.spread == pytest.approx((8.8 * 500 - 3660) / 3660)
    assert spread_of(other).severity is Severity.ERROR


def test_a_failed_spread_says_what_happened_and_what_to_do() -> None:
    [camera] = judged({unit(3660.0): ["a"], unit(3700.0): ["b"]})
    assert camera.reason is not None
    assert "1.09%" in camera.reason
    assert camera.remedy is not None
    assert "folder" in camera.remedy


def test_one_state_has_no_spread() -> None:
    [camera] = judged({unit(3660.0): ["a", "b"]})
    assert camera.spread is None
    assert camera.report is not None
    assert all(finding.rule != "one-k-per-camera" for finding in camera.report.findings)
