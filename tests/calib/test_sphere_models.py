"""Mei's model and the double sphere as models to solve for: 150°, 190° and 220° cameras of known truth."""

from __future__ import annotations

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from calibrary.calib.assessment import MAP_SHAPE
from calibrary.calib.estimation import estimate
from calibrary.calib.lens_change import as_model
from calibrary.calib.lens_models import Solvable
from calibrary.calib.network import State
from calibrary.calib.projection_difference import projection_difference
from calibrary.calib.result import CalibrationResult
from calibrary.calibration import Calibration, Covariance
from calibrary.distortion import DoubleSphere, KannalaBrandt, Unified
from calibrary.parsers import read, write
from calibrary.validation import Use
from tests.thorough import every

from .solving import SIZE, Session, camera, shoot

LENSES = {
    Solvable.MEI: Unified(xi=1.2, k1=-0.08, k2=0.01, p1=2e-4, p2=-3e-4),
    Solvable.DOUBLE_SPHERE: DoubleSphere(xi=-0.2, alpha=0.6),
    Solvable.FISHEYE: KannalaBrandt(k1=0.02, k2=-0.01, k3=0.001, k4=0.0),
}
FIELDS = (150, 190, 220)


def _camera(model: Solvable, field_deg: float) -> Calibration:
    """Seeing so much across the frame's width."""
    half, lens = math.radians(field_deg) / 2, LENSES[model]
    radius = float(lens.distort_rays(np.array([[math.sin(half), 0.0, math.cos(half)]]))[0, 0])
    focal = SIZE[0] / 2 / radius
    return camera(fx=focal, fy=0.999 * focal, distortion=lens)


@cache
def _solved(of: Solvable, field_deg: float, by: str) -> CalibrationResult:
    return estimate(shoot(_camera(of, field_deg), Session(views=20, fill=(0.25, 0.6))), by)


def _worst_z(result: CalibrationResult, truth: Calibration) -> float:
    quality = result.calibration.quality
    assert quality is not None
    assert quality.covariance is not None
    stated = Covariance.from_matrix(quality.covariance.names, quality.covariance.matrix * quality.inflation)
    exact = Covariance.from_matrix(("fx",), [[0.0]])
    seen = projection_difference(result.calibration, truth, shape=MAP_SHAPE, covariances=(stated, exact))
    assert seen.std_px is not None
    return float(np.nanmax(seen.lengths_px / np.hypot(seen.std_px, 0.01)))


@pytest.mark.parametrize("field_deg", every(3, FIELDS))
@pytest.mark.parametrize("model", [Solvable.MEI, Solvable.DOUBLE_SPHERE])
def test_the_camera_is_found_within_what_is_stated(model: Solvable, field_deg: float) -> None:
    truth, result = _camera(model, field_deg), _solved(model, field_deg, model.value)
    assert result.model is model
    assert result.verdict is Use.FIXED
    assert result.evidence.rms_px < 0.075
    assert _worst_z(result, truth) < 3
    focal, _ = model.axial_focal({"fx": truth.intrinsics.fx, "xi": LENSES[model].coefficients["xi"]})
    assert result.evidence.fx == pytest.approx(focal, rel=5e-4)


@pytest.mark.thorough
@pytest.mark.parametrize("field_deg", [FIELDS[0], FIELDS[-1]])
def test_a_decentred_fisheye_is_given_to_mei_and_a_centred_one_is_not(field_deg: float) -> None:
    mei = _solved(Solvable.MEI, field_deg, "auto")
    assert mei.model is Solvable.MEI
    assert _worst_z(mei, _camera(Solvable.MEI, field_deg)) < 3
    polynomial = _solved(Solvable.FISHEYE, field_deg, "auto")
    assert polynomial.model is Solvable.FISHEYE
    assert {one.model for one in polynomial.candidates}.isdisjoint({Solvable.MEI, Solvable.DOUBLE_SPHERE})


def test_below_65_degrees_off_the_axis_k_stays_that_of_a_pinhole() -> None:
    result = _solved(Solvable.MEI, 95, "auto")
    assert {one.model for one in result.candidates} <= {Solvable.BROWN, Solvable.RATIONAL, Solvable.FISHEYE}


def test_a_fisheye_polynomial_for_a_decentred_lens_does_not_pass() -> None:
    assert _solved(Solvable.MEI, 190, "fisheye").verdict is not Use.FIXED


def test_the_condition_of_terms_that_stand_in_for_one_another_is_no_finding() -> None:
    result = _solved(Solvable.MEI, 150, "mei")
    assert result.evidence.condition > 1e5
    assert {"undetermined", "uncertain-focal-length"}.isdisjoint(result.rules)


@pytest.mark.parametrize("model", [Solvable.MEI, Solvable.DOUBLE_SPHERE])
def test_kalibr_takes_what_was_found(model: Solvable, tmp_path: Path) -> None:
    found = _solved(model, 190, model.value).calibration
    path = tmp_path / "camchain.yaml"
    write([found], path, "kalibr")
    (back,) = read(path)
    assert back.distortion == found.distortion
    assert back.intrinsics.fx == pytest.approx(found.intrinsics.fx, rel=1e-12)


@pytest.mark.parametrize("model", [model for model in Solvable if model.is_omnidirectional])
@pytest.mark.parametrize("other", [model for model in Solvable if model.is_omnidirectional])
def test_a_search_in_another_model_begins_near_the_same_camera(model: Solvable, other: Solvable) -> None:
    truth = _camera(model, 190)
    state = State(
        model=model,
        parameters=model.values(truth.intrinsics, truth.distortion),
        warp=np.zeros(2),
        rotations=np.eye(3)[None],
        translations=np.zeros((1, 3)),
    )
    begun = as_model(state, other, math.radians(95))
    angles = np.radians(np.arange(2.0, 95.0, 3.0))
    rays = np.column_stack([np.sin(angles), 0 * angles, np.cos(angles)])
    apart = other.project(begun.parameters, rays)[0] - truth.project(rays)
    # Decentering is left to the adjustment.
    assert float(np.abs(apart).max()) < 12
