"""A labelled table: the right K of each kind of camera passes, and each way to be wrong that was seen is an error."""

from __future__ import annotations

from typing import Any

import pytest

from calibrary.calibration import CameraKey, Grade
from calibrary.catalogue import load_catalogue
from calibrary.jobs.survey.known import CONTRADICTIONS, contradictions
from calibrary.policy import FLEET
from calibrary.records import replace
from calibrary.registry.entry import Entry, Sensor, Status
from calibrary.registry.entry_checks import check
from calibrary.registry.paths import proposed_name
from calibrary.validation import Severity
from tests.registry.entries import an_entry

P4R = {"focal_mm": 8.8}
P3A: dict[str, Any] = {"model": "FC300S", "focal_mm": 3.61, "size": (4000, 3000)}
M3T: dict[str, Any] = {"model": "M3T", "sub_camera": "wide", "focal_mm": 4.4, "size": (8000, 6000)}
A7R: dict[str, Any] = {"make": "SONY", "model": "ILCE-7RM4", "focal_mm": 35.0, "size": (9504, 6336)}
ODD: dict[str, Any] = {"make": "Made", "model": "Up", "focal_mm": 8.0, "size": (4000, 3000)}
LISTED: dict[str, Any] = {"make": "NIKON", "model": "COOLPIX P900", "focal_mm": 4.3, "size": (4608, 3456)}
"""In no catalogue; the public lists of sensor widths have it."""


def entry(fx: float, camera: dict[str, Any], **fields: Any) -> Entry:
    return an_entry(fx=fx, distortion=None, **{**camera, **fields})


def judged(one: Entry, *others: Entry, former: Entry | None = None) -> list[tuple[str, str]]:
    files = {other.path: other for other in (*others, one)}
    findings = check(files, FLEET, {one.path: former} if former is not None else {}, judge=contradictions)
    return [
        (finding.rule, finding.severity.value)
        for finding in findings
        if finding.place == one.path and finding.rule in CONTRADICTIONS
    ]


RIGHT = {
    "as the catalogue has it": (entry(3661.25, P4R), ()),
    "zoomed by software, which no catalogue knows": (entry(9000.0, P4R, capture_mode="zoom"), ()),
    "the sister's unit, 0.7 % off": (entry(3684.5, P4R), ()),
    "without a focal length in its key": (entry(3661.25, {}), ()),
    "half the size, half the K": (entry(1830.6, P4R, size=(2736, 1824)), ()),
    "the 4:3 crop, 1:1": (entry(3661.25, P4R, size=(4864, 3648)), ()),
    "a film's frame: the whole width": (entry(2570.0, P4R, size=(3840, 2160)), ()),
    "a film's frame: a part of the sensor, 1:1": (entry(3661.25, P4R, size=(3840, 2160)), ()),
    "FC300S": (entry(2344.0, P3A), ()),
    "the wide of several": (entry(0.7 * 8000, M3T), ()),
    "a body with another lens": (entry(35 / 0.00376, A7R), ()),
    "a camera that nothing knows": (entry(3300.0, ODD), ()),
    "a camera of the lists": (entry(4.3 / 6.2 * 4608, LISTED), ()),
    "a unit 2 % from its sister": (entry(3300.0, ODD, serial="aa"), (entry(3366.0, ODD, serial="bb"),)),
    "a part of its sister's frame, 1:1": (
        entry(3300.0, ODD, serial="a", size=(3600, 2700)),
        (entry(3300.0, ODD, serial="b"),),
    ),
    "a sister of another lens": (entry(3300.0, ODD), (entry(9900.0, ODD, lens="long"),)),
    "a relative of another focal length": (entry(3300.0, ODD), (entry(9900.0, {**ODD, "focal_mm": 24.0}),)),
    "one of two that disagree": (
        entry(3300.0, ODD),
        (entry(9900.0, ODD, serial="a"), entry(3310.0, ODD, serial="b")),
    ),
    "beside one that is retired": (
        entry(3300.0, ODD),
        (entry(900.0, ODD, serial="a", status=Status.RETIRED),),
    ),
    "beside one that is only proposed": (
        entry(3300.0, ODD),
        (entry(900.0, ODD, serial="a", status=Status.DRAFT),),
    ),
}


@pytest.mark.parametrize("name", RIGHT)
def test_the_right_k_passes(name: str) -> None:
    one, others = RIGHT[name]
    assert judged(one, *others) == []


