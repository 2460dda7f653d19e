"""Page of a run for a client: subject, what to do first, all cameras with their K."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import date
from typing import Final

from calibrary.calibration import Calibration, Grade
from calibrary.evidence.context import SourceEstimate
from calibrary.jobs.extract.cameras import StateDocument
from calibrary.jobs.extract.extraction import JudgedCamera
from calibrary.jobs.extract.fallback import Fallback
from calibrary.jobs.extract.hand_off import seed_command
from calibrary.jobs.extract.own import known_of
from calibrary.jobs.extract.report import ExtractReport
from calibrary.jobs.survey import Who
from calibrary.pages.plots import Axis, Band, Interval, Role, distortion_map, intervals, radial_curve
from calibrary.pages.wording import (
    SEVERITIES,
    UNPROVEN,
    count,
    cut_table,
    distortion_blocks,
    intrinsics_items,
    known,
    made_by,
    minus,
    several,
)
from calibrary.policy import Policy
from calibrary.provenance import facts
from calibrary.sfm.pixel_check import PixelCheck, PixelVerdict
from calibrary.validation import Report, Verdict
from calibrary.view import (
    Badge,
    Block,
    Bullets,
    Cell,
    Code,
    Column,
    Details,
    Figure,
    KeyValues,
    Link,
    Note,
    Section,
    SideBySide,
    Table,
    Tone,
    View,
)

MOST_DRAWN: Final = 40
"""Most cameras with plots; more would make the page slow to create and to open."""
MOST_CAMERAS: Final = 500
MOST_DUE: Final = 100


def report_page(found: ExtractReport, checked: date | None = None) -> View:
    """Make the page of a run on a day."""
    # Cameras that need attention come first, because a page is read from the top.
    cameras = sorted(found.judged, key=lambda c: -list(Verdict).index(c.verdict))
    shown = cameras[:MOST_CAMERAS]
    sections = [Section(title="What to do first", blocks=tuple(_first(found, cameras)))]
    sections.append(_overview(found, shown))
    sections += [camera_section(c, found.limits, drawn=i < MOST_DRAWN) for i, c in enumerate(shown)]
    if found.rejected or found.skipped:
        sections.append(_skipped(found))
    counts = {verdict: sum(c.verdict is verdict for c in cameras) for verdict in Verdict}
    verdicts = ", ".join(f"{number} {verdict}" for verdict, number in counts.items() if number) or "none"
    good = found.exit_code == 0
    return View(
        title=f"Camera check: {count(len(cameras), 'camera')}",
        badge=Badge("every K is valid", Tone.GOOD) if good else Badge("needs attention", Tone.BAD),
        lead=f"{verdicts[0].upper()}{verdicts[1:]}, judged by the {found.policy} policy. "
        "Only a valid K is handed to a solver.",
        facts=known(
            ("folder", several(found.places) if found.places else None),
            ("flown", _days(found.days)),
            ("checked on", checked),
        ),
        sections=tuple(sections),
        # The overview links to every camera.
        contents=False,
        made_by=made_by(f"from {count(found.images, 'image')}"),
    )


def _days(days: tuple[date, date] | None) -> str | None:
    if days is None:
        return None
    return str(days[0]) if days[0] == days[1] else f"{days[0]} to {days[1]}"


def _first(found: ExtractReport, cameras: Sequence[JudgedCamera]) -> Iterator[Block]:
    """The cameras without a valid K and the images without K, each with the next step."""
    due: list[tuple[Cell, ...]] = [
        (
            Link(camera.name, f"#{camera.slug}"),
            verdict_badge(camera),
            camera.reason or "–",
            camera.advice or "–",
        )
        for camera in cameras
        if camera.verdict is not Verdict.VALID
    ]
    if found.unread is not None:
        reason = found.rejected[0].reason
        others = (
            f"; the others: see {SKIPPED.lower()}" if len(found.rejected) + found.more_rejected > 1 else ""
        )
        action = "copy these files from the camera again, or leave them out"
        due.append(
            (
                Link(found.unread, f"#{SKIPPED_ANCHOR}"),
                Badge("unread", Tone.BAD),
                f"{reason}{others}",
                action,
            )
        )
    if not due:
        yield Note(text="Nothing: every image has a valid K.", tone=Tone.GOOD)
        return
    columns = (Column("camera or images"), Column("verdict"), Column("reason"), Column("do this"))
    caption = "What keeps this flight from being processed as it is"
    yield from cut_table(caption, columns, due, most=MOST_DUE, rest="the report")


SKIPPED: Final = "Images skipped"
SKIPPED_ANCHOR: Final = "images-skipped"


def _overview(found: ExtractReport, cameras: Sequence[JudgedCamera]) -> Section:
    columns = (
        Column("camera"),
        Column("verdict"),
        Column("images", numeric=True),
        Column("fx (px)", numeric=True),
        Column("grade"),
        Column("file with K"),
    )
    blocks: list[Block] = [Note(text=text, tone=Tone.CAUTION) for text in found.warnings]
    blocks.append(
        Table(
            caption="Every camera that was found in the images, those that need attention first",
            columns=columns,
            rows=tuple(_row(camera, found.outputs.matrices.get(camera.slug)) for camera in cameras),
        )
    )
    if len(found.judged) > len(cameras):
        blocks.append(f"{len(found.judged) - len(cameras)} more cameras are in the report only.")
    unmeasured = sum(c.uncalibrated for c in found.judged if c.calibration is not None)
    if unmeasured:
        blocks.append(
            Note(
                text=f"For {count(unmeasured, 'camera')} the principal point and the distortion were not measured: "
                "good enough for a reconstruction to converge, not for survey accuracy."
            )
        )
    if any(c.verdict is Verdict.UNPROVEN for c in found.judged):
        blocks.append(UNPROVEN)
    shown = {c.calibration.grade for c in found.judged if c.calibration is not None}
    blocks.append(Bullets(tuple(f"Grade {g.value}: {g.meaning}." for g in Grade if g in shown)))
    return Section(title="Cameras", blocks=tuple(blocks))


def _row(camera: JudgedCamera, output: str | None) -> tuple[Cell, ...]:
    calibration = camera.calibration
    return (
        Link(camera.name, f"#{camera.slug}"),
        verdict_badge(camera),
        str(camera.camera.count),
        f"{calibration.intrinsics.fx:.2f}" if calibration is not None else "–",
        calibration.grade.value if calibration is not None else "–",
        output or "–",
    )


def _skipped(found: ExtractReport) -> Section:
    set_aside = (*found.rejected, *found.skipped)
    shown = set_aside[:MOST_NAMES]
    table = Table(
        caption="Images of a camera that could not be identified",
        columns=(Column("image"), Column("reason")),
        rows=tuple((item.name, item.reason) for item in shown),
    )
    more, unlisted = len(set_aside) - len(shown), found.more_rejected + found.more_skipped
    told = f"{more} more are listed in the report."
    if unlisted:
        told = f"{more + unlisted} more; the report lists {len(set_aside)} of them all."
    blocks: tuple[Block, ...] = (table, told) if more or unlisted else (table,)
    title = f"{SKIPPED}: {len(set_aside) + unlisted}"
    return Section(title=title, anchor=SKIPPED_ANCHOR, blocks=blocks, printed=False)


VERDICTS: Final = {Verdict.VALID: Tone.GOOD, Verdict.UNPROVEN: Tone.CAUTION, Verdict.REJECTED: Tone.BAD}
PX: Final = Axis("fx", "px")
MOST_NAMES: Final = 200
"""Most image names listed for one state, and for skipped images; the report lists all."""
MOST_STATES: Final = 20


def verdict_badge(camera: JudgedCamera) -> Badge:
    """Badge of the camera's verdict."""
    return Badge(camera.verdict.value, VERDICTS[camera.verdict])


