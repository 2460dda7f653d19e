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
from calibrary.validation import RULES, Finding, Severity, Verdict, validate
from tests.house.project import ROOT

W, H = 5472, 3648
FOLDED = BrownConrady(k1=-0.6, k2=0.0, p1=0.0, p2=0.0)


def calibration(fx: float = 5000.0, fy: float = 5000.0, cx: float = W / 2, skew: float = 0.0) -> Calibration:
    return Calibration(
        camera=CameraKey(image_size=(W, H)),
        intrinsics=Intrinsics(fx=fx, fy=fy, cx=cx, cy=H / 2, skew=skew, image_size=(W, H)),
        grade=Grade.DERIVED,
        provenance=Provenance(kind="image-metadata"),
    )


BROKEN = {
    "focal-symmetry": calibration(fy=4000.0),
    "principal-point-drift": calibration(cx=0.0),
    "focal-plausibility": calibration(1000.0, 1000.0),
    "zero-skew": calibration(skew=50.0),
    "distortion-monotonic": replace(calibration(3657.0, 3657.0), distortion=FOLDED),
}


@pytest.mark.parametrize("rule", BROKEN)
def test_a_broken_rule_says_what_to_do_and_says_it_once(rule: str) -> None:
    findings = [f for f in validate(BROKEN[rule], FLEET).failures if f.rule == rule]
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
        found = {finding.rule for finding in function(BROKEN[rule], FLEET)}
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
    report = validate(calibration(5000.0, 4800.0, cx=0.0), FLEET)
    assert report.remedy == report.failures[0].remedy
    assert [one.rule for one in report.failures] == ["principal-point-drift", "focal-symmetry"]


def test_a_policy_that_knows_no_camera_does_not_send_anybody_to_the_registry() -> None:
    def remedy(finding: Finding) -> str:
        return finding.remedy or ""

    [fleet], [source] = (validate(calibration(1000.0, 1000.0), policy).failures for policy in (FLEET, SOURCE))
    assert "--registry" in remedy(fleet)
    assert "--registry" not in remedy(source)
    assert "--policy fleet" in remedy(source)
