"""Result of a calibration."""

from __future__ import annotations

import math
from collections.abc import Mapping
from enum import StrEnum
from typing import Annotated, Any, Final, Literal, TypeAlias

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.board import Board
from calibrary.calib.board_shape import Stretch
from calibrary.calib.geometry import Geometry
from calibrary.calib.lens_models import Solvable
from calibrary.calib.misfit import Misfit
from calibrary.calib.model_choice import Candidate
from calibrary.calib.observations import Observations
from calibrary.calib.projection_difference import Uncertainty
from calibrary.calib.verdict import Evidence, Limits, Uses
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


LENGTH_UNITS: Final[Mapping[str, Literal["mm", "units"]]] = {"mm": "mm", "units": "units"}
LEFT_OUT: Final[Any] = None
"""Default of what only this process knows."""


class CalibrationResult(Record):
    """A calibration with its verdict and the evidence for it.

    Attributes:
        verdict: what a solver may do with K; the most severe finding decides.
        uses: what K is good for, with the numbers that decide.
        findings: problems, most severe first, each with its remedy.
        calibration: K and distortion with their quality, and a provenance with date and source images.
        target: the board or the points that the images show, in words.
        board: the board; None for points.
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
        date_origin: source of provenance.date, in words; None before a date is set.
        flown: only for a calibration from a flight; ground points take the place of board corners.
        evidence: measurements that the verdict is based on.
        uncertainty: standard deviation of a direction in px over the image, with the variance factor.
        observations: input of the calibration.
        policy: limits of σ for each use.
    """

    _unwritten = frozenset({"evidence", "uncertainty", "observations", "policy"})

    verdict: Use
    uses: Uses
    findings: tuple[Finding, ...]
    calibration: Calibration
    target: str
    board: Board | None
    model: Solvable
    candidates: tuple[Candidate, ...]
    warp: Warp | None
    views: tuple[ViewResult, ...]
    geometry: Geometry
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
    date_origin: str | None = None
    flown: Flown | None = None
    evidence: Evidence = LEFT_OUT
    uncertainty: Uncertainty | None = None
    observations: Observations = LEFT_OUT
    policy: Policy = FLEET

    @property
    def shots(self) -> str:
        """Word for the views in messages."""
        return "images" if self.flown is not None else "views"

    @property
    def points(self) -> str:
        """Word for what is seen in them."""
        return "points" if self.flown is not None else "corners"

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
