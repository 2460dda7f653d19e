"""Weighing: what confirms, what contradicts, and which claim is disbelieved by whom."""

from __future__ import annotations

import pytest

from calibrary import FLEET, Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.evidence.metadata import ImageMetadata
from calibrary.jobs.survey import Claim, Survey, Weighed, Who
from calibrary.jobs.survey.limits import NOMINAL, foreign, model_of
from calibrary.records import replace
from calibrary.validation import Severity

SIZE = (4000, 3000)
KEY = CameraKey(make="Example", model="One", focal_mm=24.0, image_size=SIZE)


def stated(
    name: str, fx: float, *, tolerance: float = 0.02, rests_on: str = "", measured: bool = False
) -> Claim:
    calibration = Calibration(
        camera=KEY,
        intrinsics=Intrinsics(fx=fx, fy=fx, cx=2000.0, cy=1500.0, image_size=SIZE),
        grade=Grade.CALIBRATED if measured else Grade.DERIVED,
        provenance=Provenance(kind="test"),
    )
    return Claim(
        who=Who.FILE if measured else Who.TAG,
        name=name,
        calibration=calibration,
        tolerance=0.0 if measured else tolerance,
        engraved=0.0 if measured else NOMINAL,
        is_measured=measured,
        rests_on=frozenset({rests_on or name}),
        voice=name,
    )


FILE = stated("camera.xml", 3000.0, measured=True)


def weigh(claim: Claim, *others: Claim) -> Weighed:
    return Survey(ImageMetadata(size=SIZE), [claim, *others], FLEET).weigh(claim)


def standing(found: Weighed) -> str:
    return "contradicted" if found.believed else "confirmed" if found.confirmed_by else "alone"


@pytest.mark.parametrize(
    ("fx", "expected"),
    [
        (3001.0, "confirmed"),
        (3089.0, "confirmed"),  # 2.97 %
        (3095.0, "alone"),  # 3.2 %: no witness, and no contradiction of a measured K before 5 %
        (3149.0, "alone"),
        (3155.0, "contradicted"),
    ],
)
def test_a_nominal_claim_confirms_within_3_per_cent_and_contradicts_beyond_5(
    fx: float, expected: str
) -> None:
    assert standing(weigh(FILE, stated("list", fx))) == expected


def test_two_nominal_claims_contradict_beyond_both_tolerances() -> None:
    plane = stated("focal plane", 3000.0, tolerance=0.03)
    assert standing(weigh(plane, stated("list", 3105.0, tolerance=0.03))) == "alone"  # 3.5 % of 4.2 %
    assert standing(weigh(plane, stated("list", 3130.0, tolerance=0.03))) == "contradicted"


def test_measured_calibrations_are_compared_in_pixels() -> None:
    found = weigh(FILE, stated("entry", 3003.0, measured=True))  # 0.1 %: 2.5 px at the corner
    [against] = found.believed
    assert "projections differ" in against.message
    assert standing(weigh(FILE, stated("entry", 3000.1, measured=True))) == "confirmed"


def test_a_claim_is_disbelieved_by_the_k_and_an_independent_witness_that_are_named() -> None:
    found = weigh(FILE, stated("list", 2950.0), stated("focal plane", 6000.0))
    assert standing(found) == "confirmed"
    [against] = found.disbelieved
    assert (against.one.claim.name, against.shown_by) == ("focal plane", ("camera.xml", "list"))


def test_a_witness_that_shares_an_input_is_none() -> None:
    found = weigh(
        stated("width by one list", 3000.0, rests_on="lists"),
        stated("width by another", 3000.0, rests_on="lists"),
        stated("focal plane", 6000.0),
    )
    assert standing(found) == "contradicted"


def test_nothing_is_disbelieved_by_which_an_independent_claim_stands() -> None:
    found = weigh(FILE, stated("list", 2950.0), stated("focal plane", 6000.0), stated("equivalent", 6010.0))
    assert found.believed[0].message.startswith("focal plane states fx = 6000.0 px, +100.0%")


@pytest.mark.parametrize(
    ("names", "why"),
    [
        ({"model": "One"}, None),
        ({"model": "Example ONE"}, None),
        ({"model": "One II"}, None),
        ({"model": "OneII"}, "it is of OneII, and these images are of One"),
        ({"model": "Two"}, "it is of Two, and these images are of One"),
        ({"focal_mm": 24.4}, None),
        ({"focal_mm": 35.0}, "it is of a lens at 35 mm, and these images are of 24 mm"),
        ({"serial": "b" * 16}, "it is of the unit bbbbbbbb, and these images are of aaaaaaaa"),
        ({"sub_camera": "tele"}, "it is of the camera tele, and these images are of wide"),
        ({"sub_camera": "blue-444"}, "it is of the camera blue-444, and these images are of wide"),
        ({"sub_camera": "cam0"}, None),
        ({"sub_camera": "dji m3t 640 512 brown 1.1111"}, None),
    ],
)
def test_a_calibration_that_names_another_camera_is_not_of_these_images(
    names: dict[str, str | float], why: str | None
) -> None:
    images = CameraKey(make="Example", model="One", focal_mm=24.0, serial="a" * 16, sub_camera="wide")
    named = Calibration(
        camera=CameraKey(**names),  # type: ignore[arg-type]  # of each kind
        intrinsics=FILE.calibration.intrinsics,
        grade=Grade.CALIBRATED,
        provenance=Provenance(kind="test"),
    )
    assert foreign(named, images) == why


@pytest.mark.parametrize(
    ("name", "model"),
    [
        ("v2 dji fc6310r 5472 3648 brown 0.6666", "v2 dji fc6310r"),
        ("v2 unknown unknown 4000 3000 perspective 0", None),
        ("apple unknown 4032 3024 brown 0.8", None),
    ],
)
def test_opensfms_name_of_a_camera_states_its_model_where_it_knows_one(name: str, model: str | None) -> None:
    named = replace(FILE.calibration, camera=CameraKey(), extras=(("opensfm/camera", name),))
    assert model_of(named) == model


def test_a_measured_k_with_the_very_numbers_of_a_tag_was_computed_until_another_tag_confirms_it() -> None:
    tag = stated("EXIF", 3000.0)
    found = weigh(FILE, tag)
    assert ([one.claim for one in found.copies], found.computed) == ([tag], "EXIF")
    assert [one.rule for one in found.findings if one.severity is Severity.UNPROVEN] == ["computed"]
    assert weigh(FILE, tag, stated("list", 3010.0)).computed is None
    assert standing(weigh(FILE, stated("EXIF", 3000.01))) == "confirmed"
