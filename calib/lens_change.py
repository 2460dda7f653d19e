"""Conversion of a camera to another lens model, as a starting point for its adjustment."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import product
from typing import Final, TypeAlias

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.adjustment import Adjusted
from calibrary.calib.lens_models import Solvable
from calibrary.calib.network import State
from calibrary.records import replace

USUAL_ANGLE: Final = math.radians(60)
SAMPLES: Final = 40
XI_OF_MEI: Final = np.linspace(0.2, 2.6, 25)
XI_OF_SPHERES: Final = np.linspace(-0.6, 0.8, 29)
ALPHA_OF_SPHERES: Final = np.linspace(0.3, 0.8, 26)


def widest_angle(adjusted: Adjusted) -> float:
    """Return the largest angle of a corner from the axis, rad."""
    state, network = adjusted.state, adjusted.network
    inside = network.points @ state.rotations.transpose(0, 2, 1) + state.translations[:, None, :]
    angle = np.arctan2(np.hypot(inside[..., 0], inside[..., 1]), inside[..., 2])
    return float(angle[network.seen].max())


def as_model(state: State, model: Solvable, widest: float = USUAL_ANGLE) -> State:
    """Return the same camera in another lens model, approximately.

    Args:
        state: the camera.
        model: the other model.
        widest: largest angle from the axis in rad up to which an omnidirectional model is fitted.
    """
    if state.model is model:
        return state
    if state.model.is_omnidirectional and model.is_omnidirectional:
        return replace(state, model=model, parameters=_radially(state, model, widest))
    if model.is_omnidirectional and model is not Solvable.FISHEYE:
        return as_model(as_model(state, Solvable.FISHEYE), model, widest)
    if state.model.is_omnidirectional and model is Solvable.RATIONAL and widest < math.pi / 2:
        return replace(state, model=model, parameters=_rationally(state, widest))
    if state.model.is_omnidirectional and state.model is not Solvable.FISHEYE:
        return as_model(as_model(state, Solvable.FISHEYE, widest), model)
    values = dict(zip(state.model.parameters, state.parameters.tolist(), strict=True))
    if state.model is Solvable.RATIONAL:
        # Power series of the quotient.
        k1 = values["k1"] - values["k4"]
        k2 = values["k2"] - values["k5"] - values["k4"] * k1
        k3 = values["k3"] - values["k6"] - values["k5"] * k1 - values["k4"] * k2
        values |= {"k1": k1, "k2": k2, "k3": k3}
    if state.model.is_omnidirectional is not model.is_omnidirectional:
        values |= _across(values, to_fisheye=model is Solvable.FISHEYE)
    return replace(
        state, model=model, parameters=np.array([values.get(name, 0.0) for name in model.parameters])
    )


def _across(values: Mapping[str, float], *, to_fisheye: bool) -> dict[str, float]:
    """Convert the first radial term between tan θ and θ; the adjustment finds the other terms.

    tan θ = θ + θ³/3 + …, so a perspective r·(1 + k1·r²) is θ·(1 + (k1 + 1/3)·θ²) near the axis.
    """
    zero = dict.fromkeys(("k2", "k3", "k4", "k5", "k6", "p1", "p2"), 0.0)
    return {"k1": values["k1"] + (1 / 3 if to_fisheye else -1 / 3), **zero}


def _radially(state: State, model: Solvable, widest: float) -> FloatArray:
    """Fit a radial model to the image radius of the other one up to the widest angle.

    The models are linear in the focal length and in the products of it with the coefficients; the parameters of the
    spheres are searched for on a grid.
    """
    theta, wanted = _curve(state, widest)
    sine, cosine = np.sin(theta), np.cos(theta)
    best: tuple[float, FloatArray, tuple[float, ...]] | None = None
    shapes, basis_of = RADIAL[model]
    for shape in shapes:
        basis = basis_of(theta, sine, cosine, shape)
        if not np.isfinite(basis).all():
            continue
        factors, *_ = np.linalg.lstsq(basis, wanted, rcond=None)
        left = float(((basis @ factors - wanted) ** 2).sum())
        if factors[0] > 0 and (best is None or left < best[0]):
            best = left, np.asarray(factors, dtype=np.float64), shape
    if best is None:
        return np.concatenate([state.parameters[:4], np.zeros(len(model.coefficients))])
    _, factors, shape = best
    radial = (factors[1:] / factors[0]).tolist()
    coefficients = [*shape, *radial]
    coefficients += [0.0] * (len(model.coefficients) - len(coefficients))
    return np.concatenate([state.parameters[:2] * factors[0], state.parameters[2:4], coefficients])


def _rationally(state: State, widest: float) -> FloatArray:
    """Fit the rational model to the image radius of another one; linear after multiplication by the denominator."""
    theta, wanted = _curve(state, widest)
    r = np.tan(theta)
    above = np.stack([r**power for power in (1, 3, 5, 7)], axis=1)
    below = np.stack([-wanted * r**power for power in (2, 4, 6)], axis=1)
    both = np.concatenate([above, below], axis=1)
    scale = np.linalg.norm(both, axis=0)
    factors = np.linalg.lstsq(both / scale, wanted, rcond=None)[0] / scale
    (k1, k2, k3), (k4, k5, k6) = factors[1:4] / factors[0], factors[4:]
    return np.concatenate(
        [state.parameters[:2] * factors[0], state.parameters[2:4], [k1, k2, 0.0, 0.0, k3, k4, k5, k6]]
    )


def _curve(state: State, widest: float) -> tuple[FloatArray, FloatArray]:
    """Return angles in rad, and the image radii there in units of fx; the two focal lengths are taken as equal."""
    theta = np.linspace(0, widest, SAMPLES + 1)[1:]
    rays = np.column_stack([np.sin(theta), 0 * theta, np.cos(theta)])
    pixels = state.model.project(state.parameters, rays)[0]
    return theta, (pixels[:, 0] - state.parameters[2]) / state.parameters[0]


Shape: TypeAlias = tuple[float, ...]
Basis: TypeAlias = Callable[[FloatArray, FloatArray, FloatArray, Shape], FloatArray]


def _fisheye_basis(theta: FloatArray, _sine: FloatArray, _cosine: FloatArray, _shape: Shape) -> FloatArray:
    return np.stack([theta**power for power in (1, 3, 5, 7, 9)], axis=1)


def _mei_basis(_theta: FloatArray, sine: FloatArray, cosine: FloatArray, shape: Shape) -> FloatArray:
    (xi,) = shape
    divisor = cosine + xi
    u = np.where((divisor > 0) & (1 + xi * cosine > 0), sine / np.maximum(divisor, 1e-12), np.nan)
    return np.stack([u, u**3, u**5], axis=1)


def _double_sphere_basis(
    _theta: FloatArray, sine: FloatArray, cosine: FloatArray, shape: Shape
) -> FloatArray:
    xi, alpha = shape
    depth = xi + cosine
    d2 = np.hypot(sine, depth)
    divisor = alpha * d2 + (1 - alpha) * depth
    seen = (divisor > 0) & (1 + xi * cosine > 0) & ((1 - alpha) * d2 + alpha * depth > 0)
    return np.where(seen, sine / np.maximum(divisor, 1e-12), np.nan)[:, None]


RADIAL: Final[Mapping[Solvable, tuple[Sequence[Shape], Basis]]] = {
    Solvable.FISHEYE: ([()], _fisheye_basis),
    Solvable.MEI: ([(xi,) for xi in XI_OF_MEI.tolist()], _mei_basis),
    Solvable.DOUBLE_SPHERE: (
        [*product(XI_OF_SPHERES.tolist(), ALPHA_OF_SPHERES.tolist())],
        _double_sphere_basis,
    ),
}
"""The radial part of each omnidirectional model: values of its first coefficients that are tried, and a function to the
(N, k) factors of the focal length and of its products with the next coefficients, NaN where a ray is not seen."""
