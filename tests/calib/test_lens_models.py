from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from calibrary.calib.lens_change import RADIAL
from calibrary.calib.lens_models import MODELS, Solvable
from calibrary.calibration import Intrinsics
from calibrary.distortion import BrownConrady, Distortion, DoubleSphere, KannalaBrandt, Rational, Unified
from calibrary.errors import InputError
from tests.house.project import ROOT

from .solving import BROWN, camera

LENSES: dict[Solvable, Distortion] = {
    Solvable.K1K2: BrownConrady(k1=-0.1, k2=0.02, p1=0.0, p2=0.0),
    Solvable.K1K2K3: BrownConrady(k1=-0.1, k2=0.02, p1=0.0, p2=0.0, k3=0.011),
    Solvable.K1K2P1P2: BrownConrady(k1=-0.1, k2=0.02, p1=1e-3, p2=-2e-3),
    Solvable.BROWN: BROWN,
    Solvable.RATIONAL: Rational(k1=0.1, k2=-0.2, p1=1e-3, p2=-2e-3, k3=0.03, k4=0.05, k5=-0.1, k6=0.01),
    Solvable.FISHEYE: KannalaBrandt(k1=0.05, k2=-0.02, k3=0.004, k4=-0.001),
    Solvable.DOUBLE_SPHERE: DoubleSphere(xi=-0.18, alpha=0.59),
    Solvable.MEI: Unified(xi=1.3, k1=-0.2, k2=0.03, p1=1e-3, p2=-2e-3),
}


def lacking(model: Solvable) -> Iterator[str]:
    """What a model lacks, and where it belongs: the steps are in the docstring of ``calib/lens_models.py``."""
    if model not in MODELS:
        yield "a row in MODELS of calib/lens_models.py"
    elif model.is_omnidirectional and model not in RADIAL:
        yield "a row in RADIAL of calib/lens_change.py"
    if model not in LENSES:
        yield f"a lens in LENSES of {Path(__file__).name}"
    if f"`{model}`" not in (ROOT / "docs/calibration.md").read_text(encoding="utf-8"):
        yield "its name in docs/calibration.md"


def test_no_model_lacks_a_part() -> None:
    found = [f"{model} lacks {part}" for model in Solvable for part in lacking(model)]
    assert not found, "\n".join(found)


def _points() -> np.ndarray:
    points = np.random.default_rng(3).normal(0, 0.35, (60, 3))
    points[:, 2] = 1.0
    points[0] = (0.0, 0.0, 1.0)
    return points


@pytest.mark.parametrize("model", list(Solvable))
def test_a_model_projects_as_its_distortion_does(model: Solvable) -> None:
    truth = camera(distortion=LENSES[model])
    parameters = model.values(truth.intrinsics, truth.distortion)
    pixels, _, _ = model.project(parameters, _points())
    np.testing.assert_allclose(pixels, truth.project(_points()), atol=1e-9)


@pytest.mark.parametrize("model", list(Solvable))
def test_derivatives_are_those_of_the_projection(model: Solvable) -> None:
    truth = camera(distortion=LENSES[model])
    parameters, points, h = model.values(truth.intrinsics, truth.distortion), _points(), 1e-6
    _, by_parameter, by_point = model.project(parameters, points)
    for index, step in enumerate(h * np.eye(len(parameters))):
        numeric = (
            model.project(parameters + step, points)[0] - model.project(parameters - step, points)[0]
        ) / (2 * h)
        np.testing.assert_allclose(by_parameter[..., index], numeric, atol=2e-5)
    for index, step in enumerate(h * np.eye(3)):
        numeric = (
            model.project(parameters, points + step)[0] - model.project(parameters, points - step)[0]
        ) / (2 * h)
        np.testing.assert_allclose(by_point[..., index], numeric, atol=2e-5)


@pytest.mark.parametrize("model", list(Solvable))
def test_parameters_come_back_as_the_lens_they_were_taken_from(model: Solvable) -> None:
    truth = camera(distortion=LENSES[model])
    values = dict(zip(model.parameters, model.values(truth.intrinsics, truth.distortion), strict=True))
    assert model.distortion(values) == LENSES[model]
    assert model.intrinsics(values, truth.intrinsics.image_size) == truth.intrinsics


@pytest.mark.parametrize("model", [model for model in Solvable if model.is_omnidirectional])
def test_what_lies_beside_and_behind_the_camera_is_projected_too(model: Solvable) -> None:
    truth = camera(distortion=LENSES[model])
    angles, turns = np.radians([80.0, 90.0, 100.0, 105.0]), np.array([0.3, 1.9, 3.6, 5.5])
    rays = np.column_stack([np.sin(angles) * np.cos(turns), np.sin(angles) * np.sin(turns), np.cos(angles)])
    pixels, _, by_point = model.project(model.values(truth.intrinsics, truth.distortion), rays)
    np.testing.assert_allclose(pixels, truth.project(rays), atol=1e-9)
    # Only the direction counts.
    np.testing.assert_allclose(np.einsum("nij,nj->ni", by_point, rays), 0.0, atol=1e-9)


def test_a_lens_the_model_cannot_hold_is_refused() -> None:
    K = Intrinsics(fx=900, fy=900, cx=500, cy=400, image_size=(1000, 800))
    for model, lens in (
        (Solvable.K1K2, BROWN),
        (Solvable.BROWN, LENSES[Solvable.FISHEYE]),
        (Solvable.MEI, BROWN),
    ):
        with pytest.raises(InputError, match="cannot hold"):
            model.values(K, lens)
