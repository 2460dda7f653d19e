"""Verdict on a calibration: the uses that it is good enough for, with its limits and measurements."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from enum import StrEnum
from typing import Final

from msgspec import Struct

from calibrary.calib.board_shape import BoardShape, Stretch
from calibrary.calib.budget import Budget
from calibrary.calib.geometry import Geometry
from calibrary.calib.lens_models import Solvable
from calibrary.calib.misfit import Misfit
from calibrary.calib.model_choice import Candidate, WarpTest
from calibrary.calibration import Grade, ImageSize
from calibrary.policy import Policy
from calibrary.probability import two_digits, whole_percent
from calibrary.quality import Proven
from calibrary.records import Record
from calibrary.validation import Finding, Severity


class Limits(Record):
    """Limits of what is kept fixed (``wanted``) and of what is a start (``needed``) that σ does not say.

    How small σ has to be, and over how much of the image, are limits of the policy. Those here are about what σ cannot
    know, from measurements on rendered and real sets.

    Attributes:
        views_fixed: number of used views with different poses of a K that is kept fixed: from halves of fewer than five
            views κ itself is uncertain.
        views_wanted: number of them that a session should have.
        tilt_needed_deg, tilt_wanted_deg: spread of the board normals in degrees. At 0.5°, fx had an error of ten
            percent and a σ of almost nothing.
        kappa2_wanted: largest variance factor of views that do not contradict one another.
        kappa2_fixed: largest variance factor of a K that is kept fixed. Up to it σ × κ covers what the views disagree
            about: of 43 pairs of halves of 15 real sets none is beyond 3 joint σ. Nine of ten real sets are below it.
        near_needed: share of the image with a corner nearby; with less, the distortion is a guess.
        condition_needed: condition of the normal matrix, except for models with nearly interchangeable terms.
        rms_wanted, rms_needed: RMS residual relative to the noise of single corners.
        rms_wanted_px, rms_needed_px: RMS residual in px at 20 megapixels; proportionally less for smaller images, but
            at least half of it.
        edge_wanted_px: largest σ of a projection in the whole image, which then has a direction everywhere; or None.
        lost_views_wanted: fraction of the views rejected as outliers.
        stretch_z, stretch_wanted: stretch of the print: significance (in standard deviations) and size.
        nearest_mm, farthest_mm: plausible distances of a board; otherwise the square was given in another unit.
    """

    views_fixed: int = 10
    views_wanted: int = 15
    tilt_needed_deg: float = 5.0
    tilt_wanted_deg: float = 20.0
    kappa2_wanted: float = 2.0
    kappa2_fixed: float = 14.0
    near_needed: float = 0.1
    condition_needed: float = 1e8
    rms_wanted: float = 3.0
    rms_needed: float = 10.0
    rms_wanted_px: float = 1.0
    rms_needed_px: float = 3.0
    edge_wanted_px: float | None = None
    lost_views_wanted: float = 0.15
    stretch_z: float = 4.0
    stretch_wanted: float = 2e-4
    nearest_mm: float = 50.0
    farthest_mm: float = 100_000.0


LIMITS: Final = Limits()
FOCAL: Final = "uncertain-focal-length"
"""Rule of the focal length's standard deviation."""


class Departure(Struct, frozen=True, kw_only=True):
    """Where a smooth field of residuals shows that the lens departs most from its model.

    Attributes:
        px: by how much, in px.
        std_px: standard deviation of that, px.
        x, y: the place, px.
        is_of_lens: whether the field explains what the views contradict one another about, as only the lens can.
    """

    px: float
    std_px: float
    x: float
    y: float
    is_of_lens: bool


class Subject(Struct, frozen=True, kw_only=True):
    """What a camera was calibrated from, in words.

    Attributes:
        view, point: one of its images, and of what they show.
        frames: the images as files.
        remedies: what to do by rule, where that differs from what it is with a board.
        grade: of a calibration that is not refused.
    """

    view: str
    point: str
    frames: str
    remedies: Mapping[str, str] = {}
    grade: Grade = Grade.CALIBRATED


BOARD: Final = Subject(view="view", point="corner", frames="frames")


