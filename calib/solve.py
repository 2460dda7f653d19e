"""Camera solution from corners: start, outlier rejection, choice of the model, board warp, and repetition.

Outliers depend on the camera, and the camera on the remaining corners. So both are repeated from all corners until
nothing changes. Otherwise an initial model that is too simple would reject the corners near the image's edge, which
show that it is too simple.
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
from calibrary.calib.lens_change import widest_angle
from calibrary.calib.lens_models import Solvable
from calibrary.calib.model_choice import FISHEYE_FROM_RAD, Candidate, WarpTest, best_model, with_warp
from calibrary.calib.network import Network, State, linearise
from calibrary.calib.rejection import Gate, screened
from calibrary.calib.start import start
from calibrary.calibration import ImageSize, Intrinsics
from calibrary.errors import CalibrationError
from calibrary.records import replace

ROUNDS: Final = 4
FEWEST_POSES: Final = 3
"""Each pose of a plane gives two equations for the four parameters of K; two suffice only if nothing else is
unknown."""
ALL: Final = (
    Solvable.BROWN,
    Solvable.FISHEYE,
    Solvable.RATIONAL,
    Solvable.DOUBLE_SPHERE,
    Solvable.MEI,
)
"""Models to choose from, none smaller than the full Brown model. A coefficient too small to be significant has a
suitable standard deviation; setting it to zero would move fx and the image's edge by up to 11 stated σ."""
PERSPECTIVE: Final = tuple(model for model in ALL if not model.is_omnidirectional)
POLYNOMIAL: Final = tuple(model for model in ALL if not model.is_sphere)
SPHERES_FROM_RAD: Final = math.radians(65)
"""Up to this angle, models with a pinhole's fx suit all programs; the fx of the sphere models is (1 + ξ) times
that."""
POOR_START_PX: Final = 2.0
"""If a perspective start has larger residuals than this, the camera may be a fisheye, which is then tried."""


class Solution(Struct, frozen=True, kw_only=True, eq=False):
    """Solution of a camera, and what was tried.

    Attributes:
        adjusted: the minimum; its network states which corners were used.
        everything: all corners of the used views; repeated views are excluded.
        repeats: (view, earlier view with the same pose).
        warp: test for a board warp; None for points without a board, or if the warp was not to be estimated.
        candidates: lens models that were compared.
        is_lifted: whether the points of both networks are on the bent board instead of its plane.
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
        """Whether the board warp is part of the solution."""
        return _is_bent(self.adjusted)

    def at_their_poses(self) -> Adjusted:
        """Return all views with the solution's lens, each at its own best pose, with the residuals of all corners.

        The pose is the best one for the used corners of the view, or for all of them if none is used.
        """
        counted, whole = self.adjusted.network, self.everything
        seen = np.where(counted.used[:, None], counted.seen, whole.seen)
        posed = adjust(whole.only(seen), self.state, poses_only=True)
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
    """Solve for the camera.

    Args:
        network: views with at least six corners each that are not collinear.
        image_size: (width, height) px.
        model: lens model; None to choose it by the corners.
        guess: an initial K, such as the seed of a camera check.
        warp: whether the board warp may be estimated.
        gate: limits for rejecting views and corners; None for the defaults.

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
    # A corner that changes sides in each round must not keep this going.
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
    """Return the models to choose from: the requested one, or those that can differ for these corners."""
    if model is not None:
        return (model,)
    widest = widest_angle(current)
    if widest <= FISHEYE_FROM_RAD:
        return PERSPECTIVE
    return ALL if widest > SPHERES_FROM_RAD else POLYNOMIAL


def _first(
    network: Network, image_size: ImageSize, model: Solvable | None, guess: Intrinsics | None
) -> Adjusted:
    """Return a start in the requested model, or in the kind of model that fits better."""
    try:
        # The richest model that a start allows, to separate outliers from the effects of a simple lens.
        found = start(network, image_size, model or Solvable.BROWN, guess)
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
    """Choose warp, model, and warp again: a warped board and an unsuitable model can look alike."""
    tested, current = with_warp(current) if warp else (None, current)
    before = current
    current, candidates = best_model(current, image_size, models, warp=_is_bent(current))
    if not warp:
        return current, candidates, None
    was_bent = _is_bent(current)
    if current.state is not before.state:
        tested, current = with_warp(current)
    if _is_bent(current) is not was_bent:
        current, candidates = best_model(current, image_size, models, warp=_is_bent(current))
    return current, candidates, tested


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
