"""Every rule of a policy, its two sides, and the verdict they add up to."""

from __future__ import annotations

import pytest

from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.distortion import BrownConrady
from calibrary.errors import InputError
from calibrary.policy import FLEET, SOURCE, Policy
from calibrary.records import replace
from calibrary.validation import Report, Severity, Verdict, group_spread, validate

W, H = 5472, 3648


def calibration(fx: float = 5000.0, fy: float | None = None, **over: float) -> Calibration:
    numbers = {"cx": W / 2, "cy": H / 2, **over}
    return Calibration(
        camera=CameraKey(image_size=(W, H)),
        intrinsics=Intrinsics(fx=fx, fy=fx if fy is None else fy, image_size=(W, H), **numbers),
        grade=Grade.DERIVED,
        provenance=Provenance(kind="image-metadata"),
    )


def severity(report: Report, rule: str) -> Severity:
    return max((f.severity for f in report.findings if f.rule == rule), key=list(Severity).index)


def test_a_k_inside_every_limit_is_valid() -> None:
    report = validate(calibration(), FLEET)
    assert report.verdict is Verdict.VALID


def test_every_rule_is_measured_even_after_one_has_failed() -> None:
    report = validate(calibration(fx=100.0, fy=5000.0, cx=0.0), FLEET)
    failed = {f.rule for f in report.findings if f.severity is Severity.ERROR}
    assert {"focal-symmetry", "principal-point-drift", "focal-plausibility"} <= failed


LITERAL = {
    "focal_symmetry_max",
    "principal_point_drift_max",
    "focal_over_width",
    "source_agreement",
    "group_spread_max",
    "drift_significance",
    "drift_focal",
    "drift_rms_px",
    "drift_max_px",
    "fixed_sigma_px",
    "fixed_share",
    "fixed_sigma_focal",
    "map_sigma_focal",
    "start_sigma_focal",
    "metrology_sigma_px",
    "metrology_sigma_focal",
    "flying_height_m",
    "maker_sigma_px",
}


def test_a_limit_is_of_the_source_document_or_switched_off_in_its_policy() -> None:
    """A new limit would judge by the policy ``source`` too, whose limits are the document's to the letter."""
    shared = {name for name in Policy.__struct_fields__ if getattr(FLEET, name) == getattr(SOURCE, name)}
    assert shared == LITERAL


@pytest.mark.parametrize("policy", [FLEET, SOURCE])
def test_fifteen_per_cent_between_the_focal_lengths_is_the_errors_line(policy: Policy) -> None:
    assert (
        severity(validate(calibration(5000.0, 5000.0 * 0.851), policy), "focal-symmetry")
        is not Severity.ERROR
    )
    assert severity(validate(calibration(5000.0, 5000.0 * 0.849), policy), "focal-symmetry") is Severity.ERROR


def test_two_per_cent_between_the_focal_lengths_is_unproven_under_fleet_only() -> None:
    camera = calibration(5000.0, 5000.0 * 0.97)
    assert severity(validate(camera, FLEET), "focal-symmetry") is Severity.UNPROVEN
    assert severity(validate(camera, SOURCE), "focal-symmetry") is Severity.PASS


@pytest.mark.parametrize(("share", "expected"), [(0.0499, Severity.PASS), (0.0501, Severity.ERROR)])
def test_the_principal_point_may_drift_by_five_per_cent(share: float, expected: Severity) -> None:
    report = validate(calibration(cy=H / 2 + share * H), FLEET)
    assert severity(report, "principal-point-drift") is expected


@pytest.mark.parametrize("policy", [FLEET, SOURCE])
@pytest.mark.parametrize(("over_width", "ok"), [(0.79, False), (0.8, True), (1.5, True), (1.51, False)])
def test_an_unknown_camera_is_held_to_the_band(policy: Policy, *, over_width: float, ok: bool) -> None:
    report = validate(calibration(over_width * W), policy)
    assert (severity(report, "focal-plausibility") is Severity.PASS) is ok


def test_skew_is_an_error_under_source_and_a_trace_of_it_is_not_under_fleet() -> None:
    camera = calibration(skew=0.4)
    assert severity(validate(camera, SOURCE), "zero-skew") is Severity.ERROR
    assert severity(validate(camera, FLEET), "zero-skew") is Severity.PASS
    assert severity(validate(calibration(skew=40.0), FLEET), "zero-skew") is Severity.ERROR


def test_distortion_that_folds_before_the_corner_is_an_error() -> None:
    folded = replace(calibration(3657.0), distortion=BrownConrady(k1=-0.6, k2=0.0, p1=0.0, p2=0.0))
    assert severity(validate(folded, FLEET), "distortion-monotonic") is Severity.ERROR
    sound = replace(calibration(), distortion=BrownConrady(k1=-0.1, k2=0.0, p1=0.0, p2=0.0))
    assert severity(validate(sound, FLEET), "distortion-monotonic") is Severity.PASS


def test_half_a_per_cent_between_images_of_one_camera_is_the_line() -> None:
    assert group_spread(0.004, FLEET).severity is Severity.PASS
    assert group_spread(0.006, FLEET).severity is Severity.ERROR


def test_a_measured_calibration_of_an_unknown_camera_is_held_to_what_a_lens_can_be() -> None:
    measured = replace(calibration(3657.0), provenance=Provenance(kind="matrix-file"), grade=Grade.CALIBRATED)
    assert validate(measured, FLEET).verdict is Verdict.VALID
    assert validate(measured, SOURCE).verdict is Verdict.REJECTED


@pytest.mark.parametrize(
    "over", [{"focal_symmetry_max": 1.5}, {"source_agreement": -0.1}, {"focal_over_width": (1.5, 0.8)}]
)
def test_a_policy_with_a_limit_out_of_range_is_refused(over: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(over))):
        replace(FLEET, **over)
