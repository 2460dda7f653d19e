"""Whether a calibration may be trusted: PASS, PROVISIONAL or REFUSE, every reason by name with what to do next."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from calibrary.calib.geometry import Geometry
from calibrary.calib.misfit import Shutter, Stretch
from calibrary.calib.model_choice import WarpTest
from calibrary.calibration import ImageSize

__all__ = ["LIMITS", "Evidence", "Limits", "Outcome", "Reason", "Severity", "Verdict", "judge"]


class Outcome(StrEnum):
    """What may be done with the result: approve it, keep it as a draft, or only read the report."""

    PASS = "pass"  # noqa: S105  a verdict, no password
    PROVISIONAL = "provisional"
    REFUSE = "refuse"


class Severity(StrEnum):
    """What one reason does to the outcome."""

    NOTE = "note"
    PROVISIONAL = "provisional"
    REFUSE = "refuse"


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """Where PASS ends (``wanted``) and where REFUSE begins (``needed``); measured on rendered and real sets.

    Attributes:
        views_needed, views_wanted: views that count: other poses, not set aside.
        tilt_needed_deg, tilt_wanted_deg: spread of the boards' normals. At 0.5° fx was wrong by a tenth.
        kappa2_wanted, kappa2_needed: largest κ².
        reach_needed: how far out corners were seen, 1 in the frame's corners. At 0.4 the edge is off by 15 px.
        cells_wanted: fraction of 8 × 6 cells with a corner.
        depth_wanted: farthest over nearest corner.
        focal_std_wanted, focal_std_needed: relative, of fx, κ² included.
        condition_needed: of the normal matrix of the polynomial models; the rational one has its own.
        rms_needed: over the noise of single corners.
        rms_needed_px: of 20 megapixels, smaller frames in proportion but never below half a pixel.
        lost_views_wanted: fraction of the views set aside because they do not fit.
        stretch_z, stretch_wanted: of the print: that sure, and that large.
        edge_px: standard deviation anywhere in the frame above which it is mentioned.
        nearest_mm, farthest_mm: where a board can stand; else the square was given in another unit.
    """

    views_needed: int = 8
    views_wanted: int = 15
    tilt_needed_deg: float = 10.0
    tilt_wanted_deg: float = 20.0
    kappa2_wanted: float = 2.0
    kappa2_needed: float = 4.0
    reach_needed: float = 0.5
    cells_wanted: float = 0.65
    depth_wanted: float = 1.2
    focal_std_wanted: float = 0.001
    focal_std_needed: float = 0.01
    condition_needed: float = 1e8
    rms_needed: float = 3.0
    rms_needed_px: float = 1.0
    lost_views_wanted: float = 0.15
    stretch_z: float = 4.0
    stretch_wanted: float = 2e-4
    edge_px: float = 3.0
    nearest_mm: float = 50.0
    farthest_mm: float = 100_000.0


LIMITS: Final = Limits()


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """What a verdict is judged by.

    Attributes:
        image_size: (width, height) px.
        is_board: whether the points were a board's.
        views: that count.
        views_shown: that were given.
        repeats: that show the pose of another.
        views_out, corners_out: that were set aside because they do not fit.
        geometry: how the board was held.
        fx, fx_std: px, the standard deviation without κ².
        kappa2: None where there were too few views to tell.
        rms_px: of the residuals.
        noise_px: of one coordinate, as neighbouring corners show it.
        condition: of the lens's normal matrix.
        is_rational: whether the model is the rational one, whose condition says little.
        culprits: the parameters that are determined worst.
        folds: whether the lens folds back inside the frame.
        edge_px: largest standard deviation in the frame, κ² included; None where nothing is seen.
        warp: the test for a bent board.
        is_warped: whether the bend is part of the solution.
        stretch: of the print.
        shutter: motion during the read-out.
        focus: how the lens was focused, in words; None where nothing says it.
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
    is_rational: bool
    culprits: tuple[str, ...]
    folds: bool
    edge_px: float | None
    warp: WarpTest | None
    is_warped: bool
    stretch: Stretch | None
    shutter: Shutter | None
    focus: str | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Reason:
    """One thing that was found.

    Attributes:
        code: its name, for programs: "low-tilt".
        severity: what it does to the outcome.
        measured: the number behind it.
        limit: what it was held against, None for a note without one.
        message: what was found, what was wanted and what to do next.
    """

    code: str
    severity: Severity
    measured: float
    limit: float | None
    message: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """An outcome with all of its reasons, the gravest first."""

    outcome: Outcome
    reasons: tuple[Reason, ...]

    @property
    def codes(self) -> tuple[str, ...]:
        """The names of the reasons."""
        return tuple(reason.code for reason in self.reasons)


def judge(evidence: Evidence, limits: Limits = LIMITS) -> Verdict:
    """Hold everything against its limit; nothing stops the rest."""
    order = list(Severity)[::-1]
    reasons = [reason for check in _CHECKS for reason in check(evidence, limits)]
    reasons.sort(key=lambda reason: order.index(reason.severity))
    worst = reasons[0].severity if reasons else Severity.NOTE
    outcome = Outcome.PASS if worst is Severity.NOTE else Outcome(worst.value)
    return Verdict(outcome=outcome, reasons=tuple(reasons))


