"""Where the cameras of a rig are, to begin with: what most shots say of each pair, whatever the others say.

A pose of the board before one camera and the same shot's pose before another give their relative pose. Each shot's is
compared with all shots: it says where the other camera should have seen their corners. The one whose median miss is
smallest is taken, so nearly half of the shots may be wrong (least median of squares; P. Rousseeuw, 1984).

Where none fits, the shots are paired otherwise: one frame later, in reverse, mirrored.
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

__all__ = ["Eye", "Link", "Mispairing", "Pairing", "eye_of", "links", "turns"]

MOST_CANDIDATES: Final = 40
NEAR: Final = 0.02
"""A median miss of this part of the frame's width: the shots agree on one relative pose, as well as rough poses can."""
CLEARLY: Final = 0.2
"""Another pairing is named where its median miss is this part of the given one's."""
MOST_SHIFT: Final = 3
LEAST_NOISE_PX: Final = 1e-4
HALF_TURN: Final = np.diag([-1.0, -1.0, 1.0])
MIRRORED_X, MIRRORED_Y = np.diag([-1.0, 1.0, 1.0]), np.diag([1.0, -1.0, 1.0])


class Mispairing(StrEnum):
    """How frames may have been paired wrongly."""

    SHIFTED = "shifted-pairing"
    REVERSED = "reversed-pairing"
    MIRRORED = "mirrored-camera"


class Eye(Struct, frozen=True, kw_only=True, eq=False):
    """One camera as it was solved alone.

    Attributes:
        model: of its lens.
        parameters: of its lens.
        poses: (rotation, translation in mm) of the board, by view; only of views that count.
        kept: which corners of each view count.
        noise_px: of one coordinate.
    """

    model: Solvable
    parameters: FloatArray
    poses: dict[int, tuple[FloatArray, FloatArray]]
    kept: list[BoolArray]
    noise_px: float


def eye_of(solution: Solution, views: Sequence[View]) -> Eye:
    """What a camera's own solution gives to the rig's; its rows are the views."""
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
    """Two cameras that saw the board in the same shots.

    Attributes:
        camera, other: indices; the other is nearer to the reference.
        shots: (n,) that both saw.
        place: the camera's before the other; None where the shots do not agree on one.
        miss_px: (n,) by how much each shot misses the corners of the other camera, by that place.
        width: of the other camera's frame, px.
        mispairing: what would make them agree, with the shift of the shots.
    """

    camera: int
    other: int
    shots: IntArray
    place: Place | None
    miss_px: FloatArray
    width: int
    mispairing: tuple[Mispairing, int] | None = None


def links(seen: RigObservations, eyes: Sequence[Eye]) -> list[Link]:
    """A link for each camera that shots tie to the reference, over as many shots as there are; nearest first."""
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
    """The link's camera's views whose corners are counted from the other end of the board than the other camera's.

    A board with as many rows as columns, both odd or both even, looks the same after half a turn.
    """
    board = seen.cameras[seen.names[0]].board
    if not (isinstance(board, Board) and _is_ambiguous(board)):
        return []
    pairing = Pairing(seen, eyes, link.camera, link.other, link.shots, link.shots)
    _, plain = pairing.place(pairing.poses)
    # The mean, for the shots that are counted from the other end may be few.
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
    across, down = board.lattice
    return board.pattern is Pattern.CIRCLES or (
        board.pattern is Pattern.CHECKERBOARD and across % 2 == down % 2
    )


def _shared(seen: RigObservations, eyes: Sequence[Eye], a: int, b: int) -> IntArray:
    """The shots in which two cameras have a pose."""
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
    """(what is wrong, by how many shots, misses) for each other way to pair two cameras' shots."""
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
    """No more than are needed to find one that is right."""
    at = np.unique(np.linspace(0, len(poses) - 1, min(len(poses), MOST_CANDIDATES)).astype(np.intp))
    return [poses[index] for index in at]


class Pairing:
    """Two cameras' poses of the board, and the corners that the other camera saw."""

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
    def stated(self) -> list[Place]:
        """The other camera's place before the first, as each shot states it."""
        return [Place.between(second, first) for first, second in self.poses]

    def place(self, poses: _Poses) -> tuple[Place, FloatArray]:
        """The other camera's place before the first by which most shots agree, and (n,) px by which each misses."""
        tried = []
        for first, second in _some(poses):
            place = Place.between(second, first)
            tried.append((place, self.miss(place, poses)))
        return min(tried, key=lambda one: float(np.median(one[1])))

    def miss(self, place: Place, poses: _Poses) -> FloatArray:
        """(n,) px, root mean square, from the first camera's poses through ``place`` to the other's corners."""
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
