"""Initial relative poses of a rig's cameras: robust estimates from all shots of each pair.

The poses of one board in two cameras give their relative pose. The relative pose of each shot is tested in all shots:
it predicts the corners in the other camera. The one with the smallest median residual is used, so nearly half of the
shots may be wrong (least median of squares; P. Rousseeuw, 1984).

If none fits, other pairings of the shots are tried: one image later, in reverse, mirrored.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from enum import StrEnum
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import BoolArray, FloatArray, IntArray
from calibrary.calib.board import Board, Pattern
from calibrary.calib.lens_models import Solvable
from calibrary.calib.observations import View
from calibrary.calib.rig.lens import Place
from calibrary.calib.rig.observations import RigObservations
from calibrary.calib.solve import Solution

MOST_CANDIDATES: Final = 40
NEAR: Final = 0.02
"""Largest median residual relative to the image's width with which the shots agree on one relative pose."""
CLEARLY: Final = 0.2
"""Another pairing is reported if its median residual is less than this share of the given one's."""
MOST_SHIFT: Final = 3
LEAST_NOISE_PX: Final = 1e-4
HALF_TURN: Final = np.diag([-1.0, -1.0, 1.0])
MIRRORED_X, MIRRORED_Y = np.diag([-1.0, 1.0, 1.0]), np.diag([1.0, -1.0, 1.0])


class Mispairing(StrEnum):
    """Kinds of wrong pairing of images."""

    SHIFTED = "shifted-pairing"
    REVERSED = "reversed-pairing"
    MIRRORED = "mirrored-camera"


class Eye(Struct, frozen=True, kw_only=True, eq=False):
    """Solution of a single camera.

    Attributes:
        model: lens model.
        parameters: lens parameters.
        poses: (rotation, translation in mm) of the board by view, for the used views.
        kept: which corners of each view are used.
        noise_px: standard deviation of one coordinate, px.
    """

    model: Solvable
    parameters: FloatArray
    poses: dict[int, tuple[FloatArray, FloatArray]]
    kept: list[BoolArray]
    noise_px: float


def eye_of(solution: Solution, views: Sequence[View]) -> Eye:
    """Return a camera's own solution in the form for the rig; its rows are the views."""
    network, state = solution.adjusted.network, solution.state
    return Eye(
        model=state.model,
        parameters=state.parameters,
        poses={
            row: (state.rotations[row], state.translations[row])
            for row in np.flatnonzero(network.used).tolist()
        },
        kept=[mask[: len(view.ids)] for mask, view in zip(network.seen, views, strict=True)],
        noise_px=float(max(np.sqrt(solution.adjusted.variance), LEAST_NOISE_PX)),
    )


class Link(Struct, frozen=True, kw_only=True, eq=False):
    """Two cameras with common shots.

    Attributes:
        camera, other: indices of the cameras; the other is closer to the reference.
        shots: (n,) common shots.
        place: pose of the camera relative to the other; None if the shots do not agree on one.
        miss_px: (n,) residual in px of each shot in the other camera, with that pose.
        width: width of the other camera's image, px.
        mispairing: another pairing with which they would agree, and its shift in shots.
    """

    camera: int
    other: int
    shots: IntArray
    place: Place | None
    miss_px: FloatArray
    width: int
    mispairing: tuple[Mispairing, int] | None = None


def links(seen: RigObservations, eyes: Sequence[Eye]) -> list[Link]:
    """Return links that connect all cameras to the reference, each by the most common shots, nearest first."""
    count = len(eyes)
    both = [[_shared(seen, eyes, a, b) for b in range(count)] for a in range(count)]
    tied, found = [0], []
    while len(tied) < count:
        pairs = [(len(both[a][b]), -a, -b) for a in tied for b in range(count) if b not in tied]
        shots, a, b = max(pairs)
        if not shots:
            break
        tied.append(-b)
        found.append(_link(seen, eyes, -b, -a, both[-a][-b]))
    return found


def turns(seen: RigObservations, eyes: Sequence[Eye], link: Link) -> list[int]:
    """Return the views of the link's camera with corners counted from the other end of the board than in the other one.

    Some boards look the same after half a turn, see :func:`_is_ambiguous`.
    """
    board = seen.cameras[seen.names[0]].board
    if not (isinstance(board, Board) and _is_ambiguous(board)):
        return []
    pairing = Pairing(seen, eyes, link.camera, link.other, link.shots, link.shots)
    _, plain = pairing.place(pairing.poses)
    # The mean, since only a few shots may be counted from the other end.
    best: tuple[float, list[int]] = (float(np.minimum(plain, link.width).mean()), [])
    for candidate in _some(pairing.poses):
        place = Place.between(candidate[1], candidate[0])
        misses = [pairing.miss(place, pairing.poses), pairing.miss(place, pairing.with_half_turn())]
        chosen = float(np.minimum(np.minimum(*misses), link.width).mean())
        if chosen < CLEARLY * best[0]:
            views = seen.rows[link.shots[misses[1] < misses[0]], link.camera]
            best = (chosen, views.tolist())
    return best[1]


def _is_ambiguous(board: Board) -> bool:
    """Return whether the print looks the same after half a turn; markers never do."""
    across, down = board.lattice
    if board.pattern is Pattern.CHECKERBOARD:
        return across % 2 == down % 2
    # Every other row of asymmetric circles is shifted: the first and the last row change places if they differ in this.
    return board.pattern is Pattern.CIRCLES or (board.pattern is Pattern.ASYMMETRIC_CIRCLES and down % 2 == 0)


