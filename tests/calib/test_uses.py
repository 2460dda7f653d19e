"""What a calibration is good for: where corners prove it, and each use by the policy's limits."""

from __future__ import annotations

import numpy as np
import pytest

from calibrary.calib.budget import Part
from calibrary.calib.estimation import estimate
from calibrary.calib.geometry import near_corners, proven
from calibrary.calib.projection_difference import Uncertainty, pixel_grid
from calibrary.calib.verdict import AskedUse
from calibrary.jobs.use import allowed
from calibrary.policy import FLEET
from calibrary.quality import ImageCircle
from calibrary.records import replace
from calibrary.validation import Use

from .faults import rolling
from .solving import SIZE, Session, camera, shoot

GRID = pixel_grid((1600, 1200), (27, 21))
KNOWN = Uncertainty(pixels=GRID, std_px=np.full(GRID.shape[:2], 0.2))
EVERYWHERE = GRID.reshape(-1, 2)


def test_what_no_corner_is_near_is_not_proven_however_small_sigma_is() -> None:
    left = EVERYWHERE[EVERYWHERE[:, 0] < 800]
    found = proven(KNOWN, left, (1600, 1200), limit_px=0.5)
    assert found is not None
    assert 0.5 <= found.share < 0.6
    assert (found.sigma_px, found.edge_px) == (0.2, 0.2)


def test_what_is_known_too_badly_is_not_proven_however_many_corners_are_there() -> None:
    away = np.linalg.norm(GRID - (800, 600), axis=-1)
    rising = Uncertainty(pixels=GRID, std_px=away / 1000)
    found = proven(rising, EVERYWHERE, (1600, 1200), limit_px=0.5)
    assert found is not None
    assert found.radius_px == pytest.approx(500, abs=70)
    assert found.share == pytest.approx(np.pi * 500**2 / (1600 * 1200), abs=0.05)
    assert found.edge_px == pytest.approx(1.0)


def test_in_a_circular_image_the_black_corners_need_no_proof() -> None:
    circle = ImageCircle(x=800.0, y=600.0, radius=600.0)
    inside = EVERYWHERE[np.linalg.norm(EVERYWHERE - (800, 600), axis=1) < 600]
    wild = Uncertainty(
        pixels=GRID, std_px=np.where(np.linalg.norm(GRID - (800, 600), axis=-1) > 600, 90.0, 0.2)
    )
    found = proven(wild, inside, (1600, 1200), limit_px=0.5, circle=circle)
    assert found is not None
    assert (found.share, found.edge_px, found.circle_px) == (1.0, 0.2, 600.0)


def test_no_sigma_proves_nothing() -> None:
    none = Uncertainty(pixels=GRID, std_px=np.full(GRID.shape[:2], np.nan))
    assert proven(none, EVERYWHERE, (1600, 1200), limit_px=0.5) is None


def test_a_corner_proves_its_surroundings_only() -> None:
    near = near_corners(
        np.array([[100.0, 100.0], [160.0, 100.0], [200.0, 100.0]]), np.array([[100.0, 100.0]]), SIZE
    )
    assert near.tolist() == [True, True, False]


def test_a_careful_set_may_be_kept_fixed_and_the_record_says_where_it_is_proven() -> None:
    result = estimate(shoot(how=Session(views=25, sigma_px=0.1)))
    fixed = result.uses.of(AskedUse.FIXED)
    assert result.uses.sigma_px is not None
    assert result.uses.position_cm == pytest.approx(
        100 * FLEET.flying_height_m * result.uses.sigma_px / result.calibration.intrinsics.fx
    )
    assert [one.use for one in result.uses.checks if one.holds] == [
        AskedUse.FIXED,
        AskedUse.MAP,
        AskedUse.START,
    ]
    assert f"within {result.uses.radius_px:.0f} px of the middle" in fixed.why
    assert 0.5 < result.uses.share < 0.9
    assert result.uses.height_cm == pytest.approx(1e4 * result.evidence.sigma_focal)
    given = allowed(result.calibration, FLEET)
    assert given.use is Use.FIXED
    assert "of the frame" in given.why
    # Where it is not proven the record does not say that it is.
    assert result.uses.edge_px is not None
    assert result.uses.edge_px > 1.0


def test_the_limits_are_those_of_the_policy() -> None:
    seen = shoot(how=Session(views=25, sigma_px=0.1))
    strict, loose = (
        replace(FLEET, name="strict", fixed_share=0.95),
        replace(FLEET, name="loose", metrology_sigma_px=0.5, metrology_sigma_focal=0.001),
    )
    assert estimate(seen, policy=strict).uses.of(AskedUse.FIXED).against == ("unproven-region",)
    assert estimate(seen, policy=loose).uses.of(AskedUse.METROLOGY).holds
    judged = estimate(seen).calibration
    assert allowed(judged, strict).use is Use.START


def test_a_rolling_shutter_is_a_start_and_names_what_is_against_more() -> None:
    result = estimate(rolling())
    assert result.verdict is Use.START
    assert "unstable" in result.uses.of(AskedUse.FIXED).against
    assert result.uses.of(AskedUse.START).holds
    assert allowed(result.calibration, FLEET).use is Use.START


def test_a_crop_does_not_say_where_it_is_proven_and_a_smaller_image_does() -> None:
    quality = estimate(shoot(seen_by=camera(), how=Session(views=25))).calibration
    small = quality.scaled((960, 720)).quality
    assert small is not None
    assert small.proven is not None
    assert quality.quality is not None
    assert quality.quality.proven is not None
    assert small.proven.radius_px == pytest.approx(quality.quality.proven.radius_px / 2)
    cropped = quality.cropped((100, 100, 800, 600)).quality
    assert cropped is not None
    assert cropped.proven is None


def test_a_set_too_loose_for_heights_may_be_kept_fixed_in_maps_placed_by_gnss_alone() -> None:
    """Only the limit of the focal length differs."""
    seen = shoot(how=Session(views=10, sigma_px=0.25))
    strict = replace(FLEET, name="strict", fixed_sigma_focal=0.0004)
    loose = estimate(seen, policy=strict).uses
    assert loose.of(AskedUse.FIXED).against == ("uncertain-focal-length",)
    assert loose.of(AskedUse.MAP).holds
    stricter = estimate(seen, policy=replace(strict, name="stricter", map_sigma_focal=0.0005)).uses
    assert stricter.of(AskedUse.MAP).against == ("above 0.05% of f",)


def test_views_without_halves_count_as_those_of_other_sets_do() -> None:
    """Five views have no κ: their σ has the factor that real sets have in the mean, not one."""
    five = estimate(shoot(how=Session(views=5))).evidence
    assert five.kappa2 is None
    six = estimate(shoot(how=Session(views=6))).evidence
    assert six.kappa2 is not None
    assert five.budget.parts[Part.NOISE] > 1.5 * six.budget.parts[Part.NOISE] / six.budget.kappa
