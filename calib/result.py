"""Result of a calibration."""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import StrEnum
from typing import Annotated, Final, TypeAlias

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray
from calibrary.calib.lens_models import Solvable
from calibrary.calib.model_choice import Candidate, WarpTest
from calibrary.calib.observations import Observations
from calibrary.calib.projection_difference import ProjectionDifference, Uncertainty
from calibrary.calib.variance_factor import SplitHalf
from calibrary.calib.verdict import Evidence, Limits, Uses, uses_of
from calibrary.calibration import Calibration, SourceFile
from calibrary.policy import FLEET, Policy
from calibrary.probability import two_digits
from calibrary.records import Meta, Record
from calibrary.validation import Finding, Use

Numbers: TypeAlias = tuple[float | None, ...]
"""None stands for a number that is not finite."""
Rows: TypeAlias = tuple[Numbers, ...]


def finite(value: float) -> float | None:
    """Return the number, or None if it is not finite and so has no JSON form."""
    return value if math.isfinite(value) else None


def numbers(values: FloatArray) -> Numbers:
    """Return an array (N,) as a record holds it."""
    return tuple(map(finite, values.tolist()))


def rows(values: FloatArray) -> Rows:
    """Return an array (M, N) as a record holds it."""
    if np.isfinite(values).all():
        return tuple(map(tuple, values.tolist()))
    return tuple(map(numbers, values))


class DismissalReason(StrEnum):
    """Kind of reason why a view is not used."""

    TOO_FEW_CORNERS = "too-few-corners"
    DUPLICATE = "duplicate"
    MISFIT = "misfit"


class Dismissal(Record):
    """Reason why a view is not used.

    Attributes:
        reason: code of the reason.
        message: the reason in words, with the measured value.
    """

    reason: DismissalReason
    message: str


class RejectedCorner(Record):
    """A corner that was rejected as an outlier.

    Attributes:
        id: index of the board's point.
        px: its residual.
    """

    id: Annotated[int, Meta(ge=0)]
    px: float


class ViewResult(Record):
    """One view, used or not.

    Attributes:
        name: file name of the image.
        rms_px: reprojection error (RMS) of the used corners; of all corners if the view is not used. None without a
            pose.
        without: reason why the view is not used; None if it is.
        corners_out: the rejected corners.
        rotation: 3 × 3, from board to camera; None without a pose, like the next two.
        translation: position of the board's centre in the camera frame, in the board's unit.
        residuals_px: observed − projected, in the order of the view's corners.
    """

    name: str
    rms_px: float | None = None
    without: Dismissal | None = None
    corners_out: tuple[RejectedCorner, ...] = ()
    rotation: Rows | None = None
    translation: Numbers | None = None
    residuals_px: Rows | None = None


INSEPARABLE: Final = 0.9
BOUNDED: Final = 0.3
"""Limits of the share of a parameter's variance that a nuisance has."""
FOUND_SIGMAS: Final = 3.0


class FlightGeometry(Record):
    """Geometry of a flight, from its adjustment.

    Attributes:
        focal_by_px: largest relative change of fx caused by one pixel of systematic error in images of 1600 px.
        relief: standard deviation of the ground height divided by the flying height.
        height_ratio: highest over lowest flying height, without a tenth of the images at each end.
        tilt_deg: angle from the vertical, in degrees, exceeded by one tenth of the images.
        headings_deg: largest angle between two images' rows on the ground, at most 90 degrees.
        metres: whether the image positions determine the scale of the scene.
    """

    focal_by_px: float
    relief: float
    height_ratio: float
    tilt_deg: float
    headings_deg: float
    metres: bool


class FlightNuisance(Record):
    """What shifted the images of a flight besides the lens, as the adjustment found it.

    Attributes:
        name: what it is, in words.
        unit: of the numbers: "m", "%" or, without positions in metres, "‰ of the flying height".
        value: estimate.
        std: its standard deviation.
        prior: what was known before: mean and standard deviation.
        trades_with: the lens parameter with which it is most correlated.
        share: share of the variance of that parameter that knowing the nuisance would remove.
    """

    name: str
    unit: str
    value: float
    std: Annotated[float, Meta(ge=0)]
    prior: tuple[float, float]
    trades_with: str
    share: Annotated[float, Meta(ge=0, le=1)]

    @property
    def words(self) -> str:
        """What was found, and what it means for K, in one sentence."""
        found = f"{self.name} {self.value:.3g} ± {two_digits(self.std)} {self.unit}"
        if self.share > INSEPARABLE:
            return f"{found}: cannot be told apart from {self.trades_with}, whose σ includes it"
        if abs(self.value) > FOUND_SIGMAS * self.std and self.std < self.prior[1] / 2:
            return f"{found}: found, and taken out of K"
        if self.share > BOUNDED:
            return f"{found}: bounded; σ of {self.trades_with} includes it"
        return f"{found}: hardly touches K"


