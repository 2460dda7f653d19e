"""What a calibration from a board reports, as one JSON document (schemas/calibration-result-1.schema.json)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Literal, TypeAlias

from calibrary.arrays import FloatArray
from calibrary.calib.board_shape import Stretch
from calibrary.calib.geometry import Geometry
from calibrary.calib.lens_models import Solvable
from calibrary.calib.misfit import Misfit
from calibrary.calib.model_choice import Candidate, WarpTest
from calibrary.calib.result import CalibrationResult, Dismissal, Flown, ViewResult
from calibrary.calib.verdict import BoardVerdict, Limits
from calibrary.calibration import Calibration
from calibrary.records import Meta, Record
from calibrary.validation import Finding

__all__ = ["CalibrateReport", "report_of"]

Numbers: TypeAlias = tuple[float | None, ...]
"""None for what is not finite."""
Rows: TypeAlias = tuple[Numbers, ...]


class Warp(Record):
    """The test for a warped board.

    Attributes:
        lift: of the board's middle, across and down.
        f: the statistic; None where it is larger than every double.
        p: chance of such an F without a warp.
        kept: whether the warp is part of the solution.
    """

    lift: tuple[float, float]
    f: float | None
    p: float
    kept: bool


class RejectedCorner(Record):
    """A corner that does not count.

    Attributes:
        id: the board's point.
        px: by which it is off.
    """

    id: Annotated[int, Meta(ge=0)]
    px: float


class ViewReport(Record):
    """One view, whether it counts or not.

    Attributes:
        name: the frame's.
        rms_px: of the corners that count; of all of them where the view does not. None without a pose.
        without: why the view does not count; None where it does.
        corners_out: the corners that were rejected.
        rotation: 3 × 3, board to camera; None where the view has no pose, as the next two.
        translation: the middle of the board in the camera frame.
        residuals_px: observed − projected, in the order of the view's corners.
    """

    name: str
    rms_px: float | None
    without: Dismissal | None
    corners_out: tuple[RejectedCorner, ...]
    rotation: Rows | None
    translation: Numbers | None
    residuals_px: Rows | None


class FrameCoverage(Record):
    """Where corners were seen.

    Attributes:
        cells: row by row, which cells of the frame hold a corner.
        fraction: of the cells.
        border: fraction of the parts of a ring along the frame's edge that hold one.
        reach: how far from the middle corners were seen, 1 at the frame's corners.
    """

    cells: tuple[tuple[bool, ...], ...]
    fraction: float
    border: float
    reach: float


class ViewGeometry(Record):
    """How the board was held.

    Attributes:
        tilt_spread_deg: angle between the boards' normals that nine of ten pairs of views stay below.
        roll_spread_deg: largest angle between two boards' rows as seen along the axis.
        depth_ratio: farthest over nearest corner.
        distance: median distance of the boards.
        coverage: of the frame.
    """

    tilt_spread_deg: float
    roll_spread_deg: float
    depth_ratio: float | None
    distance: float
    coverage: FrameCoverage


class CalibrateReport(Record, tag_field="schema", tag="calibration-result-1"):
    """A calibration from a board, with its verdict and all that speaks for and against it.

    Attributes:
        verdict: the worst finding decides.
        findings: the most severe first.
        calibration: K and distortion with their quality.
        model: the lens model, chosen or given.
        candidates: the models that were compared.
        warp: None where there was no test.
        views: every view that was given.
        geometry: how the board was held.
        length_unit: of lift, translation and distance: mm; squares where the side of a square is not known; units of
            no known length where a flight's images state no positions.
        noise_px: of one coordinate, as neighbouring corners show it.
        condition: of the lens's normal matrix.
        kappa2_by_split: the variance factors of the splits into halves.
        stretch: of the print.
        misfit: which known fault explains what the camera does not.
        uncertainty_px: of a direction, over the frame.
        half_difference_px: between halves of the views, over the frame.
        limits: what the calibration was judged by.
        versions: of the programs.
        date_origin: where provenance.date is from, in words.
        flown: of a calibration from a flight; its points of the ground stand in the place of a board's corners.
    """

    verdict: BoardVerdict
    findings: tuple[Finding, ...]
    calibration: Calibration
    model: Solvable
    candidates: tuple[Candidate, ...]
    warp: Warp | None
    views: tuple[ViewReport, ...]
    geometry: ViewGeometry
    length_unit: Literal["mm", "squares", "units"]
    noise_px: float | None
    condition: float | None
    kappa2_by_split: tuple[float, ...]
    stretch: Stretch | None
    misfit: Misfit | None
    uncertainty_px: Rows | None
    half_difference_px: tuple[Rows, ...] | None
    limits: Limits
    versions: Mapping[str, str]
    date_origin: str | None
    flown: Flown | None


_UNITS: Mapping[str, Literal["mm", "squares", "units"]] = {"mm": "mm", "units": "units"}


def report_of(result: CalibrationResult) -> CalibrateReport:
    """The whole result; what is not a finite number is None."""
    evidence, halves = result.evidence, result.half_difference
    return CalibrateReport(
        verdict=result.verdict,
        findings=result.findings,
        calibration=result.calibration,
        model=result.model,
        candidates=result.candidates,
        warp=_warp(result.warp, kept=evidence.is_warped) if result.warp is not None else None,
        views=tuple(map(_view, result.views)),
        geometry=_geometry(evidence.geometry),
        length_unit=_UNITS.get(evidence.unit, "squares"),
        noise_px=evidence.noise_px,
        condition=_finite(evidence.condition),
        kappa2_by_split=result.halves.by_split if result.halves is not None else (),
        stretch=evidence.stretch,
        misfit=evidence.misfit,
        uncertainty_px=_rows(result.uncertainty.std_px) if result.uncertainty is not None else None,
        half_difference_px=tuple(map(_rows, halves.vectors)) if halves is not None else None,
        limits=result.limits,
        versions=result.versions,
        date_origin=result.date_origin,
        flown=result.flown,
    )


def _warp(warp: WarpTest, *, kept: bool) -> Warp:
    return Warp(lift=warp.warp_mm, f=_finite(warp.f), p=warp.p, kept=kept)


def _view(view: ViewResult) -> ViewReport:
    return ViewReport(
        name=view.name,
        rms_px=view.rms_px,
        without=view.without,
        corners_out=tuple(RejectedCorner(id=at, px=px) for at, px in view.corners_out),
        rotation=_rows(view.rotation) if view.rotation is not None else None,
        translation=_numbers(view.translation_mm) if view.translation_mm is not None else None,
        residuals_px=_rows(view.residuals_px) if view.residuals_px is not None else None,
    )


def _geometry(seen: Geometry) -> ViewGeometry:
    return ViewGeometry(
        tilt_spread_deg=seen.tilt_spread_deg,
        roll_spread_deg=seen.roll_spread_deg,
        depth_ratio=_finite(seen.depth_ratio),
        distance=seen.distance_mm,
        coverage=FrameCoverage(
            cells=tuple(tuple(map(bool, row)) for row in seen.coverage.cells),
            fraction=seen.coverage.fraction,
            border=seen.coverage.border,
            reach=seen.coverage.reach,
        ),
    )


def _rows(values: FloatArray) -> Rows:
    return tuple(map(_numbers, values))


def _numbers(values: FloatArray) -> Numbers:
    return tuple(map(_finite, values.tolist()))


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
