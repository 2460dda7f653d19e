"""Ground control in an adjustment: aligns the scene to surveyed points, and rejects wrong points and marks.

A mark is compared with the projection of the surveyed place, not of the place triangulated from the marks: so a wrong
coordinate affects all marks of its point, and a wrong click only one. Like all observations, the marks are tested again
in each round.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from itertools import combinations
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import BoolArray, FloatArray, IntArray
from calibrary.calib.least_squares import reduce, step_of
from calibrary.calib.rejection import RAYLEIGH_MEDIAN
from calibrary.calib.result import ControlFit, OddMark
from calibrary.errors import CalibrationError, InputError, ParseError
from calibrary.records import replace
from calibrary.sfm.bundle import Bundle, linearise, moved, projections
from calibrary.sfm.geodesy import LocalFrame
from calibrary.sfm.priors import GAUGE
from calibrary.sfm.survey import Survey
from calibrary.sfm.tracks import FEWEST_IMAGES, Control, Scene, Similarity, Tracks, similarity

FEWEST_POINTS: Final = 3
GATE: Final = 4.5
"""The length of a two-dimensional normal error exceeds 4.5 σ once in 25 000 marks."""
CHI2_GATE: Final = 24.0
"""Limit of χ² with three degrees of freedom, exceeded once in 40 000 points; the median follows."""
CHI2_MEDIAN: Final = 2.366
WORSE: Final = 10.0
"""Points that fit worse than stated by this factor belong to another place, coordinate system or set of images."""
MOST_TRIPLES: Final = 400
STEPS: Final = 8
IN_A_LINE: Final = 0.02
"""Smallest width of the points relative to their extent; narrower ones do not determine the rotation about a line."""
FARTHEST_M: Final = 1000.0
"""Largest distance between surveyed points and stated image positions; datums differ by hundreds of metres, zones and
swapped axes by kilometres."""
SCALE: Final = (0.8, 1.25)
SURE_OF_SCALE: Final = 10.0
"""Smallest ratio of the positions' spread to their standard deviation for a test of the scale."""


def with_survey(
    tracks: Tracks, scene: Scene, survey: Survey, frame: LocalFrame | None
) -> tuple[Tracks, Scene]:
    """Add the survey's marks in these images to the tracks, and its points to the scene.

    Args:
        tracks: observations; their positions are dropped if the survey is in local metres.
        scene: the new points are placed in its middle until :func:`on_control` places them.
        survey: points and marks.
        frame: frame of the images' positions; None if there are none or their frame is unknown.

    Raises:
        CalibrationError: fewer than three points are marked in at least two of these images.
        InputError: a common datum is stated but there are no positions, or the survey is local.
        ParseError: a mark is outside its image.
    """
    found = survey.marks_in(tracks.names)
    counts = np.bincount([mark.point for _, mark in found], minlength=len(survey.names))
    if int((counts >= 2).sum()) < FEWEST_POINTS:
        raise CalibrationError(_too_few(survey, tracks.names, len(found), int((counts >= 2).sum())))
    for at, mark in found:
        if not (np.array(mark.pixel) <= tracks.image_size).all() or min(mark.pixel) < 0:
            raise ParseError(
                f"the mark in {tracks.names[at]} is outside its {tracks.image_size[0]}×{tracks.image_size[1]} px: "
                "marks are in px of the images given",
                source=survey.file.name,
                place=f"line {mark.line}" if mark.line else None,
            )
    used, first = np.flatnonzero(counts), len(scene.points)
    number = first + np.cumsum(counts > 0) - 1
    if math.isfinite(survey.offset_std_m) and (survey.is_local or frame is None):
        raise InputError(
            "--same-datum-m needs images that state where they were taken, and points in a map's coordinates"
        )
    local = frame or LocalFrame.around(survey.places)
    places = survey.places if survey.is_local else local.metres(survey.places)
    control = Control(
        names=tuple(survey.names[at] for at in used.tolist()),
        point=number[used],
        places=places[used],
        std_m=survey.std_m,
        mark_px=survey.mark_px,
        offset_std_m=_offset_std(tracks, survey),
    )
    marked = replace(
        tracks,
        image=np.concatenate([tracks.image, [at for at, _ in found]]),
        point=np.concatenate([tracks.point, number[[mark.point for _, mark in found]]]),
        pixels=np.vstack([tracks.pixels, [mark.pixel for _, mark in found]]),
        positions=None if survey.is_local else tracks.positions,
        control=control,
    )
    middle = np.tile(np.median(scene.points, axis=0), (len(used), 1))
    return marked, replace(scene, points=np.vstack([scene.points, middle]))


