"""Verdict on a calibration: PASS, PROVISIONAL or REFUSE, with its limits and measurements."""

from __future__ import annotations

from collections.abc import Iterable
from enum import StrEnum
from typing import Final, Self

from msgspec import Struct

from calibrary.calib.board_shape import BoardShape, Stretch
from calibrary.calib.geometry import Geometry
from calibrary.calib.lens_models import Solvable
from calibrary.calib.misfit import Misfit
from calibrary.calib.model_choice import Candidate, WarpTest
from calibrary.calibration import ImageSize
from calibrary.records import Record
from calibrary.validation import Finding, Severity

__all__ = ["LIMITS", "BoardVerdict", "Evidence", "Limits"]


class BoardVerdict(StrEnum):
    """Permitted use of a calibration: approve it, keep it as a draft, or none."""

    PASS = "pass"  # noqa: S105  a verdict, not a password
    PROVISIONAL = "provisional"
    REFUSE = "refuse"

    @classmethod
    def of(cls, findings: Iterable[Finding]) -> Self:
        """Return the verdict of findings: an error refuses, an unproven finding makes it provisional."""
        severities = {finding.severity for finding in findings}
        if Severity.ERROR in severities:
            return cls.REFUSE
        return cls.PROVISIONAL if Severity.UNPROVEN in severities else cls.PASS


class Limits(Record):
    """Limits of PASS (``wanted``) and of REFUSE (``needed``), from measurements on rendered and real sets.

    Attributes:
        views_needed, views_wanted: number of used views with different poses.
        tilt_needed_deg, tilt_wanted_deg: spread of the board normals in degrees. At 0.5°, fx had an error of ten
            percent.
        kappa2_wanted, kappa2_needed: largest variance factor. Between the two, σ × κ is a valid standard deviation;
            above the second, the views contradict one another.
        reach_needed: distance of corners from the centre, 1 at the image corners. At 0.4, the error at the edge is 15
            px.
        cells_wanted: fraction of 8 × 6 cells with a corner.
        depth_wanted: distance of the farthest corner divided by that of the nearest.
        focal_std_wanted, focal_std_needed: relative standard deviation of fx, with the variance factor.
        condition_needed: condition of the normal matrix, except for models with nearly interchangeable terms.
        rms_wanted, rms_needed: RMS residual relative to the noise of single corners.
        rms_wanted_px, rms_needed_px: RMS residual in px at 20 megapixels; proportionally less for smaller images, but
            at least half of it.
        lost_views_wanted: fraction of the views rejected as outliers.
        stretch_z, stretch_wanted: stretch of the print: significance (in standard deviations) and size.
        edge_px: standard deviation anywhere in the image above which it is mentioned, px.
        nearest_mm, farthest_mm: plausible distances of a board; otherwise the square was given in another unit.
    """

    views_needed: int = 8
    views_wanted: int = 15
    tilt_needed_deg: float = 10.0
    tilt_wanted_deg: float = 20.0
    kappa2_wanted: float = 2.0
    kappa2_needed: float = 100.0
    reach_needed: float = 0.5
    cells_wanted: float = 0.65
    depth_wanted: float = 1.2
    focal_std_wanted: float = 0.001
    focal_std_needed: float = 0.01
    condition_needed: float = 1e8
    rms_wanted: float = 3.0
    rms_needed: float = 10.0
    rms_wanted_px: float = 1.0
    rms_needed_px: float = 3.0
    lost_views_wanted: float = 0.15
    stretch_z: float = 4.0
    stretch_wanted: float = 2e-4
    edge_px: float = 3.0
    nearest_mm: float = 50.0
    farthest_mm: float = 100_000.0


LIMITS: Final = Limits()


class Evidence(Struct, frozen=True, kw_only=True):
    """Measurements that a verdict is based on.

    Attributes:
        image_size: (width, height) px.
        is_board: whether the points are on a board.
        views: number of used views.
        views_shown: number of input views.
        repeats: number of views with the same pose as another.
        views_out, corners_out: numbers of views and corners rejected as outliers.
        geometry: geometry of the views.
        fx, fx_std: focal length near the axis and its standard deviation without the variance factor, px.
        kappa2: variance factor; None if there were too few views.
        rms_px: RMS residual, px.
        noise_px: noise of one coordinate from neighbouring corners, px.
        condition: condition of the normal matrix of the lens.
        model: lens model; the condition of the rational model says little.
        culprits: parameters that are determined worst.
        sound: share of the image with monotonic distortion: within the area of the corners, and overall.
        better: lens model that fits clearly better but was refused; None if there is none.
        edge_px: largest standard deviation in the image with the variance factor, px; None if undetermined.
        warp: test for a board warp.
        is_warped: whether the warp is part of the solution.
        shape: board shape in addition to its warp; None for points without a board.
        is_lifted: whether the board shape is part of the solution.
        stretch: stretch of the print.
        misfit: known faults that may explain the residuals.
        focus: focus setting of the lens, in words; None if unknown.
        unit: unit of lengths: mm, or squares if the size of the squares is unknown.
    """

    image_size: ImageSize
    is_board: bool
    views: int
    views_shown: int
    repeats: int
    views_out: int
    corners_out: int
    geometry: Geometry
    fx: float
    fx_std: float
    kappa2: float | None
    rms_px: float
    noise_px: float | None
    condition: float
    model: Solvable
    culprits: tuple[str, ...]
    sound: tuple[float, float]
    better: Candidate | None
    edge_px: float | None
    warp: WarpTest | None
    is_warped: bool
    shape: BoardShape | None
    is_lifted: bool
    stretch: Stretch | None
    misfit: Misfit | None
    focus: str | None
    unit: str = "mm"

    def length(self, value: float, sign: str = "") -> str:
        """Return a length on the board with its unit."""
        return f"{value:{sign}.{2 if self.unit == 'mm' else 4}f} {self.unit}"
