"""JSON document of a calibration from a board (schemas/calibration-result-1.schema.json)."""

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
"""None stands for a number that is not finite."""
Rows: TypeAlias = tuple[Numbers, ...]


class Warp(Record):
    """F test for board warp.

    Attributes:
        lift: height of the board's centre above its plane, along x and along y.
        f: the F statistic; None if it overflows a double.
        p: probability of such an F without a warp.
        kept: whether the warp is part of the solution.
    """

    lift: tuple[float, float]
    f: float | None
    p: float
    kept: bool


class RejectedCorner(Record):
    """A corner that was rejected as an outlier.

    Attributes:
        id: number of the board's point.
        px: its residual.
    """

    id: Annotated[int, Meta(ge=0)]
    px: float


class ViewReport(Record):
    """One view, used or not.

    Attributes:
        name: of the frame.
        rms_px: reprojection error (RMS) of the used corners, or of all corners if the view is not used; None
            without a pose.
        without: reason why the view is not used; None if it is used.
        corners_out: the rejected corners.
        rotation: 3 × 3, board to camera; None without a pose, like the next two.
        translation: position of the board's centre in the camera frame.
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
    """Coverage of the image by corners.

    Attributes:
        cells: row by row, whether each cell of the image contains a corner.
        fraction: fraction of the cells that contain a corner.
        border: fraction of the segments along the image border that contain a corner.
        reach: largest distance of a corner from the image centre; 1 at the image corners.
    """

    cells: tuple[tuple[bool, ...], ...]
    fraction: float
    border: float
    reach: float


class ViewGeometry(Record):
    """Poses of the board.

    Attributes:
        tilt_spread_deg: 90 % quantile of the angles between the board normals of two views.
        roll_spread_deg: largest angle between the board rows of two views, about the optical axis.
        depth_ratio: depth of the farthest corner ÷ depth of the nearest.
        distance: median distance of the board.
        coverage: of the image.
    """

    tilt_spread_deg: float
    roll_spread_deg: float
    depth_ratio: float | None
    distance: float
    coverage: FrameCoverage


class CalibrateReport(Record, tag_field="schema", tag="calibration-result-1"):
    """A calibration from a board, with its verdict and the evidence for it.

    Attributes:
        verdict: determined by the most severe finding.
        findings: most severe first.
        calibration: K and distortion with their quality.
        model: the lens model, chosen or given.
        candidates: the lens models that were compared.
        warp: test for board warp; None if it was not tested.
        views: all views that were given.
        geometry: poses of the board.
        length_unit: unit of lift, translation and distance: mm; squares if the side of a square is unknown; an
            arbitrary unit for a flight with images that state no positions.
        noise_px: standard deviation of one coordinate, estimated from neighbouring corners.
        condition: condition number of the lens's normal matrix.
        kappa2_by_split: variance factor of each split of the views into halves.
        stretch: of the printed board.
        misfit: known fault that explains residuals that the camera model does not.
        uncertainty_px: of a direction, over the image.
        half_difference_px: difference between halves of the views, over the image.
        limits: the limits used for the verdict.
        versions: of the programs.
        date_origin: source of provenance.date, in words.
        flown: only for a calibration from a flight; ground points take the place of board corners.
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
    """Make the report of a calibration; numbers that are not finite become None."""
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
