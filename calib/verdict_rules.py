"""Rules of the verdict: every measurement against its limit, with advice."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Final

from calibrary.calib.budget import Part
from calibrary.calib.misfit import Cause
from calibrary.calib.rejection import in_px
from calibrary.calib.verdict import FOCAL, LIMITS, Evidence, Limits
from calibrary.calibration import ImageSize
from calibrary.policy import FLEET, Policy
from calibrary.probability import two_digits, whole_percent
from calibrary.quality import Proven
from calibrary.records import replace
from calibrary.validation import Finding, Severity

DISAGREE: Final = 1.5
"""Factor κ on the noise above which the views' disagreement is the thing to mend."""


def judge(evidence: Evidence, limits: Limits = LIMITS, policy: Policy = FLEET) -> tuple[Finding, ...]:
    """Check every measurement against its limit; return the findings, most severe first. All rules are evaluated.

    An error forbids every use, an unproven finding that the calibration is kept fixed.
    """
    found = (
        *_views(evidence, limits),
        *_rejected(evidence, limits),
        *_tilt(evidence, limits),
        *_coverage(evidence, limits),
        *_determined(evidence, limits),
        *_fit(evidence, limits),
        *_lens(evidence),
        *_halves(evidence, limits),
        *_cause(evidence, limits),
        *_board(evidence, limits),
        *_capture(evidence),
        *_departs(evidence, policy),
        *_known(evidence, limits, policy),
    )
    remedies = evidence.subject.remedies
    return graver_first(replace(one, remedy=remedies.get(one.rule, one.remedy)) for one in found)


