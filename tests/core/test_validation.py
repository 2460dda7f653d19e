"""Every rule of a policy, its two sides, and the verdict they add up to."""

from __future__ import annotations

import pytest

from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.distortion import BrownConrady
from calibrary.errors import InputError
from calibrary.policy import FLEET, SOURCE, Policy
from calibrary.records import replace
from calibrary.validation import (
    Expected,
    Finding,
    NamedFocal,
    Report,
    Severity,
    ValidationContext,
    Verdict,
    lacks_confirmation,
    validate,
)

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


def test_a_known_camera_is_judged_by_what_is_known_of_it_under_fleet() -> None:
    around = ValidationContext(expected=Expected(fx=3657.0, source="catalogue"))
    assert validate(calibration(3650.0), FLEET, around).verdict is Verdict.VALID
    assert validate(calibration(3650.0), SOURCE, around).verdict is Verdict.REJECTED
    assert validate(calibration(3800.0), FLEET, around).verdict is Verdict.REJECTED


def test_a_known_cameras_own_spread_widens_its_limit() -> None:
    around = ValidationContext(expected=Expected(fx=3657.0, spread=0.06, source="registry"))
    assert validate(calibration(3800.0), FLEET, around).verdict is Verdict.VALID


def test_two_independent_focal_lengths_settle_an_unknown_camera_under_fleet() -> None:
    around = ValidationContext(others=(NamedFocal(name="EXIF FocalLengthIn35mmFilm", fx=3600.0),))
    assert validate(calibration(3650.0), FLEET, around).verdict is Verdict.VALID
    assert validate(calibration(3650.0), SOURCE, around).verdict is Verdict.REJECTED


def test_an_assumed_sensor_is_never_settled_and_never_proven_under_fleet() -> None:
    others = (NamedFocal(name="EXIF FocalLengthIn35mmFilm", fx=5000.0),)
    around = ValidationContext(others=others, sensor_assumed=True)
    assert validate(calibration(), FLEET, around).verdict is Verdict.UNPROVEN
    assert validate(calibration(), SOURCE, around).verdict is Verdict.VALID


def test_an_unknown_camera_is_unproven_while_its_sources_quarrel() -> None:
    around = ValidationContext(others=(NamedFocal(name="EXIF FocalLengthIn35mmFilm", fx=9000.0),))
    assert validate(calibration(), FLEET, around).verdict is Verdict.UNPROVEN


def test_a_known_camera_may_have_one_quarrelling_source() -> None:
    around = ValidationContext(
        expected=Expected(fx=5000.0, source="catalogue"),
        others=(NamedFocal(name="EXIF FocalLength × FocalPlaneResolution", fx=9000.0),),
    )
    report = validate(calibration(), FLEET, around)
    assert report.verdict is Verdict.VALID
    assert severity(report, "source-agreement") is Severity.WARNING


def test_a_35_mm_equivalent_in_the_place_of_the_focal_length_is_an_error() -> None:
    prior = NamedFocal(name="EXIF FocalLengthIn35mmFilm", fx=3648.0, tolerance=1 / 24)
    around = ValidationContext(others=(prior,), focal_mm=24.0, focal_35mm=24.0)
    assert severity(validate(calibration(9949.0), SOURCE, around), "no-35mm-leak") is Severity.ERROR


def test_a_full_frame_cameras_equivalent_is_its_focal_length_and_no_leak() -> None:
    prior = NamedFocal(name="EXIF FocalLengthIn35mmFilm", fx=7966.0, tolerance=1 / 35)
    around = ValidationContext(others=(prior,), focal_mm=35.0, focal_35mm=35.0)
    assert severity(validate(calibration(7986.0), SOURCE, around), "no-35mm-leak") is Severity.PASS


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
    assert validate(calibration(), FLEET, ValidationContext(spread=0.004)).verdict is Verdict.VALID
    assert validate(calibration(), FLEET, ValidationContext(spread=0.006)).verdict is Verdict.REJECTED


def test_digital_zoom_is_unproven_under_fleet() -> None:
    assert validate(calibration(), FLEET, ValidationContext(zoom=2.0)).verdict is Verdict.UNPROVEN


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


def test_a_frame_an_editor_changed_is_unproven_under_fleet() -> None:
    around = ValidationContext(edits=("the image was cropped by an editor",))
    report = validate(calibration(), FLEET, around)
    assert report.verdict is Verdict.UNPROVEN
    assert "original files from the camera" in str(report.remedy)
    assert validate(calibration(), SOURCE, around).verdict is Verdict.VALID