def _shared(seen: RigObservations, eyes: Sequence[Eye], a: int, b: int) -> IntArray:
    """Return the shots for which both cameras have a pose."""
    return np.array(
        [
            row
            for row, views in enumerate(seen.rows)
            if a != b and views[a] in eyes[a].poses and views[b] in eyes[b].poses
        ],
        dtype=np.intp,
    )


def _link(seen: RigObservations, eyes: Sequence[Eye], camera: int, other: int, shots: IntArray) -> Link:
    pairing = Pairing(seen, eyes, camera, other, shots, shots)
    place, miss = pairing.place(pairing.poses)
    width = seen.cameras[seen.names[other]].image_size[0]
    median = float(np.median(miss))
    own = eyes[other].noise_px
    mispairing = None
    if median > max(10 * own, 2.0):
        tried = [(float(np.median(one)), kind, by) for kind, by, one in _otherwise(seen, eyes, camera, other)]
        least, kind, by = min(tried, default=(np.inf, Mispairing.SHIFTED, 0), key=lambda one: one[0])
        if least < CLEARLY * median and least < NEAR * width:
            mispairing = (kind, by)
    agree = median < NEAR * width and mispairing is None
    return Link(
        camera=camera,
        other=other,
        shots=shots,
        place=place.inverse if agree else None,
        miss_px=miss,
        width=width,
        mispairing=mispairing,
    )


def _otherwise(
    seen: RigObservations, eyes: Sequence[Eye], camera: int, other: int
) -> Iterator[tuple[Mispairing, int, FloatArray]]:
    """Yield (kind of error, shift in shots, residuals) for each alternative pairing of two cameras' shots."""
    mine, theirs = (
        np.array([r for r, v in enumerate(seen.rows[:, c]) if v in eyes[c].poses]) for c in (camera, other)
    )
    total = len(seen.shots)
    for by in (*range(-MOST_SHIFT, 0), *range(1, MOST_SHIFT + 1)):
        pairs = [(row, row + by) for row in mine.tolist() if row + by in set(theirs.tolist())]
        if len(pairs) >= 3:
            a, b = np.array(pairs).T
            pairing = Pairing(seen, eyes, camera, other, a, b)
            yield Mispairing.SHIFTED, by, pairing.place(pairing.poses)[1]
    pairs = [(row, total - 1 - row) for row in mine.tolist() if total - 1 - row in set(theirs.tolist())]
    if len(pairs) >= 3:
        a, b = np.array(pairs).T
        pairing = Pairing(seen, eyes, camera, other, a, b)
        yield Mispairing.REVERSED, 0, pairing.place(pairing.poses)[1]
    both = _shared(seen, eyes, camera, other)
    pairing = Pairing(seen, eyes, camera, other, both, both)
    for board in (MIRRORED_X, MIRRORED_Y):
        flipped = [
            ((MIRRORED_X @ R @ board, MIRRORED_X @ t), reference) for (R, t), reference in pairing.poses
        ]
        yield Mispairing.MIRRORED, 0, pairing.place(flipped)[1]


_Poses = list[tuple[tuple[FloatArray, FloatArray], tuple[FloatArray, FloatArray]]]


def _some(poses: _Poses) -> _Poses:
    """Return a subset of poses, large enough to contain a correct one."""
    at = np.unique(np.linspace(0, len(poses) - 1, min(len(poses), MOST_CANDIDATES)).astype(np.intp))
    return [poses[index] for index in at]


class Pairing:
    """The poses of the board in two cameras, and the corners seen by the other camera."""

    def __init__(
        self,
        seen: RigObservations,
        eyes: Sequence[Eye],
        camera: int,
        other: int,
        mine: IntArray,
        theirs: IntArray,
    ) -> None:
        views = seen.rows[theirs, other]
        self.poses: _Poses = [
            (eyes[camera].poses[own], eyes[other].poses[its])
            for own, its in zip(seen.rows[mine, camera].tolist(), views.tolist(), strict=True)
        ]
        self._eye, observed = eyes[other], seen.cameras[seen.names[other]]
        board = observed.board.points - observed.board.points.mean(axis=0)
        given = [observed.views[view] for view in views]
        self._points = [board[view.ids] for view in given]
        self._pixels = [view.image_points for view in given]
        self._kept = [self._eye.kept[view] for view in views]

    @property
    def places(self) -> list[Place]:
        """The other camera's pose relative to the first, from each shot."""
        return [Place.between(second, first) for first, second in self.poses]

    def place(self, poses: _Poses) -> tuple[Place, FloatArray]:
        """Return the relative pose that most shots agree on, and the residual of each shot, (n,) px."""
        tried = []
        for first, second in _some(poses):
            place = Place.between(second, first)
            tried.append((place, self.miss(place, poses)))
        return min(tried, key=lambda one: float(np.median(one[1])))

    def miss(self, place: Place, poses: _Poses) -> FloatArray:
        """Return the RMS residual of each shot, (n,) px, from the first camera's poses to the other's corners."""
        found = []
        for ((R, t), _), points, pixels, kept in zip(
            poses, self._points, self._pixels, self._kept, strict=True
        ):
            inside = (points @ R.T + t) @ place.rotation.T + place.translation
            faces = self._eye.model.faces(self._eye.parameters, inside)
            if not faces.all():
                found.append(np.inf)
                continue
            off = self._eye.model.project(self._eye.parameters, inside)[0] - pixels
            found.append(float(np.sqrt((off[kept] ** 2).sum(axis=1).mean())))
        return np.array(found)

    def with_half_turn(self) -> _Poses:
        """The poses of the first camera with its corners counted from the other end of the board."""
        return [((R @ HALF_TURN, t), reference) for (R, t), reference in self.poses]
