"""What a solver may do with a K: by its σ over the frame, or it is a start."""

from __future__ import annotations

import pytest

from calibrary import FLEET, Calibration, CameraKey, Grade, Intrinsics, Provenance, Quality, Verdict
from calibrary.distortion import BrownConrady, NoDistortion
from calibrary.jobs.use import allowed
from calibrary.quality import Covariance
from calibrary.records import replace
from calibrary.validation import Use

LENS = BrownConrady(k1=-0.1, k2=0.02, p1=0.0, p2=0.0, k3=0.0)
MEASURED = Calibration(
    camera=CameraKey(make="Example", model="One", image_size=(4000, 3000)),
    intrinsics=Intrinsics(fx=3000.0, fy=3000.0, cx=2000.0, cy=1500.0, image_size=(4000, 3000)),
    distortion=LENS,
    grade=Grade.CALIBRATED,
    provenance=Provenance(kind="board"),
)


def known_to(std_px: float) -> Calibration:
    """Fx and fy have this standard deviation, together: at the corner, 2500 px from the middle, it is 0.83 of that."""
    std = std_px**2
    covariance = Covariance.from_matrix(("fx", "fy"), [[std, std], [std, std]])
    return replace(MEASURED, quality=Quality(covariance=covariance))


@pytest.mark.parametrize(
    ("calibration", "verdict", "use", "why"),
    [
        (None, Verdict.VALID, Use.NONE, "no valid K"),
        (known_to(0.1), Verdict.UNPROVEN, Use.NONE, "no valid K"),
        (MEASURED, Verdict.VALID, Use.START, "how well is not stated"),
        (replace(MEASURED, distortion=None), Verdict.VALID, Use.START, "the distortion is unknown"),
        (replace(MEASURED, grade=Grade.DERIVED), Verdict.VALID, Use.START, "not measured on this unit"),
        (
            replace(MEASURED, grade=Grade.DERIVED, distortion=NoDistortion()),
            Verdict.VALID,
            Use.START,
            "it has no distortion",
        ),
        (known_to(0.5), Verdict.VALID, Use.FIXED, "px over the frame and 0.02% of f"),
        (
            replace(known_to(0.5), notes=("start: not good enough to be approved", "flat: one height")),
            Verdict.VALID,
            Use.START,
            "its calibration was judged: a start only",
        ),
        (known_to(2.0), Verdict.VALID, Use.START, "to keep it fixed 0.5 px and 0.10% are needed"),
    ],
)
def test_what_may_be_done(calibration: Calibration | None, verdict: Verdict, use: Use, why: str) -> None:
    found = allowed(calibration, FLEET, is_valid=verdict is Verdict.VALID)
    assert (found.use, why in found.why) == (use, True), found.why


def test_a_start_says_how_far_it_may_be_off_and_solvers_get_its_sigma() -> None:
    short = replace(known_to(15.0), notes=("start: not good enough to be kept fixed", "flat: one height"))
    found = allowed(short, FLEET)
    assert found.use is Use.START
    assert found.sigma_focal == pytest.approx(15.0 / 3000.0)
    assert "fx may be off by 1.50% (3 σ)" in found.why


def test_a_start_for_its_sigma_alone_is_judged_by_sigma_under_each_policy() -> None:
    said = (f"start: {Calibration.SHORT}", "uncertain-focal-length: σ is 0.07 %", "unproven-region: 30 %")
    short = replace(known_to(2.0), notes=said)
    wide = replace(FLEET, fixed_sigma_px=3.0)
    assert [allowed(short, one).use for one in (FLEET, wide)] == [Use.START, Use.FIXED]
    further = replace(short, notes=(*said, "stretched-print: squares are longer down"))
    assert allowed(further, wide).use is Use.START


def test_sigma_is_that_of_the_worst_pixel_with_the_camera_free_to_turn() -> None:
    found = allowed(known_to(0.5), FLEET)
    assert found.sigma_focal == pytest.approx(0.5 / 3000.0)
    # Of a pinhole the corner would move by 0.5 · 2500 / 3000 = 0.417 px; barrel distortion and the turn take some.
    assert found.sigma_px == pytest.approx(0.40, abs=0.03)


def test_a_policy_may_grant_a_makers_calibration_an_uncertainty_and_the_reason_says_so() -> None:
    granting = replace(FLEET, name="house", maker_sigma_px=0.3)
    written = replace(MEASURED, provenance=Provenance(kind="image-metadata", tag="drone-dji:DewarpData"))
    assert allowed(written, FLEET).use is Use.START
    found = allowed(written, granting)
    assert (found.use, found.why) == (Use.FIXED, "the policy house grants a maker's calibration 0.3 px")
    of_entry = replace(
        written, provenance=Provenance(kind="registry", tag="image-metadata drone-dji:DewarpData")
    )
    assert allowed(of_entry, granting) == found
    assert allowed(MEASURED, granting).use is Use.START
    assert allowed(written, replace(granting, maker_sigma_px=0.6)).use is Use.START