def camera_section(camera: JudgedCamera, policy: Policy, *, drawn: bool) -> Section:
    """Make the section of one camera; details are not printed.

    Args:
        camera: the camera.
        policy: with the limits.
        drawn: whether to include plots.
    """
    blocks = [*_judgement(camera), *_numbers(camera)]
    if drawn:
        plots = [plot for plot in (_evidence(camera, policy),) if plot is not None]
        if camera.calibration is not None and camera.calibration.distortion is not None:
            arrows, _ = distortion_map(camera.calibration)
            plots += [arrows, radial_curve(camera.calibration)]
        blocks += [SideBySide(tuple(plots))] if plots else []
    if camera.pixels is not None:
        blocks += _pixels(camera.pixels)
    blocks += _findings(camera.report)
    blocks += _doubts(camera)
    if camera.fallback is not None:
        blocks += _fallbacks(camera.fallback)
    blocks += _images_by_state(camera)
    return Section(
        title=camera.name,
        badge=verdict_badge(camera),
        anchor=camera.slug,
        blocks=tuple(blocks),
        printed=False,
    )


def _judgement(camera: JudgedCamera) -> Iterator[Block]:
    if camera.reason is not None:
        yield Note(text=camera.reason, action=camera.advice, tone=VERDICTS[camera.verdict])
    known = camera.camera.states[0].known.title
    if known is not None:
        yield f"In the catalogue: {known}."


