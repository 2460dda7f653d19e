"""Markers of any of OpenCV's dictionaries, and the board on which they lie, when neither is known.

OpenCV finds the dark quadrangles; their modules are compared here with all dictionaries at once, which takes a tenth of
the time of OpenCV's own comparison. A dictionary of 50, 100 or 250 markers is the beginning of the one of 1000.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from calibrary.arrays import FloatArray, IntArray
from calibrary.calib.board import DICTIONARIES, Board, Pattern
from calibrary.calib.detectors.refinement import DETECTION_SIDE, enlarged, reduced
from calibrary.calib.frames import Gray
from calibrary.calib.lattice import homography, mapped

FAMILIES: Final[Mapping[str, int]] = MappingProxyType(
    {
        "4x4_1000": 4,
        "5x5_1000": 5,
        "6x6_1000": 6,
        "7x7_1000": 7,
        "apriltag_16h5": 4,
        "apriltag_25h9": 5,
        "apriltag_36h10": 6,
        "apriltag_36h11": 6,
    }
)
"""The largest dictionaries, with the number of modules along a marker's side without its border."""
BORDERS: Final = (1, 2)
"""Widths of a marker's dark border in modules: OpenCV's, and that of Kalibr's grids."""
MODULE_PX = 8
LEAST_CONTRAST = 30.0
"""Gray levels between the dark and the light modules of a marker."""
DARK_BORDER = 0.9
"""Smallest share of the border's modules that are dark."""
FEWEST_MARKERS = 4
FITS = 0.25
"""Largest distance of a marker's corner from its place on the board, in squares; wide lenses bend the board."""
SIDES: Final = range(2, 41)
"""Numbers of squares or tags along a row that are tried."""


class Markers(Struct, frozen=True, kw_only=True, eq=False):
    """Markers of one dictionary in one image.

    Attributes:
        dictionary: the largest of its family.
        ids: (N,) numbers.
        quads: (N, 4, 2) px with OpenCV's pixel origin, in OpenCV's order of corners.
    """

    dictionary: str
    ids: IntArray
    quads: FloatArray