def _views(e: Evidence, limits: Limits) -> Iterator[Reason]:
    if e.is_board:
        yield from _at_least(
            "few-views",
            e.views,
            (limits.views_needed, limits.views_wanted),
            f"{e.views} views count, need {limits.views_wanted}: take more, each with the board somewhere else",
        )
    if e.repeats:
        yield Reason(
            code="duplicates",
            severity=Severity.NOTE,
            measured=e.repeats,
            limit=0,
            message=f"{e.repeats} of {e.views_shown} views repeat the pose of another and count once: move the board "
            "between the frames",
        )


def _set_aside(e: Evidence, limits: Limits) -> Iterator[Reason]:
    share = e.views_out / max(e.views + e.views_out, 1)
    if e.views_out:
        severe = share > limits.lost_views_wanted
        yield Reason(
            code="views-set-aside",
            severity=Severity.PROVISIONAL if severe else Severity.NOTE,
            measured=share,
            limit=limits.lost_views_wanted,
            message=f"{_count(e.views_out, 'view')} set aside, which fit far worse than the others: the camera "
            "moved, or corners are wrong; look at them",
        )
    if e.corners_out:
        yield Reason(
            code="corners-set-aside",
            severity=Severity.NOTE,
            measured=e.corners_out,
            limit=None,
            message=f"{_count(e.corners_out, 'single corner')} set aside, which lie where the board has none: glare, "
            "shadow or something in front of it",
        )


def _tilt(e: Evidence, limits: Limits) -> Iterator[Reason]:
    if not e.is_board:
        return
    spread = e.geometry.tilt_spread_deg
    yield from _at_least(
        "low-tilt",
        spread,
        (limits.tilt_needed_deg, limits.tilt_wanted_deg),
        f"tilt the board: normals spread {spread:.0f}°, need {limits.tilt_wanted_deg:.0f}°; a board that is always "
        "parallel to the sensor says nothing about the focal length",
    )
    yield from _at_least(
        "one-distance",
        e.geometry.depth_ratio,
        (0.0, limits.depth_wanted),
        f"the farthest corner is {e.geometry.depth_ratio:.2f} times as far as the nearest, need "
        f"{limits.depth_wanted:g}: hold the board nearer and farther",
    )


def _coverage(e: Evidence, limits: Limits) -> Iterator[Reason]:
    seen = e.geometry.coverage
    yield from _at_least(
        "centre-only",
        seen.reach,
        (limits.reach_needed, limits.reach_needed),
        f"corners reach {seen.reach:.0%} of the way to the frame's corners, need {limits.reach_needed:.0%}: "
        "the distortion outside is a guess; hold the board into all four corners",
    )
    yield from _at_least(
        "low-coverage",
        seen.fraction,
        (0.0, limits.cells_wanted),
        f"corners lie in {seen.fraction:.0%} of the frame's cells, need {limits.cells_wanted:.0%}: hold the board "
        "where it has not been yet",
    )
    if e.folds:
        yield Reason(
            code="folds",
            severity=Severity.REFUSE,
            measured=1.0,
            limit=0.0,
            message="the lens model folds back inside the frame, so part of it shows no direction at all: hold the "
            "board into the corners, or choose a simpler model",
        )
    if e.edge_px is not None and e.edge_px > limits.edge_px:
        yield Reason(
            code="uncertain-edge",
            severity=Severity.NOTE,
            measured=e.edge_px,
            limit=limits.edge_px,
            message=f"somewhere at the frame's edge a direction is known to {e.edge_px:.1f} px only: hold the board "
            "further into the corners",
        )


def _focal_length(e: Evidence, limits: Limits) -> Iterator[Reason]:
    spread = e.fx_std / e.fx * math.sqrt(max(1.0, e.kappa2 or 1.0))
    yield from _at_most(
        "uncertain-focal-length",
        spread,
        (limits.focal_std_wanted, limits.focal_std_needed),
        f"fx is known to {spread:.2%}, need {limits.focal_std_wanted:.2%}: more views, more tilt",
    )
    if not e.is_rational:
        yield from _at_most(
            "undetermined",
            e.condition,
            (limits.condition_needed, limits.condition_needed),
            f"the views hardly tell {', '.join(e.culprits) or 'the parameters'} apart: tilt the board about both axes "
            "and fill the frame, or choose a simpler model",
        )


def _fit(e: Evidence, limits: Limits) -> Iterator[Reason]:
    largest = limits.rms_needed_px * max(e.image_size) / 5472
    at_most, than = max(largest, 0.5), "frames of this size"
    if e.noise_px is not None and limits.rms_needed * e.noise_px * math.sqrt(2) < at_most:
        # A quarter of a pixel is no misfit where corners are that hard to see; below that, noise sets the scale.
        at_most, than = max(limits.rms_needed * e.noise_px * math.sqrt(2), 0.25), "the noise of the corners"
    yield from _at_most(
        "poor-fit",
        e.rms_px,
        (at_most, at_most),
        f"rms is {e.rms_px:.2f} px, at most {at_most:.2f} px for {than}: is this the board, flat and still, at one "
        "focus and zoom?",
    )