def _offset_std(tracks: Tracks, survey: Survey) -> float:
    """Return the standard deviation of the offset, m; a receiver's own error is mostly the same in all images."""
    positions = tracks.positions
    if positions is None or not positions.known.any():
        return survey.offset_std_m
    return math.hypot(survey.offset_std_m, float(np.median(positions.std[positions.known].max(axis=1))))


def _too_few(survey: Survey, images: Sequence[str], marks: int, points: int) -> str:
    if not marks:
        return (
            f"{survey.file.name} marks {survey.marks[0].image} and others, none of the images that fit together, such "
            f"as {images[0]}: give the images that were marked"
        )
    return (
        f"{points} points of {survey.file.name} are marked in two of the {len(images)} images each, need "
        f"{FEWEST_POINTS}: mark more points, in images that overlap, or choose more images, --images"
    )


def on_control(tracks: Tracks, scene: Scene, control: Control, *, shared_frame: bool) -> Scene:
    """Align the scene to the majority of the surveyed points.

    Args:
        tracks: observations, including the marks.
        scene: scene adjusted without the points.
        control: surveyed points of the tracks.
        shared_frame: whether positions and points are in one coordinate frame, except for their datums.

    Raises:
        CalibrationError: the points lie in one line, or contradict one another, the images or their positions.
    """
    seen, sure = _triangulated(tracks, scene, control)
    here, there = seen[sure], control.places[sure]
    extent = np.linalg.svd(there - there.mean(axis=0), compute_uv=False)
    if len(there) < FEWEST_POINTS or extent[1] < IN_A_LINE * extent[0]:
        raise CalibrationError(
            "the points lie in one line, which does not say how the ground is turned: mark one aside of it"
        )
    laid = _most_agree(here, there).moved(scene)
    if np.median(laid.centres[tracks.used, 2]) < np.median(there[:, 2]):
        raise CalibrationError(
            "the points put the images below the ground: check that x is east, y north and z up"
        )
    _not_contradicted(tracks, laid, shared_frame=shared_frame)
    return _at_their_places(laid, control)


def _at_their_places(scene: Scene, control: Control) -> Scene:
    points = scene.points.copy()
    points[control.point] = control.places
    return replace(scene, points=points)


def _triangulated(tracks: Tracks, scene: Scene, control: Control) -> tuple[FloatArray, BoolArray]:
    """Triangulate the points from the marks alone: (G, 3) in the scene's frame, and (G,) whether it was possible."""
    seen, sure = control.places.copy(), np.zeros(len(control.point), dtype=np.bool_)
    for number, at in enumerate(control.point.tolist()):
        rows = tracks.point == at
        place = _triangulated_one(tracks, scene, rows, at) if int(rows.sum()) >= 2 else None
        if place is not None:
            seen[number], sure[number] = place, True
    return seen, sure


def _triangulated_one(tracks: Tracks, scene: Scene, rows: BoolArray, at: int) -> FloatArray | None:
    """Triangulate one point, (3,), starting from the points nearest in the images; None if this fails."""
    near, marks = [], tracks.marks
    for row in np.flatnonzero(rows).tolist():
        others = np.flatnonzero((tracks.image == tracks.image[row]) & ~marks)
        if len(others):
            apart = np.linalg.norm(tracks.pixels[others] - tracks.pixels[row], axis=1)
            near.append(scene.points[tracks.point[others[np.argmin(apart)]]])
    if not near:
        return None
    points, free = scene.points.copy(), np.arange(len(scene.parameters))
    points[at] = np.median(near, axis=0)
    alone = replace(tracks, image=tracks.image[rows], point=tracks.point[rows], pixels=tracks.pixels[rows])
    found: Scene | None = replace(scene, points=points)
    with suppress(np.linalg.LinAlgError):
        for _ in range(STEPS):
            linear = linearise(alone, found, 0.0) if found is not None else None
            if found is None or linear is None:
                return None
            reduced = reduce(linear, free)
            still = step_of(linear, reduced, np.zeros(len(reduced.right)))
            found = moved(alone, found, linear, still, free)
        return found.points[at] if found is not None else None
    return None