def graver_first(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Sort findings by severity, most severe first, keeping the order within each severity."""
    order = list(Severity)
    return tuple(sorted(findings, key=lambda finding: -order.index(finding.severity)))


def _views(e: Evidence, limits: Limits) -> Iterator[Finding]:
    if e.is_board and e.views < limits.views_wanted:
        yield Finding(
            rule="few-views",
            # What few views do not know is in σ, if there are enough to compare one half with the other.
            severity=Severity.UNPROVEN if e.views < limits.views_fixed else Severity.NOTE,
            measured=e.views,
            limit=limits.views_fixed,
            message=f"{e.views} views count; K is kept fixed from {limits.views_fixed}, and "
            f"{limits.views_wanted} are a good session",
            remedy="take more, each with the board somewhere else",
        )
    if e.repeats:
        yield Finding(
            rule="duplicates",
            severity=Severity.NOTE,
            measured=e.repeats,
            limit=0,
            message=f"{e.repeats} of {e.views_shown} views repeat the pose of another and count once",
            remedy="move the board between the frames",
        )


def _rejected(e: Evidence, limits: Limits) -> Iterator[Finding]:
    share = e.views_out / max(e.views + e.views_out, 1)
    if e.views_out:
        severe = share > limits.lost_views_wanted
        yield Finding(
            rule="views-rejected",
            severity=Severity.UNPROVEN if severe else Severity.NOTE,
            measured=share,
            limit=limits.lost_views_wanted,
            message=f"{_outliers(e.views_out, e.subject.view)}: residuals far larger than the others', because "
            "the camera moved or corners are wrong",
            remedy="look at these frames",
        )
    if e.corners_out:
        yield Finding(
            rule="corners-rejected",
            severity=Severity.NOTE,
            measured=e.corners_out,
            message=_outliers(e.corners_out, f"single {e.subject.point}")
            + (": glare, shadow or something in front of the board" if e.is_board else ""),
        )


def _tilt(e: Evidence, limits: Limits) -> Iterator[Finding]:
    if not e.is_board:
        return
    spread = e.geometry.tilt_spread_deg
    yield from at_least(
        "low-tilt",
        spread,
        (limits.tilt_needed_deg, limits.tilt_wanted_deg),
        f"board normals spread {spread:.0f}°, need {limits.tilt_wanted_deg:.0f}°; a board that is always parallel to "
        "the sensor does not determine the focal length",
        "tilt the board",
    )


def _coverage(e: Evidence, limits: Limits) -> Iterator[Finding]:
    if not e.near >= limits.near_needed:
        yield Finding(
            rule="centre-only",
            severity=Severity.ERROR,
            measured=e.near,
            limit=limits.near_needed,
            message=f"{e.subject.point}s lie near {whole_percent(e.near)} of the {_image(e)}, "
            f"need {limits.near_needed:.0%}: the distortion of the rest is a guess",
            remedy=_where(e),
        )
    where_seen, everywhere = e.sound
    if where_seen < 1:
        yield Finding(
            rule="not-monotonic",
            severity=Severity.ERROR,
            measured=where_seen,
            limit=1.0,
            message=f"the distortion is not monotonic where {e.subject.point}s were seen, so part of the image has no "
            "direction",
            remedy=_where(e),
        )
    elif everywhere < 1:
        yield Finding(
            rule="valid-region",
            severity=Severity.NOTE if limits.edge_wanted_px is None else Severity.UNPROVEN,
            measured=everywhere,
            limit=1.0,
            message=f"the model gives {two_digits(100 * (1 - everywhere))}% of the frame no direction; no "
            f"{e.subject.point} was seen there",
            remedy="where the lens shows an image there: hold the board into it",
        )


def _image(e: Evidence) -> str:
    return "image circle" if e.proven is not None and e.proven.circle_px is not None else "frame"


def _where(e: Evidence) -> str:
    """Return where to hold the board: a circular image has no corners."""
    if e.proven is not None and e.proven.circle_px is not None:
        return "hold the board all around, up to the edge of the image circle"
    return "hold the board into all four corners"


def _known(e: Evidence, limits: Limits, policy: Policy) -> Iterator[Finding]:
    """Check what σ says against the policy: how much of the image is known well enough, and the focal length."""
    proven = e.proven
    if proven is None:
        yield Finding(
            rule="unknown-uncertainty",
            severity=Severity.UNPROVEN,
            message="the standard deviation over the frame cannot be computed: the parameters are all but "
            "interchangeable",
            remedy="take more views, each with the board somewhere else",
        )
    elif not proven.share >= policy.fixed_share:
        known = f"{whole_percent(proven.share)} of the {_image(e)} is proven to {policy.fixed_sigma_px:g} px"
        wide = proven.share < e.near / 2
        yield Finding(
            rule="unproven-region",
            severity=Severity.UNPROVEN,
            measured=proven.share,
            limit=policy.fixed_share,
            message=f"{known}, need {policy.fixed_share:.0%} to keep K fixed"
            + (f"; {e.subject.point}s were seen near {whole_percent(e.near)} of it" if wide else ""),
            remedy="; ".join(_removing(part, e, policy) for part in e.budget.largest) if wide else _where(e),
        )
    elif proven.edge_px > policy.fixed_sigma_px:
        yield _edge(e, proven, limits.edge_wanted_px, policy.fixed_sigma_px)
    yield from at_most(
        FOCAL,
        e.sigma_focal,
        (policy.fixed_sigma_focal, policy.start_sigma_focal),
        f"the standard deviation of the focal length is {_percent(e.sigma_focal)}, need "
        f"{policy.fixed_sigma_focal:.2%} to keep K fixed: {_made_of(e)}",
        _to_narrow(e, policy),
    )


def _percent(share: float) -> str:
    """Return a standard deviation in percent, never rounded to less than it is."""
    return f"{math.ceil(share * 1e4 - 1e-9) / 1e4:.2%}" if math.isfinite(share) else f"{share}"


_SOURCES: Final[Mapping[Part, str]] = {
    Part.NOISE: "noise",
    Part.BOARD_SHAPE: "the shape of the board",
    Part.STRETCHED_PRINT: "the scale of the print",
    Part.LENS_SERIES: "further terms of the lens",
    Part.LENS_DEPARTS: "what the lens departs from its model by",
}


def _made_of(e: Evidence) -> str:
    """Return the largest parts of the focal length's standard deviation."""
    parts = [f"{_percent(e.budget.parts[part])} from {_SOURCES[part]}" for part in e.budget.largest]
    if Part.NOISE in e.budget.largest and e.budget.kappa > DISAGREE:
        at, own = e.budget.largest.index(Part.NOISE), e.budget.parts[Part.NOISE] / e.budget.kappa
        parts[at] += f" ({_percent(own)} × {e.budget.kappa:.1f}, as the {e.subject.view}s disagree)"
    return " and ".join(parts)


def _to_narrow(e: Evidence, policy: Policy) -> str:
    """Return what removes the largest parts of the focal length's standard deviation, and what it is then."""
    return "; ".join(
        f"{_removing(part, e, policy)}: {_percent(_removed(part, e, policy))} then"
        for part in e.budget.largest
    )


def _removing(part: Part, e: Evidence, policy: Policy) -> str:
    match part:
        case Part.BOARD_SHAPE:
            return "glue the print to glass or aluminium"
        case Part.STRETCHED_PRINT:
            return "measure the print along both sides, and print it to scale"
        case Part.LENS_SERIES:
            return _where(e)
        case Part.LENS_DEPARTS:
            return "choose another lens model"
        case Part.NOISE if e.budget.kappa > DISAGREE:
            return _to_agree(e)
        case Part.NOISE:
            return f"take {_enough(e, policy)} views like these {e.budget.views}"


def _removed(part: Part, e: Evidence, policy: Policy) -> float:
    """Return the standard deviation once a part is mended; noise remains, of views that agree or of more views."""
    if part is not Part.NOISE:
        return e.budget.without(part)
    noise = e.budget.parts[part]
    less = e.budget.kappa if e.budget.kappa > DISAGREE else math.sqrt(_enough(e, policy) / e.budget.views)
    return math.hypot(e.budget.without(part), noise / less)


def _enough(e: Evidence, policy: Policy) -> int:
    """Return how many views reach the limit, but at most four times as many as there are, which halve the noise."""
    most = 4 * e.budget.views
    return min(e.budget.views_for(policy.fixed_sigma_focal) or most, most)


def _to_agree(e: Evidence) -> str:
    """Return what keeps views from disagreeing: the remedy of what the residuals show, or what usually does."""
    likely = e.misfit.likely if e.misfit is not None else ()
    return (
        "; or ".join(_CAUSES[one.cause][1] for one in likely)
        or "keep camera and board still, and the board flat"
    )


def _edge(e: Evidence, proven: Proven, wanted: float | None, fixed: float) -> Finding:
    harms = wanted is not None and proven.edge_px > wanted
    unseen, share = whole_percent(1 - e.near), f"{whole_percent(proven.share)} of the {_image(e)}"
    where = (
        f"elsewhere (no {e.subject.point} was seen in {unseen} of the {_image(e)})"
        if e.near <= 0.99
        else "elsewhere"
    )
    message = (
        f"K is proven within {proven.radius_px:.0f} px of the middle ({share}); {where} the standard deviation of a "
        f"projection reaches {two_digits(proven.edge_px)} px"
    )
    if harms:
        message += f", need {wanted:g} px to keep K fixed"
    if e.rival is not None and e.rival[1] > fixed:
        lens, px = e.rival
        message += f": a {lens.value} lens explains the {e.subject.view}s as well, and differs by up to "
        message += f"{two_digits(px)} px"
    return Finding(
        rule="uncertain-edge",
        severity=Severity.UNPROVEN if harms else Severity.NOTE,
        measured=proven.edge_px,
        limit=wanted if harms else fixed,
        message=message,
        remedy=_where(e),
    )


def _determined(e: Evidence, limits: Limits) -> Iterator[Finding]:
    if not e.model.trades_terms:
        yield from at_most(
            "undetermined",
            e.condition,
            (limits.condition_needed, limits.condition_needed),
            f"the {e.subject.view}s hardly separate {', '.join(e.culprits) or 'the parameters'}",
            "tilt the board about both axes and fill the frame",
        )


def size_share(image_size: ImageSize) -> float:
    """Return the factor from residual limits at 20 megapixels to those of this image size."""
    return max(max(image_size) / 5472, 0.5)


def _fit(e: Evidence, limits: Limits) -> Iterator[Finding]:
    share = size_share(e.image_size)
    wanted, needed, than = limits.rms_wanted_px * share, limits.rms_needed_px * share, "images of this size"
    noise = math.inf if e.noise_px is None else e.noise_px * math.sqrt(2)
    if limits.rms_wanted * noise < wanted:
        # The noise determines the limit, but residuals below a quarter of the fixed limit are never a misfit.
        wanted, than = max(limits.rms_wanted * noise, wanted / 4), "the noise of the corners"
        needed = min(needed, max(limits.rms_needed * noise, needed / 4))
    yield from at_most(
        "poor-fit",
        e.rms_px,
        (wanted, needed),
        f"the reprojection error (RMS) is {in_px(e.rms_px)}; {than} allows {wanted:.2f} px, and above {needed:.2f} px "
        "it is refused",
        "check that this is the board, flat and still, at one focus and zoom",
    )


def _lens(e: Evidence) -> Iterator[Finding]:
    if e.better is not None:
        yield Finding(
            rule="lens-model",
            severity=Severity.UNPROVEN,
            message=f"the {e.subject.point}s ask for a {e.better.model.value} lens (RMS {e.better.rms_px:.3f} "
            f"instead of {e.rms_px:.3f} px), which was not taken: {e.better.refused}",
            remedy="take more views, with the board in the corners of the frame",
        )


def _halves(e: Evidence, limits: Limits) -> Iterator[Finding]:
    if e.kappa2 is None:
        yield Finding(
            rule="no-variance-factor",
            severity=Severity.UNPROVEN,
            measured=e.views,
            message="too few views to compare one half with the other",
            remedy="take more",
        )
        return
    if not e.kappa2 <= limits.kappa2_wanted:
        # What the lens departs from its model by is in σ where it lies, if it is all that the views disagree about.
        explained = e.departure is not None and e.departure.is_of_lens
        harms = not e.kappa2 <= limits.kappa2_fixed and not explained
        yield Finding(
            rule="unstable",
            severity=Severity.UNPROVEN if harms else Severity.NOTE,
            measured=e.kappa2,
            limit=limits.kappa2_fixed,
            message=f"the variance factor is {e.kappa2:.1f}: halves of the {e.subject.view}s differ by that many times "
            f"the variance they state, so every σ is multiplied by {math.sqrt(max(e.kappa2, 1.0)):.1f} (σ × κ)"
            + (f"; above {limits.kappa2_fixed:g} K is not kept fixed" if harms else ""),
            remedy=_to_agree(e),
        )


def _departs(e: Evidence, policy: Policy) -> Iterator[Finding]:
    """Check what the lens departs from its model by: what is written is wrong by that, where corners show it."""
    found = e.departure
    if found is None or not found.is_of_lens:
        return
    width, height = e.image_size
    across = ("left", "", "right")[min(int(3 * found.x / width), 2)]
    down = ("top", "", "bottom")[min(int(3 * found.y / height), 2)]
    place = "-".join(word for word in (down, across) if word)
    named = found.px > 3 * found.std_px
    where = f" in the {f'{place} part' if place else 'middle'} of the frame" if named else ""
    limit = policy.fixed_sigma_px
    harms = not found.px <= limit
    yield Finding(
        rule="lens-departs",
        severity=Severity.UNPROVEN if harms else Severity.NOTE,
        measured=found.px,
        limit=limit,
        message=f"the lens departs from its model by up to {two_digits(found.px)} ± {two_digits(found.std_px)} px"
        f"{where}; the standard deviations there contain it"
        + (f", and K is not kept fixed above {limit:g} px" if harms else ""),
        remedy="choose another model" if harms else None,
    )


def _board(e: Evidence, limits: Limits) -> Iterator[Finding]:
    if e.warp is not None and e.warp.keeps_warp:
        w0, w1 = e.warp.warp_mm
        yield Finding(
            rule="board-warp",
            severity=Severity.NOTE if e.is_warped else Severity.UNPROVEN,
            measured=max(abs(w0), abs(w1)),
            message=f"the board is warped by {e.length(w0, '+')} across and {e.length(w1, '+')} down "
            f"(F = {e.warp.f:.0f}); "
            + ("this was solved for" if e.is_warped else "if it is ignored fx is wrong: 0.2 mm make 0.14 %"),
            remedy=None if e.is_warped else "solve for the board's warp",
        )
    if e.shape is not None and e.shape.is_bent:
        yield Finding(
            rule="board-shape",
            severity=Severity.NOTE if e.is_lifted else Severity.UNPROVEN,
            measured=e.shape.largest_mm,
            message=f"the board is bent by up to {e.length(e.shape.largest_mm)} elsewhere than a smooth arch bends it "
            f"(F = {e.shape.f:.1f}); "
            + ("this was solved for" if e.is_lifted else "the standard deviations allow for it"),
            remedy="glue the print to glass or aluminium",
        )
    z = e.stretch
    # Other faults of the views affect z too; the variance factor scales it down accordingly.
    if (
        z is not None
        and abs(z.z) > limits.stretch_z * math.sqrt(max(1.0, e.kappa2 or 1.0))
        and abs(z.value) > limits.stretch_wanted
    ):
        yield Finding(
            rule="stretched-print",
            severity=Severity.UNPROVEN,
            measured=z.value,
            limit=limits.stretch_wanted,
            message=f"squares are {abs(z.value):.3%} {'longer' if z.value > 0 else 'shorter'} down than across "
            f"(± {z.std:.3%})",
            remedy="measure the print along both sides, and print it again to scale",
        )
    distance = e.geometry.distance
    if e.is_board and e.unit == "mm" and not limits.nearest_mm <= distance <= limits.farthest_mm:
        yield Finding(
            rule="wrong-square",
            severity=Severity.UNPROVEN,
            measured=distance,
            limit=limits.nearest_mm if distance < limits.nearest_mm else limits.farthest_mm,
            message=f"the board would be {distance / 1000:.3g} m away; K does not depend on the side of a square, the "
            "poses do",
            remedy="check that the square's side is given in mm",
        )


_CAUSES: Final[Mapping[Cause, tuple[str, str]]] = {
    Cause.ROLLING_SHUTTER: (
        "motion while a rolling shutter reads the frame",
        "put camera and board on stands, or use the mechanical shutter",
    ),
    Cause.FOCUS_CHANGES: (
        "a focus that changes from frame to frame",
        "switch autofocus off and lock the focus",
    ),
    Cause.TWO_CAMERAS: (
        "two cameras or two zoom positions in one set",
        "calibrate each by itself: sort the frames by serial number, lens and focal length",
    ),
    Cause.STABILISED: (
        "electronic stabilisation, which shifts the frame",
        "switch stabilisation (EIS) and horizon levelling off",
    ),
    Cause.BOARD_FLEXES: ("a board that bends in the hand", "glue the print to glass or aluminium"),
    Cause.MOTION_BLUR: (
        "motion while the shutter was open, which blurs corners along one direction",
        "put camera and board on stands, or expose shorter",
    ),
    Cause.STRETCHED_PRINT: (
        "a print that is longer one way",
        "measure the print, and print it again to scale",
    ),
}


def _cause(e: Evidence, limits: Limits) -> Iterator[Finding]:
    """Report one fault if it is clearly better than the others, else the two that explain the residuals best."""
    likely = e.misfit.likely if e.misfit is not None else ()
    if e.misfit is None or not likely or [one.cause for one in likely] == [Cause.STRETCHED_PRINT]:
        return
    contradicted = e.kappa2 is None or e.kappa2 > limits.kappa2_wanted
    moves = max(abs(one.focal) for one in likely)
    harms = e.kappa2 is None or e.kappa2 > limits.kappa2_fixed or (contradicted and moves > e.sigma_focal)
    certain = len(likely) == 1
    severity = Severity.UNPROVEN if harms else Severity.NOTE
    if certain and likely[0].cause is Cause.TWO_CAMERAS and contradicted:
        # A K from views of two cameras applies to neither, whatever its standard deviation.
        severity = Severity.ERROR
    said = ", or ".join(_CAUSES[one.cause][0] for one in likely)
    yield Finding(
        rule=likely[0].cause.value if certain else "unclear-cause",
        severity=severity,
        measured=likely[0].left_px,
        message=f"the {e.subject.view}s differ as by {said}: that leaves {likely[0].left_px:.3f} px of "
        f"{e.misfit.sigma_px:.3f} px by coordinate, and moves the focal length by {moves:.2%}"
        + ("" if certain else "; the residuals do not show which"),
        remedy="; or ".join(_CAUSES[one.cause][1] for one in likely),
    )


def _capture(e: Evidence) -> Iterator[Finding]:
    if e.focus is None:
        yield Finding(
            rule="focus-unknown",
            severity=Severity.NOTE,
            message=f"the {e.subject.frames} do not state how the lens was focused",
            remedy="lock the focus as in flight",
        )
    elif "auto" in e.focus.lower():
        yield Finding(
            rule="focus-not-locked",
            severity=Severity.UNPROVEN,
            message=f"the lens was focused by {e.focus}; from infinity to 1.5 m fx changes by 0.6 % at 8.8 mm",
            remedy="lock the focus as in flight",
        )


def _outliers(number: int, noun: str) -> str:
    return (
        f"{number} {noun} was rejected as an outlier"
        if number == 1
        else f"{number} {noun}s were rejected as outliers"
    )


def at_least(
    rule: str, measured: float, limits: tuple[float, float], message: str, remedy: str
) -> Iterator[Finding]:
    """Yield a finding if a measurement is below what is wanted, the second limit; an error below the first."""
    needed, wanted = limits
    if not measured >= wanted:
        severity = Severity.UNPROVEN if measured >= needed else Severity.ERROR
        yield Finding(
            rule=rule, severity=severity, measured=measured, limit=wanted, message=message, remedy=remedy
        )


def at_most(
    rule: str, measured: float, limits: tuple[float, float], message: str, remedy: str
) -> Iterator[Finding]:
    """Yield a finding if a measurement is above what is wanted, the first limit; an error above the second."""
    wanted, needed = limits
    if not measured <= wanted:
        severity = Severity.UNPROVEN if measured <= needed else Severity.ERROR
        yield Finding(
            rule=rule, severity=severity, measured=measured, limit=wanted, message=message, remedy=remedy
        )
