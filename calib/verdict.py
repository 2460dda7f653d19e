"""Whether a calibration may be trusted: PASS, PROVISIONAL or REFUSE, by what it is judged and against which limits."""

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
    """What may be done with a calibration: approve it, keep it as a draft, or only read its report."""

    PASS = "pass"  # noqa: S105  a verdict, no password
    PROVISIONAL = "provisional"
    REFUSE = "refuse"

    @classmethod
    def of(cls, findings: Iterable[Finding]) -> Self:
        """The worst finding decides: an error refuses, what is unproven makes it provisional."""
        severities = {finding.severity for finding in findings}
        if Severity.ERROR in severities:
            return cls.REFUSE
        return cls.PROVISIONAL if Severity.UNPROVEN in severities else cls.PASS


class Limits(Record):
    """Where PASS ends (``wanted``) and where REFUSE begins (``needed``); measured on rendered and real sets.

    Attributes:
        views_needed, views_wanted: views that count: other poses, not rejected.
        tilt_needed_deg, tilt_wanted_deg: spread of the boards' normals. At 0.5° fx was wrong by a tenth.
        kappa2_wanted, kappa2_needed: largest variance factor. Between the two σ × κ holds, and says what the
            numbers are worth; past the second the views contradict one another.
        reach_needed: how far out corners were seen, 1 in the frame's corners. At 0.4 the edge is off by 15 px.
        cells_wanted: fraction of 8 × 6 cells with a corner.
        depth_wanted: farthest over nearest corner.
        focal_std_wanted, focal_std_needed: relative, of fx, the variance factor included.
        condition_needed: of the normal matrix, but for the models whose terms stand in for one another.
        rms_wanted, rms_needed: over the noise of single corners.
        rms_wanted_px, rms_needed_px: of 20 megapixels, smaller frames in proportion but never below half of it.
        lost_views_wanted: fraction of the views rejected as outliers.
        stretch_z, stretch_wanted: of the print: that sure, and that large.
        edge_px: standard deviation anywhere in the frame above which it is mentioned.
        nearest_mm, farthest_mm: where a board can stand; else the square was given in another unit.
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
    """What a verdict is judged by.

    Attributes:
        image_size: (width, height) px.
        is_board: whether the points were a board's.
        views: that count.
        views_shown: that were given.
        repeats: that show the pose of another.
        views_out, corners_out: that were rejected as outliers.
        geometry: how the board was held.
        fx, fx_std: px, of the camera near its axis; the standard deviation without the variance factor.
        kappa2: the variance factor; None where there were too few views.
        rms_px: of the residuals.
        noise_px: of one coordinate, as neighbouring corners show it.
        condition: of the lens's normal matrix.
        model: of the lens; the rational one's condition says little.
        culprits: the parameters that are determined worst.
        sound: share of the frame in which the distortion is monotonic: of where corners were seen, and of all of it.
        better: a lens model that the corners ask for and that could not be taken; None where there is none.
        edge_px: largest standard deviation in the image, the variance factor included; None where nothing is seen.
        warp: the test for a warped board.
        is_warped: whether the warp is part of the solution.
        shape: of the board but for its warp; None for points on no board.
        is_lifted: whether that shape is part of the solution.
        stretch: of the print.
        misfit: which known fault explains what the camera does not.
        focus: how the lens was focused, in words; None where nothing says it.
        unit: that lengths are counted in: mm, or squares of the board where their side is not known.
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
        """A length on the board, with its unit."""
        return f"{value:{sign}.{2 if self.unit == 'mm' else 4}f} {self.unit}"
