"""What a calibration from a board consists of."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from msgspec import Struct

from calibrary.arrays import FloatArray
from calibrary.calib.lens_models import Solvable
from calibrary.calib.model_choice import Candidate, WarpTest
from calibrary.calib.observations import Observations
from calibrary.calib.projection_difference import ProjectionDifference, Uncertainty
from calibrary.calib.variance_factor import SplitHalf
from calibrary.calib.verdict import BoardVerdict, Evidence, Limits
from calibrary.calibration import Calibration
from calibrary.records import Record
from calibrary.validation import Finding

__all__ = [
    "CalibrationResult",
    "ControlFit",
    "Dismissal",
    "DismissalReason",
    "FlightGeometry",
    "Flown",
    "OddMark",
    "ViewResult",
]


class DismissalReason(StrEnum):
    """What kind of view does not count."""

    TOO_FEW_CORNERS = "too-few-corners"
    DUPLICATE = "duplicate"
    MISFIT = "misfit"


class Dismissal(Record):
    """A view that does not count, with the reason.

    Attributes:
        reason: by name.
        message: in words, with its number.
    """

    reason: DismissalReason
    message: str


class ViewResult(Struct, frozen=True, kw_only=True, eq=False):
    """One view, whether it counts or not.

    Attributes:
        name: the frame's.
        rms_px: of the corners that count; of all of them where the view does not. None without a pose.
        without: why it does not count, None where it does.
        corners_out: (the board's point, px by which it is off) for each corner rejected.
        rotation: (3, 3) board to camera; None where the view has no pose, as the next two.
        translation_mm: (3,) the middle of the board in the camera frame.
        residuals_px: (N, 2) observed − projected, in the order of the view's corners.
    """

    name: str
    rms_px: float | None = None
    without: Dismissal | None = None
    corners_out: tuple[tuple[int, float], ...] = ()
    rotation: FloatArray | None = None
    translation_mm: FloatArray | None = None
    residuals_px: FloatArray | None = None


class FlightGeometry(Record):
    """How a flight was flown, as its adjustment shows it.

    Attributes:
        focal_by_px: relative change of fx by one pixel of systematic error in images of 1600 px, at its worst.
        relief: standard deviation of the ground's heights as a share of the flying height.
        height_ratio: highest over lowest image above the ground, a tenth of the images at each end left out.
        tilt_deg: nine of ten images look down within this angle.
        headings_deg: largest angle between two images' rows on the ground, at most 90.
        metres: whether the images' positions give the scene its size.
    """

    focal_by_px: float
    relief: float
    height_ratio: float
    tilt_deg: float
    headings_deg: float
    metres: bool


class OddMark(Record):
    """A mark of a surveyed point that does not count.

    Attributes:
        point: its name.
        image: that was marked.
        off_px: from where the camera puts the surveyed place; None where that is behind it.
    """

    point: str
    image: str
    off_px: float | None


class ControlFit(Record):
    """How surveyed points fit a flight.

    Attributes:
        points: that count.
        marks: that count.
        rms_px: root mean square length of the marks' residuals.
        rms_m: root mean square distance of the adjusted points from where they were surveyed.
        worse: how many times worse than stated they fit, at least 1; so many times greater σ they have.
        offset_m: of the images' positions from the points' frame, east, north, up; None where no positions count.
        rejected: the marks that do not count.
    """

    points: int
    marks: int
    rms_px: float
    rms_m: float
    worse: float
    offset_m: tuple[float, float, float] | None = None
    rejected: tuple[OddMark, ...] = ()

    @property
    def words(self) -> str:
        """In words."""
        out = f", {len(self.rejected)} marks left out" if self.rejected else ""
        off = ""
        if self.offset_m is not None:
            east, north, up = self.offset_m
            off = f"; positions are {east:+.2f} m east, {north:+.2f} m north and {up:+.2f} m up of it"
        return (
            f"{self.points} points by {self.marks} marks{out}, rms {self.rms_px:.2f} px in the images and "
            f"{self.rms_m:.3f} m on the ground{off}"
        )


class Flown(Record):
    """What a calibration from a flight has instead of a board.

    Attributes:
        geometry: of the flight.
        fx_held: px, with the principal point held in the middle of the image; None where that was not tried.
        held_weight: 1 where the images cannot tell whether it is there, 0 where they speak against it.
        chosen: how the images were chosen, in words.
        control: of surveyed points; None where there were none.
    """

    geometry: FlightGeometry
    fx_held: float | None = None
    held_weight: float = 0.0
    chosen: str | None = None
    control: ControlFit | None = None


class CalibrationResult(Struct, frozen=True, kw_only=True, eq=False):
    """A calibration with all that speaks for and against it.

    Attributes:
        calibration: K and distortion, its quality with covariance and variance factor, its provenance.
        findings: what speaks against it, the most severe first.
        evidence: what the verdict was judged by.
        limits: that it was judged by.
        model: the lens model, chosen or given.
        candidates: the models that were compared.
        warp: the test for a warped board; None where there was none.
        views: every view that was given, in its order.
        halves: of the views, against one another; None where there were too few.
        half_difference: the same in pixels, for the median split.
        uncertainty: of a direction, in px over the image, the variance factor included.
        observations: what all this was made from.
        versions: of the programs.
        date_origin: where the calibration's date is from, in words; None before it has one.
        flown: of a flight; None for a board or control points.
    """

    calibration: Calibration
    findings: tuple[Finding, ...]
    evidence: Evidence
    limits: Limits
    model: Solvable
    candidates: tuple[Candidate, ...]
    warp: WarpTest | None
    views: tuple[ViewResult, ...]
    halves: SplitHalf | None
    half_difference: ProjectionDifference | None
    uncertainty: Uncertainty | None
    observations: Observations
    versions: Mapping[str, str]
    date_origin: str | None = None
    flown: Flown | None = None

    @property
    def shots(self) -> str:
        """What its views are called."""
        return "images" if self.flown is not None else "views"

    @property
    def verdict(self) -> BoardVerdict:
        """Whether to trust it: the worst finding decides."""
        return BoardVerdict.of(self.findings)

    @property
    def rules(self) -> tuple[str, ...]:
        """The names of the findings."""
        return tuple(finding.rule for finding in self.findings)

    @property
    def rms_by_view(self) -> dict[str, float]:
        """Px by the frame's name, for the views that count."""
        return {
            view.name: view.rms_px for view in self.views if view.rms_px is not None and view.without is None
        }

    @property
    def views_out(self) -> tuple[ViewResult, ...]:
        """The views that do not count."""
        return tuple(view for view in self.views if view.without is not None)