def _halves(e: Evidence, limits: Limits) -> Iterator[Reason]:
    if e.kappa2 is None:
        yield Reason(
            code="unproven",
            severity=Severity.PROVISIONAL,
            measured=e.views,
            limit=limits.views_needed,
            message="too few views to hold one half against the other: take more",
        )
        return
    yield from _at_most(
        "unstable",
        e.kappa2,
        (limits.kappa2_wanted, limits.kappa2_needed),
        f"halves of the views differ by κ² = {e.kappa2:.1f} times the variance they state, at most "
        f"{limits.kappa2_wanted:g}: something bends or moves, so all standard deviations are "
        f"{math.sqrt(max(e.kappa2, 1.0)):.1f} times too small; mount the board on glass or aluminium, use a tripod",
    )


def _board(e: Evidence, limits: Limits) -> Iterator[Reason]:
    if e.warp is not None and e.warp.keeps_warp:
        w0, w1 = e.warp.warp_mm
        yield Reason(
            code="bent-board",
            severity=Severity.NOTE if e.is_warped else Severity.PROVISIONAL,
            measured=max(abs(w0), abs(w1)),
            limit=None,
            message=f"the board is bent by {w0:+.2f} mm across and {w1:+.2f} mm down (F = {e.warp.f:.0f}); "
            + (
                "this was solved for"
                if e.is_warped
                else "solve for its warp, or fx is wrong: 0.2 mm make 0.14 %"
            ),
        )
    z = e.stretch
    # Whatever else bends the views shows here too; κ² says how much of a z that is worth.
    if (
        z is not None
        and abs(z.z) > limits.stretch_z * math.sqrt(max(1.0, e.kappa2 or 1.0))
        and abs(z.value) > limits.stretch_wanted
    ):
        yield Reason(
            code="stretched-print",
            severity=Severity.PROVISIONAL,
            measured=z.value,
            limit=limits.stretch_wanted,
            message=f"squares are {abs(z.value):.3%} {'longer' if z.value > 0 else 'shorter'} down than across "
            f"(± {z.std:.3%}): measure the print along both sides, and print it again to scale",
        )
    distance = e.geometry.distance_mm
    if e.is_board and not limits.nearest_mm <= distance <= limits.farthest_mm:
        yield Reason(
            code="wrong-square",
            severity=Severity.PROVISIONAL,
            measured=distance,
            limit=limits.nearest_mm if distance < limits.nearest_mm else limits.farthest_mm,
            message=f"the board would stand {distance / 1000:.3g} m away: is the square's side given in mm? "
            "K does not depend on it, the poses do",
        )


def _capture(e: Evidence, limits: Limits) -> Iterator[Reason]:
    del limits
    if e.shutter is not None and e.shutter.is_rolling:
        yield Reason(
            code="rolling-shutter",
            severity=Severity.PROVISIONAL,
            measured=e.shutter.f,
            limit=None,
            message=f"each view is sheared as by motion while its rows were read (F = {e.shutter.f:.1f}): put camera "
            "and board on stands, or use the mechanical shutter",
        )
    words = (e.focus or "").lower()
    if e.focus is None or "auto" in words:
        unknown = e.focus is None
        yield Reason(
            code="focus-unknown" if unknown else "focus-not-locked",
            severity=Severity.NOTE if unknown else Severity.PROVISIONAL,
            measured=0.0,
            limit=None,
            message="the frames do not say how the lens was focused: lock it as in flight"
            if unknown
            else f"the lens was focused by {e.focus}: lock it as in flight; refocusing from infinity to 1.5 m "
            "scales fx by 0.6 % at 8.8 mm",
        )


_CHECKS: Final[tuple[Callable[[Evidence, Limits], Iterator[Reason]], ...]] = (
    _views,
    _set_aside,
    _tilt,
    _coverage,
    _focal_length,
    _fit,
    _halves,
    _board,
    _capture,
)


def _count(number: int, noun: str) -> str:
    return f"{number} {noun} was" if number == 1 else f"{number} {noun}s were"


def _at_least(code: str, measured: float, limits: tuple[float, float], message: str) -> Iterator[Reason]:
    needed, wanted = limits
    if not measured >= wanted:
        severity = Severity.PROVISIONAL if measured >= needed else Severity.REFUSE
        yield Reason(code=code, severity=severity, measured=measured, limit=wanted, message=message)


def _at_most(code: str, measured: float, limits: tuple[float, float], message: str) -> Iterator[Reason]:
    wanted, needed = limits
    if not measured <= wanted:
        severity = Severity.PROVISIONAL if measured <= needed else Severity.REFUSE
        yield Reason(code=code, severity=severity, measured=measured, limit=wanted, message=message)