def around(**over: object) -> ValidationContext:
    """A source that says the same as a K of 3000 px, which lies below the band."""
    other = NamedFocal(name="XMP", fx=3010.0)
    return ValidationContext(**{"others": (other,), **over})  # type: ignore[arg-type] # the fields of the record


def test_outside_the_band_only_an_independent_source_settles_a_focal_length() -> None:
    rule, low = "focal-plausibility", calibration(3000.0)
    assert severity(validate(low, FLEET), rule) is Severity.ERROR
    assert severity(validate(low, FLEET, around()), rule) is Severity.PASS
    dependent = NamedFocal(name="XMP", fx=3010.0, independent=False)
    assert severity(validate(low, FLEET, around(others=(dependent,))), rule) is Severity.ERROR
    assumed = validate(low, FLEET, around(sensor_assumed=True))
    assert (severity(assumed, rule), assumed.verdict) == (Severity.PASS, Verdict.UNPROVEN)
    alone = validate(low, FLEET, ValidationContext(sensor_assumed=True))
    assert severity(alone, rule) is Severity.ERROR


@pytest.mark.parametrize(("fx", "found"), [(4849.0, Severity.ERROR), (4851.0, Severity.PASS)])
@pytest.mark.parametrize("mirrored", [False, True])
def test_a_known_camera_may_be_off_by_three_per_cent_either_way(
    fx: float, found: Severity, mirrored: bool
) -> None:
    camera = calibration(10_000 - fx if mirrored else fx)
    known = ValidationContext(expected=Expected(fx=5000.0, source="catalogue"))
    assert severity(validate(camera, FLEET, known), "focal-plausibility") is found


def test_a_sources_own_rounding_excuses_it_and_nothing_excuses_one_that_is_no_number() -> None:
    def quarrels(**other: float) -> bool:
        others = (NamedFocal(name="XMP", **other),)  # type: ignore[arg-type] # the fields of the record
        report = validate(calibration(5000.0), FLEET, ValidationContext(others=others))
        return any(finding.rule == "source-agreement" for finding in report.findings)

    assert quarrels(fx=5400.0)
    assert quarrels(fx=5400.0, tolerance=0.07)
    assert not quarrels(fx=5400.0, tolerance=0.09)
    assert quarrels(fx=float("nan"))


def test_digital_zoom_beyond_twice_the_agreement_of_sources_contradicts_an_unknown_cameras_k() -> None:
    def zoomed(over: float, *, weighed: bool = True) -> Severity:
        around = ValidationContext(zoom=1.0 + over * FLEET.source_agreement, weighed=weighed)
        return severity(validate(calibration(), FLEET, around), "digital-zoom")

    assert zoomed(1.9) is Severity.UNPROVEN
    assert zoomed(2.1) is Severity.ERROR
    assert zoomed(2.1, weighed=False) is Severity.UNPROVEN


@pytest.mark.parametrize(
    ("over_width", "given", "expected"),
    [
        (1.0, True, Severity.PASS),
        (1.0, False, Severity.UNPROVEN),
        (2.0, True, Severity.UNPROVEN),
        (200.0, True, Severity.ERROR),
    ],
)
def test_a_sensor_that_was_given_confirms_a_usual_focal_length_only(
    over_width: float, given: bool, expected: Severity
) -> None:
    around = ValidationContext(weighed=True, sensor_given=given)
    report = validate(calibration(over_width * W), FLEET, around)
    assert severity(report, "focal-plausibility") is expected


def test_a_k_of_one_source_lacks_confirmation_and_another_fault_does_not() -> None:
    report = validate(calibration(), FLEET, ValidationContext(weighed=True))
    [alone] = [finding for finding in report.findings if finding.severity is Severity.UNPROVEN]
    assert lacks_confirmation(alone)
    assert not lacks_confirmation(replace(alone, severity=Severity.ERROR))
    assert not lacks_confirmation(Finding(rule="edited", severity=Severity.UNPROVEN, message="it was edited"))


@pytest.mark.parametrize(("explained", "expected"), [(False, Verdict.UNPROVEN), (True, Verdict.VALID)])
def test_an_equivalent_that_is_not_that_of_the_known_camera_needs_an_explanation(
    explained: bool, expected: Verdict
) -> None:
    """74 mm of a phone that has 28: a telephoto before its lens, or another camera of that name."""
    camera = calibration(5000.0)
    around = ValidationContext(
        expected=Expected(fx=5000.0, source="catalogue"),
        others=(
            NamedFocal(name="EXIF FocalLengthIn35mmFilm", fx=13200.0, tolerance=0.04, is_explained=explained),
        ),
    )
    assert validate(camera, FLEET, around).verdict is expected
    assert validate(camera, SOURCE, around).verdict is Verdict.VALID