def _numbers(camera: JudgedCamera) -> Iterator[Block]:
    """K and its data; a rejected K with its numbers, marked as not valid."""
    calibration, failed = camera.calibration, camera.camera.calibration
    if calibration is not None:
        yield KeyValues(tuple(intrinsics_items(calibration)))
        yield _origin(calibration)
        if camera.use is not None:
            yield f"Use in a solver: {camera.use.use}. {camera.use.why[:1].upper()}{camera.use.why[1:]}."
        yield from distortion_blocks(calibration)
        yield from calibration.notes
    elif failed is not None:
        yield Details(
            summary="The rejected intrinsics",
            blocks=(KeyValues(tuple(intrinsics_items(failed))), _origin(failed)),
        )


def _origin(calibration: Calibration) -> str:
    """Origin of K in a sentence."""
    source = calibration.provenance
    told = f"Grade: {calibration.grade.value}, from {source.tag or source.kind}"
    if source.source is not None:
        told += f" of {source.source}"
    if source.adaptation is not None:
        told += f", {source.adaptation}"
    told += "".join(f", {name} {text}" for name, text in facts(source, traced=False))
    if source.assumptions:
        told += f". Assumed: {'; '.join(source.assumptions)}"
    return f"{told}."


def _evidence(camera: JudgedCamera, policy: Policy) -> Figure | None:
    """Plot of the fx of all estimates with the expected range; None without estimates."""
    evidence = camera.camera.evidence
    if not evidence.estimates:
        return None
    doubted = {conflict.other for conflict in evidence.conflicts}

    def role(estimate: SourceEstimate) -> Role:
        if estimate is evidence.chosen:
            return Role.CHOSEN
        if evidence.chosen is None or not estimate.is_whole:
            return Role.NO_K
        return Role.DISAGREES if estimate in doubted else Role.AGREES

    rows = [
        Interval(
            name=estimate.tag,
            value=estimate.intrinsics.fx,
            half_width=estimate.intrinsics.fx * estimate.tolerance,
            role=role(estimate),
        )
        for estimate in evidence.estimates
    ]
    if camera.pixels is not None:
        rows += _of_pixels(camera.pixels)
    caption = "fx as stated by each source in the images"
    caption += "; bars show the rounding of the source" if any(row.half_width for row in rows) else ""
    caption += ", of the pixels ±2 σ." if camera.pixels is not None else "."
    band = _band(camera, policy)
    if band is not None:
        caption += f" Shaded: the range that {band.text} accepts."
    return intervals(rows, axis=PX, caption=caption, band=band)


def _of_pixels(check: PixelCheck) -> Iterator[Interval]:
    """The focal lengths measured from the pixels: of all images, and of pairs of images."""
    agrees = Role.AGREES if check.verdict is PixelVerdict.AGREES else Role.NO_K
    role = Role.DISAGREES if check.verdict is PixelVerdict.CONTRADICTS else agrees
    if check.measured_fx is not None and check.std is not None:
        half = 2 * check.std * check.measured_fx
        yield Interval(
            name=f"pixels of {check.images} images", value=check.measured_fx, half_width=half, role=role
        )
    if check.pair_fx is not None and check.pair_std is not None:
        half = 2 * check.pair_std * check.pair_fx
        yield Interval(
            name=f"{check.pairs} pairs of images", value=check.pair_fx, half_width=half, role=Role.NO_K
        )


def _pixels(check: PixelCheck) -> Iterator[Block]:
    """Result of the check against the pixels, in numbers."""
    rows = [("because", check.reason)]
    rows += [("by the pixels", check.figures)] if check.figures else []
    rows.append(("images", f"{check.images} of {check.chosen} fit one another"))
    if check.pair_fx is not None and check.pair_std is not None:
        rows.append(
            ("by pairs", f"fx = {check.pair_fx:.1f} px ± {check.pair_std:.1%} of {check.pairs} pairs")
        )
    lens = check.distortion
    if lens is not None:
        seen = f"{lens.measured_px:+.1f} ± {lens.std_px:.1f} px, K states {lens.stated_px:+.1f} px"
        rows.append(("distortion at 0.8 of the half diagonal", seen))
    yield f"K compared with the pixels of some images (uncertainties are one σ): {check.verdict.value}."
    yield Bullets(tuple(f"{name}: {told}" for name, told in rows))


