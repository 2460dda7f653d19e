"""A smooth field of residuals: what a lens departs from its model by is found and stated; what moves is not."""

from __future__ import annotations

import numpy as np
import pytest

from calibrary.arrays import FloatArray
from calibrary.calib.estimation import estimate
from calibrary.calib.observations import Observations
from calibrary.calib.result import CalibrationResult
from calibrary.distortion import Rational
from calibrary.records import replace
from calibrary.validation import Severity

from .faults import rolling
from .solving import Session, camera, shoot

AT = np.array([500.0, 700.0])


def bulged(px: float) -> Observations:
    """A lens that departs from Brown's model around one place."""
    seen = shoot(how=Session(views=25))
    views = []
    for view in seen.views:
        near = np.exp(-((view.image_points - AT) ** 2).sum(axis=1) / (2 * 170.0**2))
        views.append(replace(view, image_points=view.image_points + near[:, None] * (px, 0.0)))
    return replace(seen, views=tuple(views))


def sigma_at(result: CalibrationResult, at: FloatArray) -> float:
    stated = result.uncertainty
    assert stated is not None
    place = np.linalg.norm(stated.pixels - at, axis=-1)
    return float(stated.std_px.ravel()[int(np.argmin(place))])


def test_a_departure_of_the_lens_is_found_named_and_in_sigma_where_it_lies() -> None:
    result, clean = estimate(bulged(0.4)), estimate(bulged(0.0))
    found = result.evidence.departure
    assert found is not None
    assert found.is_of_lens
    assert (found.x, found.y) == pytest.approx(AT.tolist(), abs=150)
    assert 0.15 < found.px < 0.5
    assert sigma_at(result, AT) > found.px / 2
    assert sigma_at(clean, AT) < 0.1
    told = next(one for one in result.findings if one.rule == "lens-departs")
    assert "the lens departs from its model by up to 0." in told.message
    assert "in the left part of the frame" in told.message


def test_what_the_field_explains_is_no_reason_not_to_keep_k_fixed() -> None:
    result = estimate(bulged(0.4))
    assert (result.evidence.kappa2 or 0) > 2
    unstable = next(one for one in result.findings if one.rule == "unstable")
    assert unstable.severity is Severity.NOTE


def test_noise_is_no_departure() -> None:
    assert estimate(bulged(0.0)).evidence.departure is None


def test_motion_is_not_taken_for_the_lens() -> None:
    result = estimate(rolling())
    found = result.evidence.departure
    assert found is None or not found.is_of_lens
    assert "lens-departs" not in result.rules


def test_sigma_of_the_parameters_contains_what_they_have_absorbed_of_the_field() -> None:
    found, clean = (estimate(bulged(px)).calibration for px in (0.4, 0.0))
    assert found.quality is not None
    assert found.quality.covariance is not None
    assert clean.quality is not None
    off = abs(found.intrinsics.cx - camera().intrinsics.cx)
    # What the noise alone states: the bulge moves cx by six times that.
    assert off > 5 * clean.quality.std["cx"]
    assert off < 1.5 * found.quality.std["cx"] * np.sqrt(found.quality.inflation)
    assert found.quality.std == found.quality.covariance.std


@pytest.mark.thorough
def test_without_any_sigma_over_the_frame_there_is_no_field_and_the_verdict_says_so() -> None:
    terms = {"k1": 1.2, "k2": 0.25, "p1": 2e-4, "p2": -2e-4, "k3": 0.005, "k4": 1.55, "k5": 0.5, "k6": 0.03}
    lens = camera(fx=1000.0, fy=1000.0, distortion=Rational(**terms))
    result = estimate(shoot(lens, Session(views=20), 12))
    assert result.uncertainty is None or not np.isfinite(result.uncertainty.std_px).any()
    assert result.evidence.departure is None
    assert "unknown-uncertainty" in result.rules
