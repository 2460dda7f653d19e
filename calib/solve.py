"""From corners to a camera: start, reject outliers, choose the model, fit the board's warp, and start over if need be.

Outliers are judged by the camera, and the camera by what is left: the two are repeated, from all corners every
time, until nothing changes. Otherwise a model too simple at first would cost the corners at the frame's edge,
which are the ones that show that it is too simple.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.calib.adjustment import Adjusted, adjust
from calibrary.calib.geometry import duplicates
from calibrary.calib.lens_change import as_model, widest_angle
from calibrary.calib.lens_models import Solvable
from calibrary.calib.model_choice import FISHEYE_FROM_RAD, SPHERES, Candidate, WarpTest, best_model, warp_test
from calibrary.calib.network import Network, State, linearise
from calibrary.calib.rejection import Gate, screened
from calibrary.calib.start import start
from calibrary.calibration import ImageSize, Intrinsics
from calibrary.errors import CalibrationError
from calibrary.records import replace

__all__ = ["Solution", "choices", "solve"]


ROUNDS: Final = 4
FEWEST_POSES: Final = 3
"""Each pose of a plane gives two equations for K's four numbers; two can do it only where nothing else is unknown."""
ALL: Final = (
    Solvable.BROWN,
    Solvable.FISHEYE,
    Solvable.RATIONAL,
    Solvable.DOUBLE_SPHERE,
    Solvable.MEI,
)
"""To choose from. Nothing leaner than full Brown: of a coefficient too small to be seen its standard deviation says so,
and one that is set to zero for being small moves fx and the frame's edge by up to 11 σ of what is then stated."""
PERSPECTIVE: Final = tuple(model for model in ALL if not model.is_omnidirectional)
POLYNOMIAL: Final = tuple(model for model in ALL if model not in SPHERES)
SPHERES_FROM_RAD: Final = math.radians(65)
"""Up to here a model whose fx is a pinhole's serves all programs; the sphere models' fx is (1 + ξ) times that."""
POOR_START_PX: Final = 2.0
"""A perspective start that misses by more than this may be no perspective camera at all: a fisheye is tried."""


class Solution(Struct, frozen=True, kw_only=True, eq=False):
    """The camera that was found, and what was tried on the way.

    Attributes:
        adjusted: the minimum; its network says which corners counted.
        everything: all corners of the views that took part; those that repeat another take none.
        repeats: (view, the earlier view that shows the same pose).
        warp: None for points on no board, or where the warp was not asked for.
        candidates: the models that were compared.
        is_lifted: whether the points of both networks stand where the board is bent to, not in its plane.
    """

    adjusted: Adjusted
    everything: Network
    repeats: tuple[tuple[int, int], ...]
    warp: WarpTest | None
    candidates: tuple[Candidate, ...]
    is_lifted: bool = False

    @property
    def state(self) -> State:
        """Lens, warp and poses."""
        return self.adjusted.state

    @property
    def is_warped(self) -> bool:
        """Whether the board's warp is part of the solution."""
        return _is_bent(self.adjusted)

    def at_its_pose(self, row: int) -> Adjusted:
        """One view alone before the solution's camera, with the residuals of all of its corners.

        Its pose is the one that fits the corners that count best, or all of them where none does.
        """
        rows = np.array([row])
        whole, state = self.everything.views(rows), self.state.views(rows)
        counted = self.adjusted.network.views(rows)
        posed = adjust(counted if counted.seen.any() else whole, state, poses_only=True)
        linear = linearise(whole, posed.state)
        return posed if linear is None else replace(posed, network=whole, linear=linear)