class Layout(Struct, frozen=True, kw_only=True):
    """Arrangement of numbered markers on a board.

    Attributes:
        pattern: ChArUco board or AprilGrid.
        across: squares or tags along a row.
        legacy: whether the upper left square of a ChArUco board has a marker, as OpenCV before 4.6 drew boards with an
            even number of rows of squares.
    """

    pattern: Pattern
    across: int
    legacy: bool = False

    def places(self, ids: IntArray) -> FloatArray:
        """Return (column, row) of markers, in squares or tags."""
        if self.pattern is Pattern.APRILGRID:
            # Kalibr numbers the rows upwards.
            return np.column_stack([ids % self.across, -(ids // self.across)]).astype(np.float64)
        # Two rows of squares have as many markers as one has squares.
        upper = (self.across + 1) // 2 if self.legacy else self.across // 2
        pair, at = np.divmod(ids, self.across)
        above = at < upper
        column = np.where(above, 2 * at + (not self.legacy), 2 * (at - upper) + self.legacy)
        return np.column_stack([column, 2 * pair + ~above]).astype(np.float64)

    def board(self, highest: int, family: str, square_mm: float | None) -> Board | None:
        """Return the board whose last row has the marker ``highest``; None if it cannot be detected."""
        down = round(abs(float(self.places(np.array([highest]))[0, 1]))) + 1
        if self.pattern is Pattern.CHARUCO and self.legacy:
            # The layouts differ only on boards with an even number of rows.
            down += down % 2
        less = 1 if self.pattern is Pattern.CHARUCO else 0
        if min(self.across, down) - less < 2:
            return None
        markers = self.across * down // (2 if less else 1)
        prefix = family.removesuffix("_1000")
        names = [name for name, held in DICTIONARIES.items() if name.startswith(prefix) and held >= markers]
        if not names:
            return None
        return Board(
            pattern=self.pattern,
            columns=self.across - less,
            rows=down - less,
            square_mm=square_mm,
            dictionary=names[0],
        )


class LaidOut(Struct, frozen=True, kw_only=True, eq=False):
    """Markers of one image and the arrangement that they fit best.

    Attributes:
        layout: the arrangement.
        ids: numbers of the markers that fit it.
        share: side of a marker relative to the distance between squares or tags.
    """

    layout: Layout
    ids: IntArray
    share: float


def find_markers(gray: Gray) -> tuple[Markers, ...]:
    """Return the markers of each dictionary of which at least four are seen, the most numerous first."""
    import cv2

    small, scale = reduced(gray, DETECTION_SIDE)
    detector = cv2.aruco.ArucoDetector(_opencvs("4x4_50"))
    accepted, _, others = detector.detectMarkers(small)
    quads = np.array([np.reshape(quad, (4, 2)) for quad in (*accepted, *others)], dtype=np.float64)
    found = [
        Markers(dictionary=family, ids=ids, quads=enlarged(corners, scale))
        for border in BORDERS
        for modules in sorted(set(FAMILIES.values()))
        for family, ids, corners in _identified(small, quads.reshape(-1, 4, 2), modules, border)
        if len(ids) >= FEWEST_MARKERS
    ]
    return tuple(sorted(found, key=lambda one: -len(one.ids)))


def laid_out(markers: Markers) -> LaidOut | None:
    """Return the arrangement that most of the markers fit; None if they are in none."""
    kinds = [(Pattern.CHARUCO, False), (Pattern.CHARUCO, True), (Pattern.APRILGRID, False)]
    fits = [
        fit
        for pattern, legacy in kinds
        for across in SIDES
        if (fit := _fit(markers, Layout(pattern=pattern, across=across, legacy=legacy))) is not None
    ]
    best = max(fits, key=lambda fit: (len(fit[0].ids), -fit[1]), default=None)
    return best[0] if best is not None and 2 * len(best[0].ids) >= len(markers.ids) else None


def _fit(markers: Markers, layout: Layout) -> tuple[LaidOut, float] | None:
    """Return the markers that fit a layout, and the typical distance of their corners from it, in squares."""
    places, centres = layout.places(markers.ids), markers.quads.mean(axis=1)
    if np.ptp(places, axis=0).min() < 1:
        return None
    H = homography(places, centres, robustly=True)
    if H is None or np.linalg.matrix_rank(H) < 3:
        return None
    back = np.asarray(np.linalg.inv(H), dtype=np.float64)
    corners = mapped(back, markers.quads.reshape(-1, 2)).reshape(-1, 4, 2) - places[:, None]
    # Kalibr prints its tags upside down.
    square = (
        np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
        * (-1 if layout.pattern is Pattern.APRILGRID else 1)
        / 2
    )
    shares = np.einsum("nkc,kc->n", corners, square) / 2
    share = float(np.median(shares)) if np.isfinite(shares).all() else 0.0
    off = np.linalg.norm(corners - share * square, axis=2).max(axis=1)
    fits = off < FITS
    if share <= 0 or fits.sum() < FEWEST_MARKERS:
        return None
    return LaidOut(layout=layout, ids=markers.ids[fits], share=share), float(np.median(off[fits]))


def _identified(
    gray: Gray, quads: FloatArray, modules: int, border: int
) -> list[tuple[str, IntArray, FloatArray]]:
    """Return (family, numbers, corners) of the quadrangles that are markers of a size."""
    import cv2

    side = modules + 2 * border
    px = side * MODULE_PX
    square = np.array([(0, 0), (px, 0), (px, px), (0, px)], dtype=np.float32) - np.float32(0.5)
    codes, at = [], []
    for index, quad in enumerate(quads):
        H = cv2.getPerspectiveTransform(quad.astype(np.float32), square)
        levels = _modules(np.asarray(cv2.warpPerspective(gray, H, (px, px)), dtype=np.uint8), side)
        low, high = levels.min(), levels.max()
        bits = levels > (low + high) / 2
        inner = bits[border:-border, border:-border]
        if (
            high - low > LEAST_CONTRAST
            and 1 - (bits.sum() - inner.sum()) / (bits.size - inner.size) >= DARK_BORDER
        ):
            code = np.asarray(
                cv2.aruco.Dictionary.getByteListFromBits(inner.astype(np.uint8)), dtype=np.uint8
            )
            codes.append(_turned(code)[0, 0])
            at.append(index)
    if not codes:
        return []
    found = []
    for family in (name for name, its in FAMILIES.items() if its == modules):
        known = _turned(_opencvs(family).bytesList)
        ids, which, turns = np.nonzero((known[:, None] == np.array(codes)[None, :, None]).all(axis=3))
        once = np.isin(ids, np.flatnonzero(np.bincount(ids) == 1))
        ids, which, turns = ids[once], which[once], turns[once]
        corners = [np.roll(quads[at[one]], turn, axis=0) for one, turn in zip(which, turns, strict=True)]
        found.append((family, ids, np.array(corners).reshape(-1, 4, 2)))
    return found


def _turned(codes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return codes as (N, turn, bytes): OpenCV states another shape than that in which it stores them."""
    return codes.reshape(len(codes), 4, -1)


def _modules(patch: Gray, side: int) -> FloatArray:
    """Return the mean level of each module, away from its edges."""
    cells = patch.reshape(side, MODULE_PX, side, MODULE_PX)[:, 2:-2, :, 2:-2]
    return np.asarray(cells.mean(axis=(1, 3)), dtype=np.float64)


@cache
def _opencvs(name: str) -> Any:
    import cv2

    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{name.upper()}"))
