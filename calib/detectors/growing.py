"""A checkerboard grown from a piece of it: for boards that are cut off, covered in part, or have a hole.

Detectors of whole boards need every corner. Here a saddle point with neighbours on four sides is the seed, and corners
are added one by one next to known ones: predicted from the local shape of the lattice, measured as a saddle point, and
kept if the four quadrants around it alternate as the squares of the board do. OpenCV's sector-based detector also
grows boards (``CALIB_CB_LARGER``) but stops at the first hole; its piece serves as another seed.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from calibrary.arrays import FloatArray
from calibrary.calib.detectors.refinement import enlarged, half_window, reduced, refined
from calibrary.calib.frames import Gray
from calibrary.calib.lattice import Lattice, mirrored

Levels: TypeAlias = NDArray[np.float32]
Place: TypeAlias = tuple[int, int]
"""(row, column), relative to an arbitrary corner."""

SMALLER_SIDE: Final = 640
"""Longer side in px of a second copy in which seeds are searched: it averages out noise that hides them."""
SMALL_SIDE: Final = 800
"""Up to this side in px an image is taken to be thermal: faint and noisy, but cheap to search in several ways."""
ENOUGH = 20
"""A piece with this many corners is accepted without trying other ways."""
SEED: Final = (3, 3)
"""A corner, its four neighbours and the four between them: the smallest piece whose alternation can be checked."""
SADDLE_SIGMAS: Final = (1.5, 3.0)
"""Scales in px: the smaller for small squares, the larger for noisy images."""
FAINTEST_SADDLE = 0.05
"""Smallest strength of a saddle point, relative to the 99.9th percentile over all pixels."""
MOST_SADDLES, TRIED = 1500, 150
"""Saddle points that are kept, and those that are tried as the middle of a seed: a texture has any number of them."""
NEIGHBOURS = 8
"""Nearest saddle points of which four must be the neighbours in the lattice; those on its diagonals are near too."""
OPPOSITE = 0.3
"""Largest difference between the steps to opposite neighbours, as a share of the step."""
LEAST_SINE = 0.25
"""Of the angle between the two directions of a seed; smaller ones are points along one line."""
LEAST_RELIEF = 8.0
"""Gray levels; fainter squares cannot be distinguished from noise."""
MOST_GROWN = 6
"""Largest number of seeds of one copy that are grown."""
_SIGNS: Final = np.array([(1.0, 1.0), (-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0)])
_AROUND: Final = np.array([(0.75, 0.75), (1.25, 0.75), (0.75, 1.25), (1.25, 1.25), (1.0, 1.0)])
REACH = 3
"""Distance in rows and columns up to which known corners predict the next one."""
CURVED_FROM = 9
"""Number of corners from which the six terms of a curved prediction are determined with some to spare."""
LARGEST_SHIFT = 0.35
"""Largest difference between predicted and measured corner, in spacings."""
SMALLEST_SPACING_PX = 6.0
"""Below it the smallest window for measuring a corner reaches more than half way to the next one."""
FAINTEST = 0.35
"""Smallest contrast of the next corner relative to the known ones; shade and blur reduce it."""
UNEVEN, STANDS_OUT = 0.8, 0.35
"""Largest difference of opposite quadrants of a corner, relative to its contrast; and largest excess over that of the
typical corner. On the edge of the board, where one of four quadrants is paper, it is 1 to 2."""
QUADRANTS: Final = (0.32, 0.16)
"""Positions at which a quadrant is sampled, as shares of the steps to the neighbours; the nearer one lies within the
outer squares of a board even if these are cut to a third of their width."""
SURE = 0.7
"""Share of a seed's points that must be corners."""


def grown(gray: Gray, small: Gray, largest: int) -> Lattice | None:
    """Return the largest piece of a checkerboard.

    Args:
        gray: (H, W).
        small: the same image, reduced for detection.
        largest: largest number of corners along a side.

    Returns:
        (rows, columns, 2) px with OpenCV's pixel origin, NaN for corners not found, with rows in the direction of the
        board's as seen from its front; None if no piece is found.
    """
    best: Lattice | None = None
    for look, scale in _looks(gray, small):
        # The sector-based detector takes longest, and finds in the smaller copy what it finds in the larger.
        further = _sector_based(look) if max(look.shape) <= SMALL_SIDE else ()
        for seed in chain(*(_seeds(look, sigma) for sigma in SADDLE_SIGMAS), further):
            lattice = _Growth(look, seed, largest).lattice()
            if lattice is not None and (best is None or _count(lattice) > _count(best)):
                best = enlarged(lattice, scale)
                if _count(best) >= ENOUGH:
                    break
        if best is not None and _count(best) >= ENOUGH:
            break
    if best is None:
        return None
    return best[:, ::-1] if mirrored(best) else best


