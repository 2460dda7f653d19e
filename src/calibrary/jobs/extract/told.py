"""What a run shows: every camera with its K and what to do, the files, and of each camera all that was weighed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from datetime import date
from functools import partial
from pathlib import Path
from typing import Final

from msgspec import Struct

from calibrary.calibration import Calibration, Grade
from calibrary.errors import first_of
from calibrary.evidence.context import SourceEstimate
from calibrary.jobs.extract.cameras import StateDocument
from calibrary.jobs.extract.extraction import JudgedCamera
from calibrary.jobs.extract.fallback import Fallback
from calibrary.jobs.extract.hand_off import HandedCamera, HandOff
from calibrary.jobs.extract.report import CameraDocument, ExtractReport, Outputs
from calibrary.jobs.extract.targets import seed_command
from calibrary.jobs.survey import Who
from calibrary.pages.plots import Axis, Band, Interval, Role, distortion_map, intervals, radial_curve
from calibrary.pages.wording import (
    SEVERITIES,
    UNPROVEN,
    count,
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
from calibrary.validation import Report, Severity, Verdict
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
    Plots,
    Section,
    Table,
    Tone,
    View,
)

MOST_DRAWN: Final = 40
"""Most cameras with plots; more would make the page slow to create and to open."""
MOST_CAMERAS: Final = 500
MOST_VALID: Final = 10
"""Most valid cameras with a row of their own."""
FEW: Final = 3
"""So many causes for which images have no camera, and files, are named one by one."""
SET_ASIDE: Final = "images-skipped"
UNREAD_ADVICE: Final = "copy these files from the camera again, or leave them out"


class Row(Struct, frozen=True, kw_only=True):
    """A row of the answer: a camera, cameras with one cause, or images that have none."""

    camera: Cell
    verdict: Badge
    use: str = ""
    grade: str = ""
    images: int
    fx: str = ""
    why: str = ""
    do: str = ""


CAMERAS: Final = (
    Column("camera", lambda row: row.camera),
    Column("verdict", lambda row: row.verdict),
    Column("use", lambda row: row.use, rank=2),
    Column("grade", lambda row: row.grade, rank=3),
    Column("images", lambda row: str(row.images), numeric=True, rank=4),
    Column("fx (px)", lambda row: row.fx, numeric=True, rank=1),
    Column("why", lambda row: row.why, below=""),
    Column("what to do", lambda row: row.do, below="→ "),
)
"""May I use it, as what, how is it known; and what keeps it from being used."""
HANDED: Final = (
    Column("camera", lambda alike: first_of([one.camera for one in alike], 1)),
    Column("images", lambda alike: str(sum(one.images for one in alike)), numeric=True),
    Column("use", lambda alike: alike[0].use),
    Column("into", lambda alike: first_of({one.into or "stays out": 0 for one in alike}, 1), rank=1),
    Column("named", lambda alike: first_of({one.name or "": 0 for one in alike}, 1), rank=2),
    Column("why", lambda alike: alike[0].why, below=""),
)
"""Cameras that are handed on alike share a row."""


def told(found: ExtractReport, *, checked: date | None = None, files: bool = False) -> View:
    """Describe a run; of one that was read from its file there is the answer alone.

    Args:
        found: the result.
        checked: the day of the check, if the description is kept.
        files: whether to say where its files are, which only those read who made them.
    """
    # Cameras that need attention come first.
    judged = sorted(found.judged, key=lambda c: -list(Verdict).index(c.verdict))[:MOST_CAMERAS]
    sections = [_answer(found)]
    if files and found.outputs.files:
        sections.append(_files(found.outputs))
        sections += [_handed(found.hand_off)] if found.hand_off and not found.hand_off.failed else []
    sections += [camera_section(c, found.limits, drawn=i < MOST_DRAWN) for i, c in enumerate(judged)]
    if found.rejected or found.skipped:
        sections.append(_set_aside(found))
    counts = Counter(camera.verdict for camera in found.cameras)
    verdicts = ", ".join(f"{counts[verdict]} {verdict}" for verdict in Verdict if counts[verdict]) or "none"
    unread = f"; {found.unread}" if found.unread else ""
    is_good = found.exit_code == 0
    return View(
        title=f"Camera check: {count(len(found.cameras), 'camera')}",
        badge=Badge("every K is valid", Tone.GOOD) if is_good else Badge("needs attention", Tone.BAD),
        lead=f"{count(len(found.cameras), 'camera')}, judged by the {found.policy} policy: {verdicts}{unread}",
        facts=known(
            ("folder", several(found.places) if found.places else None),
            ("flown", _days(found.days)),
            ("checked on", checked),
        ),
        sections=tuple(sections),
        made_by=made_by(f"from {count(found.images, 'image')}"),
    )


def _days(days: tuple[date, date] | None) -> str | None:
    if days is None:
        return None
    return str(days[0]) if days[0] == days[1] else f"{days[0]} to {days[1]}"


def _answer(found: ExtractReport) -> Section:
    """Every camera, those that need attention first and those with one cause together, and what else is to be known."""
    caption = "May a K be used, as what, and how it is known; what needs attention first"
    blocks: list[Block] = [Table.of(caption, _rows(found), CAMERAS)]
    blocks += [UNPROVEN] if any(c.verdict is Verdict.UNPROVEN for c in found.cameras) else []
    unmeasured = sum(c.uncalibrated for c in found.cameras if c.calibration is not None)
    if unmeasured:
        blocks.append(
            Note(
                text=f"uncalibrated: for {unmeasured} of {count(len(found.cameras), 'camera')} the principal point "
                "and the distortion were not measured; good enough for SfM to converge, not for survey accuracy"
            )
        )
    if found.skipped:
        first, more = found.skipped[0], len(found.skipped) + found.more_skipped - 1
        others = f" and {more} more" if more else ""
        blocks.append(f"Skipped, because no camera took it: {first.name}{others}: {first.reason}")
    blocks += [Note(text=text, tone=Tone.CAUTION) for text in found.warnings]
    grades = {c.calibration.grade for c in found.cameras if c.calibration is not None}
    words = (
        "verdict: whether something contradicts K, or nothing confirms it.",
        "use: what a solver may do with K: keep it fixed, start from it and refine it, or none of the two.",
        *(f"grade {one.value}: {one.meaning}." for one in Grade if one in grades),
    )
    blocks.append(Details(summary="What the words mean", blocks=(Bullets(words),)))
    return Section(title="Cameras", blocks=tuple(blocks))


def _rows(found: ExtractReport) -> Iterator[Row]:
    """The rows of the answer: by verdict, worst first; cameras with one cause share one."""
    causes: dict[object, list[CameraDocument]] = {}
    for camera in found.cameras:
        causes.setdefault(_cause(camera), []).append(camera)
    for verdict in reversed(Verdict):
        alike = [cameras for cameras in causes.values() if cameras[0].verdict is verdict]
        yield from (_row(cameras) for cameras in alike if verdict is not Verdict.VALID)
        if verdict is Verdict.REJECTED:
            yield from _unread(found)
    valid = [cameras for cameras in causes.values() if cameras[0].verdict is Verdict.VALID]
    yield from map(_row, valid[:MOST_VALID])
    if more := [camera for cameras in valid[MOST_VALID:] for camera in cameras]:
        images = sum(camera.count for camera in more)
        yield Row(camera=f"{len(more)} more", verdict=Badge(Verdict.VALID.value, Tone.GOOD), images=images)


def _cause(camera: CameraDocument) -> object:
    """What cameras with one cause have in common; a valid one is alone."""
    if camera.verdict is Verdict.VALID:
        return camera.id
    rules = tuple(one.rule for one in camera.findings if one.severity in {Severity.ERROR, Severity.UNPROVEN})
    return camera.verdict, camera.use and camera.use.use, rules or camera.why, camera.what_to_do


def _row(cameras: Sequence[CameraDocument]) -> Row:
    first, focal = cameras[0], [c.calibration.intrinsics.fx for c in cameras if c.calibration is not None]
    more = f" and {len(cameras) - 1} more" if len(cameras) > 1 else ""
    fx = f"{min(focal):.2f}" if focal else ""
    if focal and f"{max(focal):.2f}" != fx:
        fx = f"{min(focal):.0f} … {max(focal):.0f}"
    grades = dict.fromkeys(c.calibration.grade.value for c in cameras if c.calibration is not None)
    taken = first.fallback[0].source if first.fallback and first.why is None else None
    return Row(
        camera=Link(f"{first.name}{more}", f"#{first.id}"),
        verdict=Badge(first.verdict.value, VERDICTS[first.verdict]),
        use=first.use.use.value if first.use is not None else "",
        grade=", ".join(grades),
        images=sum(camera.count for camera in cameras),
        fx=fx,
        why=f"K from {taken} of the registry" if taken else first.why or _seen(first),
        do=first.what_to_do or "",
    )


def _seen(camera: CameraDocument) -> str:
    """What the pixels say of a valid K, where they were asked."""
    check = camera.pixels
    if check is None:
        return ""
    seen = {
        PixelVerdict.AGREES: "agree",
        PixelVerdict.CONTRADICTS: "contradict it",
        PixelVerdict.CANNOT_TELL: "cannot tell",
    }
    return f"the pixels of {check.images} images {seen[check.verdict]}: {check.reason}"


def _unread(found: ExtractReport) -> Iterator[Row]:
    """The images and folders that cannot be read, by reason."""
    reasons: dict[str, list[str]] = {}
    for one in found.rejected:
        reasons.setdefault(one.reason, []).append(one.name)
    badge, rest = Badge("unread", Tone.BAD), found.more_rejected
    for number, (reason, names) in enumerate(reasons.items()):
        if number < FEW:
            yield Row(
                camera=first_of(names, 1), verdict=badge, images=len(names), why=reason, do=UNREAD_ADVICE
            )
        else:
            rest += len(names)
    if rest:
        yield Row(camera=f"{rest} more", verdict=badge, images=rest)


def _files(outputs: Outputs) -> Section:
    """What was written, and what a program was given."""
    names = [*map(str, outputs.files)] if len(outputs.files) <= FEW else [*_in_short(outputs.files)]
    said = [", ".join(names)]
    if outputs.database is not None:
        said.append(f"{outputs.database.path}: {count(len(outputs.database.after), 'camera')}")
    title = "Would be written" if outputs.is_dry_run else "Written"
    return Section(title=title, blocks=tuple(said))


def _handed(plan: HandOff) -> Section:
    """What a program gets of each camera, and what to run; if it gets nothing, a warning says why."""
    alike: dict[tuple[str, str], list[HandedCamera]] = {}
    for one in plan.cameras:
        alike.setdefault((one.use, one.why), []).append(one)
    table = Table.of("Which images it gets, with which K, and which stay out", alike.values(), HANDED)
    more = len(plan.commands) - FEW
    commands = [f"→ {one}" for one in plan.commands[:FEW]] + ([f"→ … {more} more"] if more > 0 else [])
    return Section(title=f"To {plan.program}", blocks=(table, *commands))


def _in_short(files: Iterable[Path]) -> Iterator[str]:
    """Names of the files; several files of K by their common form."""
    kinds: dict[Path, list[Path]] = {}
    for path in files:
        kind = path.with_name(f"{path.name.partition('.')[0]}.*.npy") if path.suffix == ".npy" else path
        kinds.setdefault(kind, []).append(path)
    for kind, alike in kinds.items():
        yield f"{kind} ({len(alike)} files)" if len(alike) > 1 else str(alike[0])


def _set_aside(found: ExtractReport) -> Section:
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
    title = f"Images skipped: {len(set_aside) + unlisted}"
    return Section(title=title, anchor=SET_ASIDE, blocks=blocks, printed=False)


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
    if drawn and (camera.camera.evidence.estimates or camera.calibration is not None):
        blocks.append(Plots(partial(_plots, camera, policy)))
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


def _plots(camera: JudgedCamera, policy: Policy) -> Iterator[Figure]:
    if (evidence := _evidence(camera, policy)) is not None:
        yield evidence
    if camera.calibration is not None and camera.calibration.distortion is not None:
        yield distortion_map(camera.calibration)
        yield radial_curve(camera.calibration)


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
    doubted = _contradicting(camera, policy)

    def role(estimate: SourceEstimate) -> Role:
        if estimate is evidence.chosen:
            return Role.CHOSEN
        if evidence.chosen is None or not estimate.is_whole:
            return Role.NO_K
        return Role.DISAGREES if estimate.tag in doubted else Role.AGREES

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


def _contradicting(camera: JudgedCamera, policy: Policy) -> set[str]:
    """The names of the tags that contradict the one that gives the images' K."""
    survey, chosen = camera.camera.survey(policy), camera.camera.evidence.chosen
    own = next((one for one in survey.claims if chosen is not None and one.name == chosen.tag), None)
    return {one.one.claim.name for one in survey.weigh(own).against} if own is not None else set()


def _band(camera: JudgedCamera, policy: Policy) -> Band | None:
    evidence, known = camera.camera.evidence, camera.camera.survey(policy).known
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
    """Sources that were dropped."""
    said = []
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