class OddMark(Record):
    """A rejected image measurement of a surveyed point.

    Attributes:
        point: name of the point.
        image: name of the image.
        off_px: distance from the projection of the surveyed position, px; None if that is behind the camera.
    """

    point: str
    image: str
    off_px: float | None


class ControlFit(Record):
    """Fit of surveyed points to a flight.

    Attributes:
        points: number of used points.
        marks: number of used image measurements.
        rms_px: RMS residual of the image measurements, px.
        rms_m: RMS distance of the adjusted points from their surveyed positions, m.
        worse: ratio of the residuals to the stated standard deviations, at least 1; σ is multiplied by it.
        offset_m: offset of the image positions in the frame of the points (east, north, up), m; None if no positions
            are used.
        rejected: rejected image measurements.
        file: file with the points.
    """

    points: int
    marks: int
    rms_px: float
    rms_m: float
    worse: float
    offset_m: tuple[float, float, float] | None = None
    rejected: tuple[OddMark, ...] = ()
    file: SourceFile | None = None

    @property
    def words(self) -> str:
        """Return a summary in words."""
        left = len(self.rejected)
        out = f", {left} mark{'s' if left > 1 else ''} left out" if left else ""
        off = ""
        if self.offset_m is not None:
            east, north, up = self.offset_m
            off = f"; the images' positions are offset by {east:+.2f} m east, {north:+.2f} m north, {up:+.2f} m up"
        return (
            f"{self.points} points by {self.marks} marks{out}, rms {self.rms_px:.2f} px in the images and "
            f"{self.rms_m:.3f} m on the ground{off.replace('-', '−')}"
        )


class Flown(Record):
    """Further results of a calibration from a flight.

    Attributes:
        geometry: geometry of the flight.
        fx_held: fx in px with the principal point fixed at the image centre; None if not computed.
        held_weight: 1 if the images cannot decide whether the principal point is there, 0 if they contradict it.
        chosen: how the images were selected, in words.
        control: fit of surveyed points; None if there were none.
        nuisances: what else shifted the images.
    """

    geometry: FlightGeometry
    fx_held: float | None = None
    held_weight: float = 0.0
    chosen: str | None = None
    control: ControlFit | None = None
    nuisances: tuple[FlightNuisance, ...] = ()


class CalibrationResult(Struct, frozen=True, kw_only=True, eq=False):
    """A calibration with its findings and evidence.

    Attributes:
        calibration: K and distortion, quality with covariance and variance factor, and provenance.
        findings: problems, most severe first.
        evidence: measurements that the verdict is based on.
        limits: limits of the verdict.
        policy: limits of σ for each use.
        model: lens model, chosen or given.
        candidates: lens models that were compared.
        warp: test for a board warp; None if there was none.
        views: all input views, in input order.
        halves: comparison of halves of the views; None if there were too few.
        half_difference: the same in pixels, for the median split.
        uncertainty: standard deviation of a direction in px over the image, with the variance factor.
        observations: input of the calibration.
        versions: versions of the programs.
        date_origin: source of the calibration's date, in words; None before a date is set.
        flown: results of a flight; None for a board or control points.
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
    policy: Policy = FLEET

    @property
    def uses(self) -> Uses:
        """What the calibration is good for."""
        return uses_of(self.evidence, self.findings, self.policy)

    @property
    def shots(self) -> str:
        """Word for the views in messages."""
        return "images" if self.flown is not None else "views"

    @property
    def verdict(self) -> Use:
        """Verdict, decided by the worst finding."""
        return Use.of(self.findings)

    @property
    def rules(self) -> tuple[str, ...]:
        """Names of the findings."""
        return tuple(finding.rule for finding in self.findings)

    @property
    def rms_by_view(self) -> dict[str, float]:
        """RMS residual in px by image name, for the used views."""
        return {
            view.name: view.rms_px for view in self.views if view.rms_px is not None and view.without is None
        }

    @property
    def views_out(self) -> tuple[ViewResult, ...]:
        """The unused views."""
        return tuple(view for view in self.views if view.without is not None)