def _looks(gray: Gray, small: Gray) -> Iterator[tuple[Gray, FloatArray]]:
    """Yield the copies to search, and the scale from each to the full image."""
    import cv2

    if max(gray.shape) > SMALL_SIDE:
        for look in (small, reduced(small, SMALLER_SIDE)[0]):
            yield look, np.array(gray.shape[::-1]) / look.shape[::-1]
        return
    yield gray, np.ones(2)
    soft = _eight_bit(cv2.GaussianBlur(gray, (0, 0), 1.5))
    yield soft, np.ones(2)
    twice = cv2.resize(gray, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    yield _eight_bit(twice), np.full(2, 0.5)
    yield _eight_bit(cv2.GaussianBlur(twice, (0, 0), 2.0)), np.full(2, 0.5)
    evened = cv2.createCLAHE(4.0, (4, 4)).apply(_eight_bit(cv2.GaussianBlur(gray, (0, 0), 1.0)))
    yield _eight_bit(evened), np.ones(2)


def _eight_bit(pixels: object) -> Gray:
    return np.asarray(pixels, dtype=np.uint8)


def _count(lattice: Lattice) -> int:
    return int(np.isfinite(lattice[..., 0]).sum())


def _seeds(gray: Gray, sigma: float) -> Iterator[Lattice]:
    """Yield seeds: saddle points with a neighbour on each of four sides and the corners between, strongest first."""
    peaks = _saddles(gray, sigma)
    if len(peaks) < SEED[0] * SEED[1]:
        return
    # Squares: np.hypot of all pairs would take longer than the rest of the search.
    apart = sum(np.square(np.subtract.outer(axis[:TRIED], axis)) for axis in peaks.T)
    nearest = np.sort(np.argpartition(apart, min(NEIGHBOURS, len(peaks) - 1), axis=1)[:, : 1 + NEIGHBOURS])
    order = np.argsort(np.take_along_axis(apart, nearest, axis=1), axis=1, kind="stable")
    nearest = np.take_along_axis(nearest, order, axis=1)
    steps = peaks[nearest[:, 1:]] - peaks[: len(nearest), None]
    away = np.sqrt(np.take_along_axis(apart, nearest[:, 1:], axis=1))
    opposite = np.hypot(*np.moveaxis(steps[:, :, None] + steps[:, None], 3, 0)) < OPPOSITE * away[:, None]
    # All centres at once, in order; one by one would take 0.1 s.
    middle, one, other = np.nonzero(np.triu(opposite, 1))
    half = (steps[middle, one] - steps[middle, other]) / 2
    # Every two of one middle; these follow one another.
    at = np.arange(len(middle))
    further = np.searchsorted(middle, middle, side="right") - at - 1
    first = np.repeat(at, further)
    second = first + 1 + np.arange(len(first)) - np.repeat(np.cumsum(further) - further, further)
    across, down = half[first], half[second]
    crossed = np.abs(across[:, 0] * down[:, 1] - across[:, 1] * down[:, 0])
    wide = crossed > LEAST_SINE * np.hypot(*across.T) * np.hypot(*down.T)
    middle, across, down = middle[first[wide]], across[wide], down[wide]
    v, u = np.mgrid[-1:2, -1:2][..., None]
    seeds = peaks[middle][:, None, None] + u * across[:, None, None] + v * down[:, None, None]
    good = np.flatnonzero(_alternates(gray.astype(np.float32), seeds, across, down))
    # The centres up to the one that completes the number of seeds.
    last = middle[good[MOST_GROWN - 1]] if len(good) >= MOST_GROWN else len(peaks)
    yield from seeds[good[middle[good] <= last]]


def _alternates(levels: Levels, seeds: FloatArray, across: FloatArray, down: FloatArray) -> NDArray[np.bool_]:
    """Return which of the (N, 3, 3, 2) seeds have alternating dark and light quadrants around their corners."""
    sides = np.stack([across, down], axis=1)
    x, y = np.rint(
        np.moveaxis(seeds[..., None, :] + (QUADRANTS[0] * _SIGNS @ sides)[:, None, None], -1, 0)
    ).astype(np.intp)
    height, width = levels.shape
    inside = ((x >= 0) & (y >= 0) & (x < width) & (y < height)).all(axis=(1, 2, 3))
    a, b, c, d = np.moveaxis(levels[y.clip(0, height - 1), x.clip(0, width - 1)], -1, 0)
    sign = np.where(np.indices(seeds.shape[1:3]).sum(axis=0) % 2, -1, 1)
    relief, uneven = sign * (a + b - c - d) / 2, np.maximum(np.abs(a - b), np.abs(c - d))
    typical = np.median(relief, axis=(1, 2))
    faintest = FAINTEST * np.abs(typical)
    alike = (relief * np.sign(typical)[:, None, None] > faintest[:, None, None]) & (uneven < np.abs(relief))
    alternates: NDArray[np.bool_] = inside & (np.abs(typical) > LEAST_RELIEF)
    alternates &= alike.mean(axis=(1, 2)) >= SURE
    return alternates


def _sector_based(gray: Gray) -> Iterator[Lattice]:
    """Yield the piece that OpenCV's sector-based detector grows."""
    import cv2

    found, corners, meta = cv2.findChessboardCornersSBWithMeta(gray, SEED, cv2.CALIB_CB_LARGER)
    shape = np.shape(meta)[:2]
    if found and len(shape) == 2 and np.size(corners) == 2 * shape[0] * shape[1]:
        yield np.asarray(corners, dtype=np.float64).reshape(*shape, 2)


def _saddles(gray: Gray, sigma: float) -> FloatArray:
    """Return saddle points of the image, (N, 2) px, strongest first."""
    import cv2

    soft = cv2.GaussianBlur(gray.astype(np.float32), (0, 0), sigma)
    xx, yy, xy = (cv2.Sobel(soft, cv2.CV_32F, *order) for order in ((2, 0), (0, 2), (1, 1)))
    # Minus the determinant of the Hessian: positive at saddle points alone, largest where dark and light squares meet.
    height = np.maximum(xy * xy - xx * yy, 0.0)
    peaks = (height == cv2.dilate(height, np.ones((7, 7)))) & (
        height > FAINTEST_SADDLE * np.percentile(height[::2, ::2], 99.9)
    )
    found = cv2.findNonZero(peaks.view(np.uint8))  # by rows, as np.nonzero, which takes four times as long
    x, y = np.empty((2, 0), dtype=np.intp) if found is None else found.reshape(-1, 2).T
    order = np.argsort(-height[y, x])[:MOST_SADDLES]
    return np.column_stack([x, y])[order].astype(np.float64)


class _Growth:
    """The known corners by their place in the lattice."""

    def __init__(self, gray: Gray, seed: Lattice, largest: int) -> None:
        self._gray, self._largest = gray, largest
        self._levels = gray.astype(np.float32)
        self._known: dict[Place, FloatArray] = {}
        self._relief = 0.0
        self._start(seed)

    def lattice(self) -> Lattice | None:
        """Grow the lattice as far as possible and return it."""
        if not self._known:
            return None
        tried: dict[Place, int] = {}
        while new := [(place, near) for place, near in self._next() if tried.get(place, 0) < near]:
            for place, near in new:
                # A place that could not be predicted is tried again when another neighbour becomes known.
                tried[place] = near
                corner = self._at(place)
                if corner is not None:
                    self._known[place] = corner
            if max(self._extent()) > self._largest:
                break
        self._prune()
        if len(self._known) < SEED[0] * SEED[1]:
            return None
        rows, columns = np.array(list(self._known)).T
        lattice = np.full((np.ptp(rows) + 1, np.ptp(columns) + 1, 2), np.nan)
        lattice[rows - rows.min(), columns - columns.min()] = list(self._known.values())
        return lattice

    def _start(self, seed: Lattice) -> None:
        """Add the seed's points that look like corners, judged by the contrast of the typical one."""
        places = [(int(row), int(column)) for row, column in np.ndindex(*seed.shape[:2])]
        self._known = {place: seed[place] for place in places if np.isfinite(seed[place]).all()}
        reliefs = {place: self._relief_at(place, self._known[place]) for place in self._known}
        signed = [relief for relief, _ in reliefs.values()]
        self._relief = float(np.median(signed)) if signed else 0.0
        self._known = {
            place: corner for place, corner in self._known.items() if self._is_corner(reliefs[place])
        }
        if len(self._known) < SURE * len(places):
            self._known = {}

    def _prune(self) -> None:
        """Remove corners that are more uneven than the typical one, and those that are then disconnected."""
        uneven = {}
        for place, corner in self._known.items():
            height, unevenness = self._relief_at(place, corner)
            uneven[place] = unevenness / abs(height) if height else np.inf
        limit = float(np.median(list(uneven.values()))) + STANDS_OUT if uneven else 0.0
        left = {place for place, value in uneven.items() if value < limit}
        pieces: list[set[Place]] = []
        while left:
            piece, edge = set[Place](), [left.pop()]
            while edge:
                row, column = edge.pop()
                piece.add((row, column))
                for beside in ((row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1)):
                    if beside in left:
                        left.remove(beside)
                        edge.append(beside)
            pieces.append(piece)
        kept = max(pieces, key=len, default=set())
        self._known = {place: corner for place, corner in self._known.items() if place in kept}

    def _extent(self) -> tuple[int, int]:
        rows, columns = np.array(list(self._known)).T
        return int(np.ptp(rows)) + 1, int(np.ptp(columns)) + 1

    def _next(self) -> list[tuple[Place, int]]:
        """Return the places next to known corners with the number of known neighbours, largest number first."""
        beside: dict[Place, int] = {}
        for row, column in self._known:
            for place in ((row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1)):
                if place not in self._known:
                    beside[place] = beside.get(place, 0) + 1
        # A place between known corners is interpolated; one beside a single corner is extrapolated, so it waits.
        return sorted(beside.items(), key=lambda pair: -pair[1])

    def _at(self, place: Place) -> FloatArray | None:
        """Return the corner at a place; None if there is none."""
        expected = self._expected(place)
        if expected is None:
            return None
        at, across, down = expected
        spacing = float(min(np.hypot(*across), np.hypot(*down)))
        height, width = self._gray.shape
        half = half_window(spacing)
        if spacing < SMALLEST_SPACING_PX or not (
            half + 1 < at[0] < width - 2 - half and half + 1 < at[1] < height - 2 - half
        ):
            return None
        corner = refined(self._gray, at, half)
        if np.hypot(*(corner - at)) > LARGEST_SHIFT * spacing or self._is_taken(place, corner, spacing):
            return None
        return corner if self._is_corner(self._relief_of(place, corner, across, down)) else None

    def _is_taken(self, place: Place, corner: FloatArray, spacing: float) -> bool:
        """Return whether a corner is already known at another place."""
        row, column = place
        around = ((row + v, column + u) for v in (-1, 0, 1) for u in (-1, 0, 1))
        return any(
            np.hypot(*(corner - other)) < spacing / 2
            for other in map(self._known.get, around)
            if other is not None
        )

    def _expected(self, place: Place) -> tuple[FloatArray, FloatArray, FloatArray] | None:
        """Predict a corner, and the steps to the next column and row, by a polynomial fit to the corners around it."""
        row, column = place
        near = [
            (r - row, c - column, corner)
            for r in range(row - REACH, row + REACH + 1)
            for c in range(column - REACH, column + REACH + 1)
            if (r, c) != place and (corner := self._known.get((r, c))) is not None
        ]
        if len(near) < 3:
            return None
        v, u = np.array([(r, c) for r, c, _ in near], dtype=np.float64).T
        seen = np.array([corner for _, _, corner in near])
        terms = [np.ones_like(u), u, v]
        if len(near) >= CURVED_FROM and len(set(u)) >= 3 and len(set(v)) >= 3:
            terms += [u * v, u**2, v**2]
        # Distortion and perspective bend the lattice, so the nearest corners say most of the next one.
        weight = 1.0 / np.hypot(u, v)
        design = np.column_stack(terms) * weight[:, None]
        fit, _, rank, _ = np.linalg.lstsq(design, seen * weight[:, None], rcond=1e-6)
        return (fit[0], fit[1], fit[2]) if rank == len(terms) else None

    def _relief_at(self, place: Place, corner: FloatArray) -> tuple[float, float]:
        expected = self._expected(place)
        return self._relief_of(place, corner, *expected[1:]) if expected is not None else (0.0, np.inf)

    def _relief_of(
        self, place: Place, corner: FloatArray, across: FloatArray, down: FloatArray
    ) -> tuple[float, float]:
        """Return the contrast of two opposite quadrants to the other two, and the largest difference within a pair.

        The sign of the contrast is reversed at every second corner, so that it is the same for the whole board. Where
        the quadrants are not those of a corner, they are sampled nearer to it.
        """
        seen = self._sampled(place, corner, across, down, QUADRANTS[0])
        return seen if self._is_corner(seen) else self._sampled(place, corner, across, down, QUADRANTS[1])

    def _sampled(
        self, place: Place, corner: FloatArray, across: FloatArray, down: FloatArray, at: float
    ) -> tuple[float, float]:
        offsets = at * _SIGNS[:, None] * _AROUND
        x, y = np.moveaxis(corner + offsets[..., :1] * across + offsets[..., 1:] * down, -1, 0)
        height, width = self._gray.shape
        column, row = np.rint(x).astype(np.intp), np.rint(y).astype(np.intp)
        if not ((column >= 0) & (column < width) & (row >= 0) & (row < height)).all():
            return 0.0, np.inf
        a, b, c, d = self._levels[row, column].mean(axis=1).tolist()
        sign = 1 if (place[0] + place[1]) % 2 == 0 else -1
        return sign * (a + b - c - d) / 2, max(abs(a - b), abs(c - d))

    def _is_corner(self, relief: tuple[float, float]) -> bool:
        height, unevenness = relief
        share = height / self._relief if self._relief else 0.0
        return share > FAINTEST and unevenness < UNEVEN * abs(height)