WRONG = {
    "10 times, by the catalogue": (entry(36612.5, P4R), (), "against-catalogue"),
    "fx 22 890 for FC300S": (entry(22890.0, P3A), (), "against-catalogue"),
    "in millimetres": (entry(8.8, P4R), (), "admission"),
    "in millimetres, of a camera that nothing knows": (entry(8.0, ODD), (), "admission"),
    "the tele's for the wide": (entry(30_000.0, M3T), (), "against-catalogue"),
    "the 35 mm equivalent for the focal length": (entry(24 / 13.2 * 5472, P4R), (), "against-catalogue"),
    "the equivalent in the key as well": (entry(24 / 13.2 * 5472, {"focal_mm": 24.0}), (), "against-catalogue"),
    "the equivalent, of the listed sensor": (entry(24 / 6.2 * 4608, LISTED), (), "against-sensor"),
    "the equivalent, of the sensor it states": (entry(15000.0, ODD, sensor=Sensor(width_mm=6.4)), (), "against-sensor"),
    "of half the size": (entry(1830.6, P4R), (), "against-catalogue"),
    "of twice the size": (entry(3661.25, P4R, size=(2736, 1824)), (), "against-catalogue"),
    "another model's": (entry(2344.0, P4R), (), "against-catalogue"),
    "10 times, by a sister": (entry(33000.0, ODD, serial="a"), (entry(3300.0, ODD, serial="b"),), "against-relatives"),
    "10 times, by another frame": (
        entry(33000.0, ODD),
        (entry(1650.0, ODD, size=(2000, 1500)),),
        "against-relatives",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", WRONG)
def test_the_wrong_k_is_an_error(name: str) -> None:
    one, others, rule = WRONG[name]
    assert (rule, "error") in judged(one, *others)


def test_a_k_of_another_image_size_shows_in_its_principal_point() -> None:
    one = entry(3300.0, ODD)
    K = replace(one.calibration.intrinsics, cx=1000.0, cy=750.0)
    assert judged(replace(one, calibration=replace(one.calibration, intrinsics=K))) == [
        ("admission", "error")
    ]


class TestWhatWasApprovedBefore:
    @pytest.mark.parametrize(
        ("fx", "expected"),
        [(3320.0, []), (3250.0, []), (3410.0, ["error"]), (33000.0, ["error"])],
        ids=["0.6 %", "-1.5 %", "3.3 %", "10 times"],
    )
    def test_the_same_camera_does_not_change_its_lens(self, fx: float, expected: list[str]) -> None:
        found = judged(entry(fx, ODD), former=entry(3300.0, ODD))
        assert found == [("against-last-approved", severity) for severity in expected]

    def test_its_own_tolerance_is_what_it_is_held_to(self) -> None:
        loose = replace(entry(3300.0, ODD), tolerance=0.05)
        assert judged(entry(3410.0, ODD), former=loose) == []

    def test_a_k_that_the_catalogue_confirms_may_correct_one_that_it_does_not(self) -> None:
        one = entry(2344.5, P3A)
        K = replace(one.calibration.intrinsics, cx=1993.0, cy=1507.0)
        measured = replace(one, calibration=replace(one.calibration, intrinsics=K))
        former = entry(22890.0, P3A)
        assert judged(measured, former=former) == [("against-last-approved", "warning")]
        # One measurement whose focal length was edited is no second witness.
        assert judged(one, former=former) == [("against-last-approved", "error")]

    def test_a_proposal_is_held_against_what_is_in_use(self) -> None:
        used, new = entry(3300.0, ODD), entry(33000.0, ODD, status=Status.DRAFT)
        beside = proposed_name(new.path)
        findings = check({used.path: used, beside: new}, FLEET, judge=contradictions)
        errors = [finding for finding in findings if finding.severity is Severity.ERROR]
        assert [(one.rule, one.place) for one in errors] == [
            ("against-last-approved", used.path),
            ("focal-plausibility", used.path),
        ][: len(errors)]
        assert errors


class TestOverriding:
    def test_a_reason_makes_a_warning_of_it_that_stays(self) -> None:
        one = replace(entry(22890.0, P3A), override="a lens of our own")
        findings = check({one.path: one}, FLEET, judge=contradictions)
        [printed] = [finding for finding in findings if finding.rule == "against-catalogue"]
        assert printed.severity is Severity.WARNING
        assert "used in spite of that: a lens of our own" in printed.message

    def test_what_was_overridden_is_no_measure_of_others(self) -> None:
        odd = replace(entry(33000.0, ODD, serial="aa"), override="a lens of our own")
        assert judged(entry(3300.0, ODD, serial="bb"), odd) == []

    def test_what_is_retired_is_left_in_peace(self) -> None:
        assert judged(entry(22890.0, P3A, status=Status.RETIRED)) == []


def test_every_camera_of_the_catalogue_passes_its_own_numbers() -> None:
    """At its native size and at a half, whatever else shares its Model."""
    looked = 0
    for camera in load_catalogue():
        over_width = camera.fx_over_w_at(camera.focal_mm)
        if over_width is None or camera.native_size is None:
            continue
        for part in (1, 2):
            size = (camera.native_size[0] // part, camera.native_size[1] // part)
            key = CameraKey(
                make=camera.make,
                model=camera.names[0],
                sub_camera=camera.sub_camera,
                lens=camera.lens,
                focal_mm=camera.focal_mm,
                image_size=size,
            )
            one = an_entry(key, fx=over_width * size[0], distortion=None, grade=Grade.DERIVED)
            assert judged(one) == [], camera.title
            ten = an_entry(key, fx=10 * over_width * size[0], distortion=None)
            assert [severity for _, severity in judged(ten)][:1] == ["error"], camera.title
            looked += 1
    assert looked > 100
