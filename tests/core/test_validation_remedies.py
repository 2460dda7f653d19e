"""Whatever fails a rule says what to do about it, and nothing else does."""

from __future__ import annotations

from collections.abc import Iterator
from inspect import isfunction, signature
from pathlib import Path

import pytest

from calibrary import validation
from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.distortion import BrownConrady
from calibrary.policy import FLEET, SOURCE
from calibrary.records import replace
from calibrary.validation import (
    RULES,
    Expected,
    Finding,
    NamedFocal,
    Severity,
    ValidationContext,
    Verdict,
    validate,
)
from tests.house.project import ROOT

W, H = 5472, 3648
QUIET = ValidationContext()
PRIOR = NamedFocal(name="EXIF FocalLengthIn35mmFilm", fx=3648.0, tolerance=1 / 24)
FOLDED = BrownConrady(k1=-0.6, k2=0.0, p1=0.0, p2=0.0)


def calibration(fx: float = 5000.0, fy: float = 5000.0, cx: float = W / 2, skew: float = 0.0) -> Calibration:
    return Calibration(
        camera=CameraKey(image_size=(W, H)),
        intrinsics=Intrinsics(fx=fx, fy=fy, cx=cx, cy=H / 2, skew=skew, image_size=(W, H)),
        grade=Grade.DERIVED,
        provenance=Provenance(kind="image-metadata"),
    )


BROKEN = {
    "focal-symmetry": (calibration(fy=4000.0), QUIET),
    "principal-point-drift": (calibration(cx=0.0), QUIET),
    "focal-plausibility": (calibration(1000.0, 1000.0), QUIET),
    "zero-skew": (calibration(skew=50.0), QUIET),
    "no-35mm-leak": (
        calibration(9949.0, 9949.0),
        ValidationContext(others=(PRIOR,), focal_mm=24.0, focal_35mm=24.0),
    ),
    "source-agreement": (calibration(), ValidationContext(others=(NamedFocal(name="another", fx=9000.0),))),
    "sensor-stated": (calibration(), ValidationContext(sensor_assumed=True)),
    "focal-stated": (calibration(), ValidationContext(no_focal="EXIF has no FocalLength")),
    "as-recorded": (calibration(), ValidationContext(edits=("the image was cropped by an editor",))),
    "digital-zoom": (calibration(), ValidationContext(zoom=2.0)),
    "distortion-monotonic": (replace(calibration(3657.0, 3657.0), distortion=FOLDED), QUIET),
    "one-k-per-camera": (calibration(), ValidationContext(spread=0.02)),
}


@pytest.mark.parametrize("rule", BROKEN)
def test_a_broken_rule_says_what_to_do_and_says_it_once(rule: str) -> None:
    findings = [f for f in validate(BROKEN[rule][0], FLEET, BROKEN[rule][1]).failures if f.rule == rule]
    assert findings
    for finding in findings:
        assert finding.remedy is not None
        assert finding.remedy not in finding.message
        assert str(finding) == f"{rule}: {finding.message}; {finding.remedy}"


def lacking() -> Iterator[str]:
    """What a rule lacks, and where it belongs: the steps are in the docstring of ``validation.py``."""
    page = (ROOT / "docs/reference/rules.md").read_text(encoding="utf-8")
    for name, function in vars(validation).items():
        is_rule = isfunction(function) and signature(function).return_annotation == "Iterator[Finding]"
        if is_rule and function not in RULES.values():
            yield f"{name} lacks a row in RULES of validation.py"
    for rule, function in RULES.items():
        if f"| `{rule}`" not in page:
            yield f"{rule} lacks a row in docs/reference/rules.md"
        if rule not in BROKEN:
            yield f"{rule} lacks a K that breaks it in BROKEN of {Path(__file__).name}"
            continue
        camera, context = BROKEN[rule]
        found = {finding.rule for finding in function(camera, FLEET, context)}
        if found != {rule}:
            yield f"{function.__name__} has the row {rule} in RULES, and reports {found}"


def test_no_rule_lacks_a_part() -> None:
    assert not list(lacking())


def test_a_rule_that_holds_has_nothing_to_put_right() -> None:
    for finding in validate(calibration(), FLEET).findings:
        assert finding.severity is Severity.PASS
        assert finding.remedy is None
        assert str(finding) == f"{finding.rule}: {finding.message}"


def test_a_valid_k_has_no_remedy() -> None:
    report = validate(calibration(), FLEET)
    assert report.verdict is Verdict.VALID
    assert report.remedy is None


def test_the_first_remedy_is_the_worst_failures() -> None:
    report = validate(calibration(), FLEET, ValidationContext(zoom=2.0, spread=0.02))
    assert report.remedy == report.failures[0].remedy
    assert report.failures[0].rule == "one-k-per-camera"


def test_a_sensor_nobody_stated_is_put_right_before_what_follows_from_it() -> None:
    for policy in (FLEET, SOURCE):
        report = validate(calibration(1000.0, 1000.0), policy, ValidationContext(sensor_assumed=True))
        assert report.failures[0].rule == "focal-plausibility"
        assert report.remedy is not None
        assert report.remedy.startswith("name the sensor")


def test_a_policy_that_knows_no_camera_does_not_send_anybody_to_the_registry() -> None:
    def remedy(finding: Finding) -> str:
        return finding.remedy or ""

    [fleet], [source] = (validate(calibration(1000.0, 1000.0), policy).failures for policy in (FLEET, SOURCE))
    assert "--registry" in remedy(fleet)
    assert "--registry" not in remedy(source)
    assert "--policy fleet" in remedy(source)


def test_a_known_camera_that_is_off_may_be_registered() -> None:
    around = ValidationContext(expected=Expected(fx=3657.0, source="catalogue"))
    report = validate(calibration(3900.0, 3900.0), FLEET, around)
    assert report.remedy is not None
    assert "--registry" in report.remedy