def solve(
    network: Network,
    image_size: ImageSize,
    *,
    model: Solvable | None = None,
    guess: Intrinsics | None = None,
    warp: bool = True,
    gate: Gate | None = None,
) -> Solution:
    """Find the camera.

    Args:
        network: views with at least six corners each that are not on a line.
        image_size: (width, height) px.
        model: the lens model, None to choose by the corners.
        guess: an initial K, such as an ingest gate's seed.
        warp: whether the board may be warped.
        gate: limits for views and corners to be rejected; None for the usual ones.

    Raises:
        CalibrationError: no camera explains the corners, or they do not determine one.
    """
    gate = gate or Gate()
    current = _first(network, image_size, model, guess)
    repeats = duplicates(current, image_size)
    if repeats:
        network = _without([later for later, _ in repeats], network)
        current = adjust(network, current.state)
    current = adjust(network.only(screened(network, current, gate)), current.state)
    tested: WarpTest | None = None
    candidates: tuple[Candidate, ...] = ()
    for _ in range(ROUNDS):
        current, candidates, tested = _chosen(
            current, image_size, choices(current, model), warp=warp and network.is_planar
        )
        seen = screened(network, current, gate)
        if (seen == current.network.seen).all():
            break
        current = adjust(network.only(seen), current.state, warp=_is_bent(current))
    return Solution(adjusted=current, everything=network, repeats=repeats, warp=tested, candidates=candidates)


def choices(current: Adjusted, model: Solvable | None) -> Sequence[Solvable]:
    """The models to choose from for these corners: the one that was asked for, or those that may differ here."""
    if model is not None:
        return (model,)
    widest = widest_angle(current)
    if widest <= FISHEYE_FROM_RAD:
        return PERSPECTIVE
    return ALL if widest > SPHERES_FROM_RAD else POLYNOMIAL


def _first(
    network: Network, image_size: ImageSize, model: Solvable | None, guess: Intrinsics | None
) -> Adjusted:
    """A start in the model that was asked for, or in the kind of model that fits better."""
    first = model or Solvable.BROWN
    try:
        found = start(network, image_size, first, guess)
        if model is not None and model.is_omnidirectional:
            return found
        with suppress(CalibrationError):
            # The richest model that a start can bear separates outliers from a plain lens.
            found = adjust(network, as_model(found.state, Solvable.BROWN if model is None else model))
    except CalibrationError:
        if model is not None:
            raise
        return start(network, image_size, Solvable.FISHEYE, guess)
    if model is None and found.rms_px > POOR_START_PX:
        with suppress(CalibrationError):
            fisheye = start(network, image_size, Solvable.FISHEYE, guess)
            return min(found, fisheye, key=lambda adjusted: adjusted.rss)
    return found


def _chosen(
    current: Adjusted, image_size: ImageSize, models: Sequence[Solvable], *, warp: bool
) -> tuple[Adjusted, tuple[Candidate, ...], WarpTest | None]:
    """Warp, then the model, then the warp by that model: a warped board and a poor model can pass for each other."""
    tested, current = _bent_if_need_be(current) if warp else (None, current)
    current, candidates = best_model(current, image_size, models, warp=_is_bent(current))
    if not warp:
        return current, candidates, None
    was_bent = _is_bent(current)
    tested, current = _bent_if_need_be(current)
    if _is_bent(current) is not was_bent:
        current, candidates = best_model(current, image_size, models, warp=_is_bent(current))
    return current, candidates, tested


def _bent_if_need_be(current: Adjusted) -> tuple[WarpTest | None, Adjusted]:
    try:
        tested, flat, warped = warp_test(current)
    except CalibrationError:
        return None, current
    return tested, warped if tested.keeps_warp else flat


def _is_bent(adjusted: Adjusted) -> bool:
    return len(adjusted.free) > len(adjusted.state.parameters)


def _without(rows: Sequence[int], network: Network) -> Network:
    seen = network.seen.copy()
    seen[list(rows)] = False
    if int(seen.any(axis=1).sum()) < FEWEST_POSES and network.is_planar:
        raise CalibrationError(
            f"{len(seen)} views show the board in {int(seen.any(axis=1).sum())} place(s) only: move and tilt it "
            "between the frames"
        )
    return network.only(seen)
