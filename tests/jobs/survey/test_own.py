"""The rules on a K that images state themselves, by what else is stated of them."""

from __future__ import annotations

from typing import Any

import pytest

from calibrary.calibration import Grade
from calibrary.evidence.metadata import FocalPlaneUnit, ImageMetadata
from calibrary.jobs.extract.cameras import ASSUMED, Camera, Sensor
from calibrary.jobs.survey.own import RULES
from calibrary.policy import FLEET, SOURCE, Policy
from calibrary.records import replace
from calibrary.validation import EDITED, SENSOR_STATED, Severity, Verdict, lacks_confirmation
from tests.evidence.scenes import p4_rtk
from tests.house.project import ROOT
from tests.jobs.extract.fleet import judged

DEWARP = "2019-03-05;{fx},{fx},-4.5,22.75,-0.1,0.02,0.0008,-0.0001,0"
GIVEN = Sensor(size_mm=(23.7, 15.8), given=True)


def image(**tags: Any) -> ImageMetadata:
    """An image of a camera that nobody knows."""
    all_tags: dict[str, Any] = {
        "size": (3000, 2000),
        "make": "Example",
        "model": "One",
        "has_exif": True,
    } | tags
    return ImageMetadata(**all_tags)


def per_mm(value: float) -> dict[str, Any]:
    """FocalPlaneResolution."""
    return {"focal_plane_resolution": (value, value), "focal_plane_unit": FocalPlaneUnit.MILLIMETRE}


def only(metadata: ImageMetadata, policy: Policy = FLEET, sensor: Sensor = ASSUMED) -> Camera:
    [camera] = judged({metadata: ["a.jpg"]}, policy=policy, sensor=sensor)
    return camera


def severity(camera: Camera, rule: str) -> Severity:
    assert camera.report is not None
    found = [one.severity for one in camera.report.findings if one.rule == rule]
    return max(found, key=[*Severity].index, default=Severity.PASS)


@pytest.mark.parametrize(
    ("fx", "found"), [(3560.0, Verdict.VALID), (3540.0, Verdict.REJECTED), (3760.0, Verdict.VALID)]
)
def test_what_the_catalogue_knows_of_a_camera_is_right_to_three_per_cent(fx: float, found: Verdict) -> None:
    camera = only(p4_rtk(dewarp=DEWARP.format(fx=fx)))
    assert camera.calibration is not None
    assert camera.calibration.grade is Grade.CALIBRATED
    assert camera.verdict is found


def test_the_policy_source_holds_every_camera_to_its_band() -> None:
    assert only(p4_rtk(dewarp=DEWARP.format(fx=3660.0)), SOURCE).verdict is Verdict.REJECTED
    assert only(image(focal_mm=12.0, **per_mm(300.0)), SOURCE).verdict is Verdict.VALID  # 1.2 W


def test_a_known_camera_may_have_one_quarrelling_tag() -> None:
    camera = only(replace(p4_rtk(dewarp=DEWARP.format(fx=3660.0)), **per_mm(450.0)))
    assert camera.verdict is Verdict.VALID
    assert severity(camera, "contradicted") is Severity.WARNING


def test_tags_that_contradict_each_other_leave_k_unproven_or_worse_and_warn_under_source() -> None:
    tags = {"focal_mm": 12.0, "focal_35mm": 60.0, **per_mm(300.0)}
    assert severity(only(image(**tags)), "contradicted") is Severity.ERROR
    camera = only(image(**tags), SOURCE)
    assert (camera.verdict, severity(camera, "contradicted")) == (Verdict.VALID, Severity.WARNING)


def test_a_35_mm_equivalent_in_the_place_of_the_focal_length_is_an_error() -> None:
    leaked = only(image(focal_mm=24.0, focal_35mm=24.0, **per_mm(300.0)), SOURCE)
    assert severity(leaked, "no-35mm-leak") is Severity.ERROR
    full_frame = only(image(focal_mm=35.0, focal_35mm=35.0, **per_mm(3000 / 36)), SOURCE)
    assert severity(full_frame, "no-35mm-leak") is Severity.PASS


@pytest.mark.parametrize(
    ("focal_mm", "expected"), [(24.0, Severity.PASS), (60.0, Severity.UNPROVEN), (4000.0, Severity.ERROR)]
)
def test_a_sensor_that_was_given_confirms_a_usual_focal_length_only(
    focal_mm: float, expected: Severity
) -> None:
    camera = only(image(focal_mm=focal_mm), sensor=GIVEN)
    assert severity(camera, "focal-plausibility") is expected


def test_an_assumed_sensor_proves_nothing_and_its_remedy_comes_first() -> None:
    camera = only(image(focal_mm=13.2))
    assert camera.verdict is Verdict.UNPROVEN
    assert (camera.remedy or "").startswith("name the sensor")
    far = only(image(focal_mm=2.0))
    assert (far.verdict, far.calibration, far.no_k and far.no_k.rule) == (
        Verdict.UNPROVEN,
        None,
        "sensor-stated",
    )
    assert (far.remedy or "").startswith("name the sensor")
    assert only(image(focal_mm=13.2), SOURCE).verdict is Verdict.VALID


def test_digital_zoom_beyond_twice_the_agreement_of_tags_contradicts_an_unknown_cameras_k() -> None:
    def zoomed(zoom: float) -> Severity:
        return severity(only(image(focal_mm=12.0, digital_zoom=zoom, **per_mm(300.0))), "digital-zoom")

    assert zoomed(1.09) is Severity.UNPROVEN
    assert zoomed(1.11) is Severity.ERROR
    assert severity(only(replace(p4_rtk(), digital_zoom=1.11)), "digital-zoom") is Severity.UNPROVEN


def test_a_k_of_one_tag_lacks_confirmation_and_says_what_to_do_once() -> None:
    camera = only(image(focal_mm=12.0, **per_mm(300.0)))
    assert camera.report is not None
    [alone] = camera.report.failures
    assert lacks_confirmation(alone)
    assert not lacks_confirmation(replace(alone, severity=Severity.ERROR))
    assert alone.remedy is not None
    assert alone.remedy not in alone.message


def test_every_rule_is_in_the_reference() -> None:
    page = (ROOT / "docs/reference/rules.md").read_text(encoding="utf-8")
    tags = {"focal_mm": 24.0, "focal_35mm": 24.0, "digital_zoom": 2.0, **per_mm(300.0)}
    report = only(image(**tags)).report
    assert report is not None
    # What these tags give no reason to ask of, beside what they do.
    others = {"frame-unknown", SENSOR_STATED, "focal-stated", "camera-stated", EDITED, "distortion-monotonic"}
    rules = {one.rule for one in report.findings} | others
    assert len(rules) == len(RULES)
    assert not [rule for rule in rules if f"| `{rule}`" not in page]