class Evidence(Struct, frozen=True, kw_only=True):
    """Measurements that a verdict is based on.

    Attributes:
        image_size: (width, height) px.
        subject: what the views show, in words.
        is_board: whether the points are on a board.
        views: number of used views.
        views_shown: number of input views.
        repeats: number of views with the same pose as another.
        views_out, corners_out: numbers of views and corners rejected as outliers.
        geometry: geometry of the views.
        fx: focal length near the axis, px.
        budget: what its standard deviation consists of.
        kappa2: variance factor; None if there were too few views.
        rms_px: RMS residual, px.
        noise_px: noise of one coordinate from neighbouring corners, px.
        condition: condition of the normal matrix of the lens.
        model: lens model; the condition of the rational model says little.
        culprits: parameters that are determined worst.
        sound: share of the image with monotonic distortion: within the area of the corners, and overall.
        better: lens model that fits clearly better but was refused; None if there is none.
        proven: where corners prove the calibration to the policy's limit; None if no σ over the image is known.
        departure: what the lens departs from its model by; None if noise explains it.
        rival: the lens of another model that explains the observations as well and differs most, and by how many px.
        near: share of the image with a corner nearby, whatever σ is there.
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
    subject: Subject
    is_board: bool
    views: int
    views_shown: int
    repeats: int
    views_out: int
    corners_out: int
    geometry: Geometry
    fx: float
    budget: Budget
    kappa2: float | None
    rms_px: float
    noise_px: float | None
    condition: float
    model: Solvable
    culprits: tuple[str, ...]
    sound: tuple[float, float]
    better: Candidate | None
    proven: Proven | None
    departure: Departure | None
    rival: tuple[Solvable, float] | None
    near: float
    warp: WarpTest | None
    is_warped: bool
    shape: BoardShape | None
    is_lifted: bool
    stretch: Stretch | None
    misfit: Misfit | None
    focus: str | None
    unit: str = "mm"

    @property
    def edge_px(self) -> float | None:
        """Largest standard deviation of a projection over the image, px; None if it is unknown."""
        return self.proven.edge_px if self.proven is not None else None

    @property
    def sigma_focal(self) -> float:
        """Standard deviation of the focal length as a fraction of it, with the variance factor."""
        return self.budget.total

    def length(self, value: float, sign: str = "") -> str:
        """Return a length on the board with its unit."""
        return f"{value:{sign}.{2 if self.unit == 'mm' else 4}f} {self.unit}"


class AskedUse(StrEnum):
    """A use that a calibration is asked for."""

    FIXED = "fixed"
    MAP = "map"
    START = "start"
    METROLOGY = "metrology"


WORDS: Final[Mapping[AskedUse, str]] = {
    AskedUse.FIXED: "keep it fixed",
    AskedUse.MAP: "keep it fixed for maps placed by GNSS alone",
    AskedUse.START: "start from it",
    AskedUse.METROLOGY: "measure with it",
}


class UseCheck(Record):
    """Whether a calibration is good enough for a use.

    Attributes:
        use: the use.
        holds: whether it is.
        why: the numbers that decide, in words.
        against: rules of the findings that forbid it.
    """

    use: AskedUse
    holds: bool
    why: str
    against: tuple[str, ...] = ()

    def __str__(self) -> str:
        said = f": {self.why}" if self.why else ""
        return f"{'yes' if self.holds else 'no'}{said}"

    @property
    def words(self) -> str:
        """The use in words."""
        return WORDS[self.use]


class Uses(Record):
    """What a calibration is good for.

    Attributes:
        sigma_px: standard deviation of a projection where corners prove it, px; None if nothing is proven.
        edge_px: the same over the whole image; None if it is unknown.
        radius_px: K is proven within this distance of the middle of the image, px.
        share: share of the image that is proven: corners nearby, and a standard deviation of at most limit_px.
        limit_px: largest standard deviation of a projection of a K that is kept fixed, px.
        sigma_focal: standard deviation of the focal length as a fraction of it.
        flying_height_m: height above ground for the next two.
        height_cm: standard deviation of a height from there, cm.
        position_cm: standard deviation on the ground of a projection where it is proven, cm.
        checks: the uses.
    """

    sigma_px: float | None
    edge_px: float | None
    radius_px: float
    share: float
    limit_px: float
    sigma_focal: float
    flying_height_m: float
    height_cm: float
    position_cm: float | None
    checks: tuple[UseCheck, ...]

    def of(self, use: AskedUse) -> UseCheck:
        """Return the check of a use."""
        return next(one for one in self.checks if one.use is use)

    def shown(self, asked: AskedUse) -> tuple[UseCheck, ...]:
        """Return the checks that answer who asked for a use: maps count where K is not kept fixed anyway."""
        beside = {AskedUse.START, asked} | (set() if self.of(AskedUse.FIXED).holds else {AskedUse.MAP})
        return tuple(one for one in self.checks if one.use in {AskedUse.FIXED, *beside})


def uses_of(evidence: Evidence, findings: Iterable[Finding], policy: Policy) -> Uses:
    """Return what a judged calibration is good for.

    Args:
        evidence: measurements.
        findings: what was found, by the policy's limits; an error forbids every use, an unproven one all but a start.
        policy: limits.
    """
    findings, proven = tuple(findings), evidence.proven
    errors = tuple(one.rule for one in findings if one.severity is Severity.ERROR)
    unproven = tuple(one.rule for one in findings if one.severity is Severity.UNPROVEN)
    height_cm = 100 * policy.flying_height_m * evidence.sigma_focal
    known = _numbers(evidence, policy, height_cm)
    loose = tuple(_too_loose(proven, evidence.sigma_focal, policy))
    for_maps = tuple(_against_maps(unproven, evidence.sigma_focal, policy))
    return Uses(
        sigma_px=proven.sigma_px if proven is not None else None,
        edge_px=proven.edge_px if proven is not None else None,
        radius_px=proven.radius_px if proven is not None else 0.0,
        share=proven.share if proven is not None else 0.0,
        limit_px=policy.fixed_sigma_px,
        sigma_focal=evidence.sigma_focal,
        flying_height_m=policy.flying_height_m,
        height_cm=height_cm,
        position_cm=_on_ground(proven, evidence.fx, policy),
        checks=(
            _check(AskedUse.FIXED, known, (*errors, *unproven)),
            _check(AskedUse.MAP, _height(height_cm, policy, policy.map_sigma_focal), (*errors, *for_maps)),
            _check(AskedUse.START, f"f is known to {evidence.sigma_focal:.2%}", errors),
            _check(AskedUse.METROLOGY, known, (*errors, *unproven, *loose)),
        ),
    )


def _check(use: AskedUse, known: str, against: tuple[str, ...]) -> UseCheck:
    said = f"{known}; {', '.join(against)}" if against else known
    return UseCheck(use=use, holds=not against, why=said, against=against)


def _numbers(e: Evidence, policy: Policy, height_cm: float) -> str:
    height, proven = _height(height_cm, policy, policy.fixed_sigma_focal), e.proven
    if proven is None:
        return f"σ over the frame is unknown, {height}"
    image = "image circle" if proven.circle_px is not None else "frame"
    limit = f"{whole_percent(proven.share)} of the {image} is proven to {policy.fixed_sigma_px:g} px"
    if proven.sigma_px is None:
        return f"no part of the {image} is proven to {policy.fixed_sigma_px:g} px, {height}"
    edge = f", {two_digits(proven.edge_px)} px at its edge" if proven.edge_px > policy.fixed_sigma_px else ""
    return f"{two_digits(proven.sigma_px)} px within {proven.radius_px:.0f} px of the middle{edge} ({limit}), {height}"


def _height(height_cm: float, policy: Policy, sigma_focal: float) -> str:
    limit = two_digits(100 * policy.flying_height_m * sigma_focal)
    return f"{two_digits(height_cm)} cm of height at {policy.flying_height_m:g} m (limit {limit} cm)"


def _against_maps(unproven: Iterable[str], sigma_focal: float, policy: Policy) -> Iterator[str]:
    """Yield what forbids a K in maps whose heights GNSS alone places: only the limit of the focal length is wider."""
    yield from (rule for rule in unproven if rule != FOCAL)
    if not sigma_focal <= policy.map_sigma_focal:
        yield f"above {policy.map_sigma_focal:.2%} of f"


def _on_ground(proven: Proven | None, fx: float, policy: Policy) -> float | None:
    if proven is None or proven.sigma_px is None:
        return None
    return 100 * policy.flying_height_m * proven.sigma_px / fx


def _too_loose(proven: Proven | None, sigma_focal: float, policy: Policy) -> Iterator[str]:
    if proven is None or proven.sigma_px is None or proven.sigma_px > policy.metrology_sigma_px:
        yield f"above {policy.metrology_sigma_px:g} px"
    if sigma_focal > policy.metrology_sigma_focal:
        yield f"above {policy.metrology_sigma_focal:.2%} of f"