def _band(camera: JudgedCamera, policy: Policy) -> Band | None:
    evidence, known = camera.camera.evidence, known_of(camera.camera.survey(policy))
    if policy.known_camera_tolerance is not None and known is not None:
        share = max(policy.known_camera_tolerance, known.claim.tolerance)
        who = "registry" if known.claim.who is Who.ENTRY else "catalogue"
        return Band(known.fx * (1 - share), known.fx * (1 + share), f"the {who}")
    width = evidence.scene.metadata.size[0]
    low, high = policy.focal_over_width
    return Band(low * width, high * width, f"the {policy.name} policy's band")


def _findings(report: Report | None) -> Iterator[Block]:
    if report is None:
        return
    columns = (
        Column("rule"),
        Column("result"),
        Column("measured", numeric=True),
        Column("limit", numeric=True),
        Column("what was found and expected"),
    )
    caption = f"K against the {report.policy} policy"
    table = Table(
        caption=caption,
        columns=columns,
        rows=tuple(
            (
                f.rule,
                Badge(f.severity.value, SEVERITIES[f.severity]),
                _number(f.measured),
                _number(f.limit),
                f.message,
            )
            for f in report.findings
        ),
    )
    if report.verdict is Verdict.VALID:
        yield Details(summary=f"{caption}: {count(len(report.findings), 'finding')}", blocks=(table,))
    else:
        yield table


def _number(value: float | None) -> str:
    return "–" if value is None else minus(f"{value:.3g}")


def _doubts(camera: JudgedCamera) -> Iterator[Block]:
    """Sources that were dropped or contradict K."""
    evidence = camera.camera.evidence
    said = [
        f"{c.other.tag} disagrees with {c.chosen.tag} by {c.difference:+.1%}: {c.cause.value}."
        for c in evidence.conflicts
    ]
    images = camera.camera.count
    for dropped, carrying in camera.camera.dropped:
        of = "" if carrying == images else f" of {carrying} of {images} images"
        said.append(f"{dropped.tag}{of} is not believed: {dropped.reason}.")
    if said:
        yield Bullets(tuple(said))


def _fallbacks(fallback: Fallback) -> Iterator[Block]:
    yield Table(
        caption="What was tried instead of the images' own K, in this order",
        columns=(Column("step"), Column("outcome"), Column("source"), Column("why")),
        rows=tuple((s.step.value, s.outcome.value, s.source or "–", s.why) for s in fallback.steps),
    )
    if fallback.seed is not None:
        command = seed_command(fallback.seed).replace(" && ", " &&\n")
        yield Details(
            summary="To self-calibrate from the seed",
            blocks=(Code(text=command, label=f"COLMAP commands for {fallback.seed.camera}"),),
        )


def _images_by_state(camera: JudgedCamera) -> Iterator[Block]:
    """The images; if there are several states, the data and verdict of each."""
    states = camera.states
    if len(states) > 1:
        yield Table(
            caption="The images by what can change K or its meaning",
            columns=(
                Column("images", numeric=True),
                Column("verdict"),
                Column("grade of their own K"),
                Column("fx (px)", numeric=True),
                Column("firmware"),
                Column("pixels and sources"),
            ),
            rows=tuple(_state_row(state) for state in states[:MOST_STATES]),
        )
        if len(states) > MOST_STATES:
            yield f"{len(states) - MOST_STATES} more states are listed in the report."
    for state in states[:MOST_STATES]:
        yield _names(state.images, state.count)


def _state_row(state: StateDocument) -> tuple[Cell, ...]:
    told = [state.pixels.value, *state.seen, *state.sources]
    if state.inherits:
        told.insert(0, "takes over the camera's K")
    return (
        str(state.count),
        Badge(state.verdict.value, VERDICTS[state.verdict]),
        state.grade.value if state.grade is not None else "–",
        f"{state.intrinsics.fx:.2f}" if state.intrinsics is not None else "–",
        state.firmware or "–",
        "; ".join(told),
    )


def _names(names: tuple[str, ...], total: int) -> Details:
    shown = names[:MOST_NAMES]
    where = ", listed in the report" if total == len(names) else ""
    more = (f"and {total - len(shown)} more{where}",) if total > len(shown) else ()
    return Details(summary=count(total, "image"), blocks=(Bullets((*shown, *more)),))