def _most_agree(here: FloatArray, there: FloatArray) -> Similarity:
    """Return the similarity with the smallest median distance among those by three points, refitted to the best half.

    Source: P. Rousseeuw, "Least median of squares regression", 1984.
    """
    triples = [*combinations(range(len(here)), 3)]
    # With half of the points wrong one triple of eight is right, so that a few hundred at random surely have one.
    if len(triples) > MOST_TRIPLES:
        rows = np.random.default_rng(0).choice(len(triples), MOST_TRIPLES, replace=False)
        triples = [triples[row] for row in rows.tolist()]
    off = min(
        (_apart(similarity(here[[*triple]], there[[*triple]]), here, there) for triple in triples),
        key=lambda apart: float(np.sort(apart)[len(apart) // 2]),
    )
    half = np.argsort(off)[: max(len(here) // 2 + 1, FEWEST_POINTS)]
    return similarity(here[half], there[half])


def _apart(by: Similarity, here: FloatArray, there: FloatArray) -> FloatArray:
    """Return (n,) the distances after a similarity."""
    return np.asarray(np.linalg.norm(by.of(here) - there, axis=1))


def _not_contradicted(tracks: Tracks, laid: Scene, *, shared_frame: bool) -> None:
    """Compare the scene on the surveyed points with the stated positions of the images.

    Raises:
        CalibrationError: they differ by more than datums do, or in scale.
    """
    positions = tracks.positions
    rows = (
        positions.known & tracks.used
        if positions is not None
        else np.zeros(len(tracks.names), dtype=np.bool_)
    )
    if positions is None or int(rows.sum()) < FEWEST_IMAGES:
        return
    off = positions.places[rows] - laid.centres[rows]
    apart = float(np.hypot(*np.median(off, axis=0)[:2]))
    if shared_frame and apart > FARTHEST_M:
        raise CalibrationError(
            f"the points lie {apart / 1000:.1f} km from where the images were taken: check the coordinate system in "
            "their first line, and that x is east and y north"
        )
    spread = positions.places[rows] - positions.places[rows].mean(axis=0)
    if math.sqrt(float((spread**2).mean())) < SURE_OF_SCALE * float(np.median(positions.std[rows])):
        return
    scale = similarity(laid.centres[rows], positions.places[rows]).scale
    if not SCALE[0] < scale < SCALE[1]:
        raise CalibrationError(
            f"by the points the flight is {1 / max(scale, 1e-9):.3g} times as large as by the images' positions: "
            "check the points' unit and coordinate system"
        )


class _Marks(Struct, frozen=True, kw_only=True, eq=False):
    """Residuals of the marks relative to the projected surveyed places.

    Attributes:
        rows: (n,) indices of the observations.
        gap: (n, 2) marked − projected, px; inf if the place is behind the camera.
        by_place: (n, 2, 3) derivatives by the place, px/m.
        odds: (n,) length of the gap divided by its standard deviation.
    """

    rows: IntArray
    gap: FloatArray
    by_place: FloatArray
    odds: FloatArray

    @property
    def off_px(self) -> FloatArray:
        """(n,) length of the gap, px."""
        return np.asarray(np.linalg.norm(self.gap, axis=1))


def _marks(tracks: Tracks, scene: Scene, control: Control) -> _Marks:
    rows = np.flatnonzero(tracks.marks)
    marked = replace(tracks, image=tracks.image[rows], point=tracks.point[rows], pixels=tracks.pixels[rows])
    found = projections(marked, _at_their_places(scene, control))
    with np.errstate(all="ignore"):
        gap = marked.pixels - found.pixels
    seen = found.faces & np.isfinite(gap).all(axis=1)
    by_place = np.where(seen[:, None, None], found.by_arm @ scene.rotations[marked.image], 0.0)
    gap[~seen] = np.inf
    ground = control.std_m * np.sqrt((by_place**2).sum(axis=(1, 2)) / 2)
    return _Marks(
        rows=rows,
        gap=gap,
        by_place=by_place,
        odds=np.linalg.norm(gap, axis=1) / np.hypot(control.mark_px, ground),
    )


def within_marks(tracks: Tracks, scene: Scene, control: Control) -> BoolArray:
    """Return (N,) which marks agree with the surveyed places; False for all other observations.

    The marks of a point are first compared with one another, and single wrong ones are rejected. The place on which the
    others agree is then compared with the survey; if it differs, all marks of the point are rejected. Single marks
    would not suffice: a mark near the middle of its image does not show an error of height.

    Raises:
        CalibrationError: fewer than three points remain.
    """
    seen = _marks(tracks, scene, control)
    point, counts = tracks.point[seen.rows], np.zeros(len(tracks.point), dtype=np.bool_)
    limit = GATE * max(float(np.median(seen.odds)) / RAYLEIGH_MEDIAN, 1.0)
    agreed = {
        at: _agreed(seen, np.flatnonzero(point == at), control, limit) for at in np.unique(point).tolist()
    }
    typical = max(float(np.median([shift for _, shift in agreed.values()])) / CHI2_MEDIAN, 1.0)
    kept = [rows for rows, shift in agreed.values() if shift <= CHI2_GATE * typical]
    if len(kept) < FEWEST_POINTS:
        raise CalibrationError(
            f"{len(kept)} of {len(agreed)} surveyed points fit the images and one another, need {FEWEST_POINTS}: check "
            "coordinates, image names and marks"
        )
    counts[seen.rows[np.concatenate(kept)]] = True
    return counts


def _agreed(seen: _Marks, rows: IntArray, control: Control, limit: float) -> tuple[IntArray, float]:
    """Return the consistent marks of one point, and χ² (3 degrees of freedom) of their shift from the survey."""
    rows = rows[np.isfinite(seen.odds[rows])]
    while len(rows):
        by, gap = seen.by_place[rows] / control.mark_px, seen.gap[rows] / control.mark_px
        flat = by.reshape(-1, 3)
        left = np.linalg.norm(gap - by @ np.linalg.lstsq(flat, gap.reshape(-1), rcond=None)[0], axis=1)
        worst = int(np.argmax(left))
        if len(rows) > 2 and left[worst] > limit:
            rows = np.delete(rows, worst)
            continue
        matrix, right = flat.T @ flat, flat.T @ gap.reshape(-1)
        spread = matrix + matrix @ matrix * control.std_m**2
        return rows, float(right @ np.linalg.pinv(spread, hermitian=True) @ right)
    return rows, math.inf


def restated(stated: Control, tracks: Tracks, scene: Scene, counts: BoolArray) -> Control:
    """Scale the standard deviations of the control to its actual residuals, never below the stated ones.

    Raises:
        CalibrationError: the residuals are ten times worse than stated, or more.
    """
    seen = _marks(tracks, scene, stated)
    odds = seen.odds[counts[seen.rows]]
    gain = 2 * len(odds) / max(2 * len(odds) - GAUGE, 1)
    worse = max(1.0, math.sqrt(gain) * float(np.median(odds)) / RAYLEIGH_MEDIAN)
    if not worse < WORSE:
        raise CalibrationError(
            f"the surveyed points fit {worse:.0f} times worse than ±{stated.std_m:g} m and ±{stated.mark_px:g} px: "
            "check coordinates, image names and marks, or state how good they are, --points-std-m and --mark-std-px"
        )
    return replace(stated, std_m=stated.std_m * worse, mark_px=stated.mark_px * worse)


def fit_of(
    tracks: Tracks, bundle: Bundle, counts: BoolArray, *, stated: Control, control: Control
) -> ControlFit:
    """Summarise the residuals of the surveyed points.

    Args:
        tracks: all observations.
        bundle: result of the adjustment.
        counts: (N,) which observations are inliers.
        stated: control as stated.
        control: control with the standard deviations used in the adjustment.
    """
    rows = bundle.tracks.marks
    seen = _marks(tracks, bundle.scene, control)
    odd = np.flatnonzero(~counts[seen.rows])
    inside = np.isin(control.point, bundle.tracks.point)
    gap = bundle.scene.points[control.point[inside]] - control.places[inside]
    names = dict(zip(stated.point.tolist(), stated.names, strict=True))
    residuals = bundle.linear.residuals[rows] * control.mark_px / math.sqrt(bundle.place_variance)
    return ControlFit(
        points=int(inside.sum()),
        marks=int(rows.sum()),
        rms_px=math.sqrt(float((residuals**2).sum(axis=1).mean())),
        rms_m=math.sqrt(float((gap**2).sum(axis=1).mean())),
        worse=control.std_m / stated.std_m,
        offset_m=tuple(bundle.linear.priors.offset.tolist())
        if tracks.positions is not None and (bundle.linear.priors.by_place > 0).any()
        else None,
        rejected=tuple(
            OddMark(
                point=names[int(tracks.point[row])],
                image=tracks.names[tracks.image[row]],
                off_px=off if math.isfinite(off) else None,
            )
            for row, off in zip(seen.rows[odd].tolist(), seen.off_px[odd].tolist(), strict=True)
        ),
    )
