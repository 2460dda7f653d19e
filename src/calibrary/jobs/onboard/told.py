"""What a payload shows: for every camera the decision, all estimates, the entry, and entries of the same model."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Final

from calibrary.jobs.calibrate.page_plots import fit_plots, lens_plots
from calibrary.jobs.calibrate.told import OUTCOMES
from calibrary.jobs.onboard.report import (
    Agreement,
    CameraDecision,
    Decision,
    Estimate,
    ImageSolve,
    Kind,
    OnboardReport,
    ProposedEntry,
    RelatedEntry,
)
from calibrary.pages.plots import Axis, Interval, Role, intervals
from calibrary.pages.wording import (
    SEVERITIES,
    UNPROVEN,
    count,
    intrinsics_items,
    made_by,
    minus,
    sentence,
)
from calibrary.provenance import facts
from calibrary.validation import Finding, Severity
from calibrary.view import (
    Badge,
    Block,
    Bullets,
    Cell,
    Column,
    Details,
    Figure,
    KeyValues,
    Note,
    Plots,
    Section,
    Table,
    Tone,
    View,
)

STANDINGS: Final = {
    "proposed": Tone.NEUTRAL,
    "in dispute": Tone.NEUTRAL,
    "not believed": Tone.CAUTION,
    Agreement.AGREES: Tone.GOOD,
    Agreement.DIFFERS: Tone.CAUTION,
    Agreement.DISAGREES: Tone.BAD,
}
DECISIONS: Final = {
    Decision.PROPOSED: Tone.GOOD,
    Decision.READY: Tone.CAUTION,
    Decision.KNOWN: Tone.NEUTRAL,
    Decision.REFUSED: Tone.BAD,
}
PX: Final = Axis("fx", "px")
MOST_ROWS: Final = 200
FEW: Final = 8
"""Skipped files that are named beside the answer."""
MOST_SOLVES: Final = 3
"""Most board calibrations shown with plots."""


def told(done: OnboardReport) -> View:
    """Describe what came with a payload."""
    cameras, solves, sections = len(done.cameras), 0, []
    for one in done.cameras:
        solves += sum(solve is not None and solve.result is not None for solve in (one.board, one.flight))
        sections.append(_camera(one, done, whole=solves <= MOST_SOLVES))
    return View(
        title=f"New payload: {done.cameras[0].camera if cameras == 1 else f'{cameras} cameras'}",
        badge=_badge(done),
        lead=_lead(done),
        sections=(*sections, _sorted(done)),
        made_by=made_by(f"from {Path(done.folder).name}"),
    )


def _badge(done: OnboardReport) -> Badge:
    """The decision that is worst, as it is the one that decides."""
    found = {one.decision for one in done.cameras}
    for decision in (Decision.REFUSED, Decision.PROPOSED, Decision.READY, Decision.KNOWN):
        if decision in found:
            return Badge(decision.value, DECISIONS[decision])
    return Badge("no camera", Tone.BAD)


def _lead(done: OnboardReport) -> str:
    if not done.cameras:
        return "no camera could be identified in the folder"
    counts = Counter(one.decision for one in done.cameras)
    each = [f"{decision.value} for {number}" for decision, number in counts.items()]
    decided = ", ".join(each) if len(counts) > 1 else next(iter(counts)).value
    nothing = "" if done.branches or done.is_good else "; nothing is written into the registry"
    return f"{count(len(done.cameras), 'camera')}: {decided}{nothing}"


def _camera(one: CameraDecision, done: OnboardReport, *, whole: bool) -> Section:
    blocks: list[Block] = [Note(text=sentence(one.reason), action=one.next, tone=DECISIONS[one.decision])]
    blocks += [one.hint] if one.hint is not None else []
    blocks += _estimates(one)
    if one.entry is not None:
        blocks += _entry(one.entry, one)
    blocks += _relatives(one.relatives)
    blocks += _findings(one.findings, done.policy)
    if one.board is not None:
        blocks += _solve(one.board, "frames of a board", whole=whole)
    if one.flight is not None:
        blocks += _solve(one.flight, "images of a flight", whole=whole)
    blocks.append(_sources(one))
    badge = Badge(one.decision.value, DECISIONS[one.decision])
    return Section(title=done.name_of(one.camera), badge=badge, blocks=tuple(blocks))


def _estimates(one: CameraDecision) -> Iterator[Block]:
    if one.estimates:
        yield Table.of(
            "Estimates at the size of the images, in px. Difference: the largest of fx and fy, and of the principal "
            "point where both measured it.",
            one.estimates,
            ESTIMATES,
        )
        yield Plots(lambda: [_chart(one)])


def _result(estimate: Estimate) -> Badge:
    standing = estimate.standing
    return Badge(standing, STANDINGS[standing]) if standing is not None else Badge("no K")


def _verdict(one: RelatedEntry) -> Cell:
    if one.verdict is None:
        return one.reason or "–"
    kinds = f": {', '.join(one.kinds)}" if one.kinds else ""
    return Badge(f"{one.verdict.value}{kinds}", Tone.CAUTION if one.alarm else Tone.GOOD)


ESTIMATES: Final = (
    Column("estimate", lambda one: one.name),
    Column("kind", lambda one: one.kind.value, rank=1),
    Column("grade", lambda one: one.grade.value if one.grade is not None else "–", rank=4),
    Column("fx", lambda one: f"{one.intrinsics.fx:.2f}", numeric=True, rank=2),
    Column("fy", lambda one: f"{one.intrinsics.fy:.2f}", numeric=True, rank=5),
    Column(
        "cx", lambda one: f"{one.intrinsics.cx:.2f}" if one.measured_centre else "–", numeric=True, rank=6
    ),
    Column(
        "cy", lambda one: f"{one.intrinsics.cy:.2f}" if one.measured_centre else "–", numeric=True, rank=6
    ),
    Column(
        "difference",
        lambda one: f"{_percent(one.difference)}{one.of_what}" if one.difference is not None else "–",
        numeric=True,
        rank=3,
    ),
    Column("result", _result),
)
RELATIVES: Final = (
    Column("entry", lambda one: one.id),
    Column("of", lambda one: "this camera" if one.own else "another", rank=2),
    Column("status", lambda one: one.status.value, rank=3),
    Column(
        "Δf / f",
        lambda one: _percent(one.focal_change, digits=3) if one.focal_change is not None else "–",
        numeric=True,
        rank=1,
    ),
    Column(
        "at most (px)",
        lambda one: f"{one.max_px:.2f}" if one.max_px is not None else "–",
        numeric=True,
        rank=4,
    ),
    Column("verdict", _verdict),
)
FINDINGS: Final = (
    Column("rule", lambda one: one.rule),
    Column("result", lambda one: Badge(one.severity.value, SEVERITIES[one.severity])),
    Column("what was found and expected", lambda one: one.message, below=""),
)
SKIPPED: Final = (Column("skipped", lambda one: one.name), Column("reason", lambda one: one.reason))


ROLES = {
    Agreement.AGREES: Role.AGREES,
    Agreement.DIFFERS: Role.DIFFERS,
    Agreement.DISAGREES: Role.DISAGREES,
}


def _chart(one: CameraDecision) -> Figure:
    rows = []
    for estimate in one.estimates:
        role = Role.CHOSEN if estimate.chosen else Role.NO_K
        rows.append(
            Interval(
                name=f"{estimate.kind.value}: {estimate.name}",
                value=estimate.intrinsics.fx,
                half_width=estimate.intrinsics.fx * estimate.limit
                if estimate.kind not in {Kind.BOARD, Kind.FLIGHT}
                else 0.0,
                role=ROLES[estimate.agreement] if estimate.agreement is not None else role,
            )
        )
    return intervals(
        rows,
        axis=PX,
        caption="fx of every estimate; bars show the range beyond which another estimate disagrees.",
    )


def _entry(entry: ProposedEntry, one: CameraDecision) -> Iterator[Block]:
    calibration, status = entry.calibration, entry.status.value
    if entry.status_before is not None and entry.status_before is not entry.status:
        status += f", {entry.status_before.value} before"
    items: list[tuple[str, Cell]] = [
        (
            "valid for",
            "this unit only" if calibration.camera.serial is not None else "every unit of its model",
        ),
        ("grade", calibration.grade.value),
        *intrinsics_items(calibration),
        ("status", status),
        *facts(calibration.provenance, traced=False),
    ]
    yield Details(summary=f"The entry {entry.id}", blocks=(KeyValues(tuple(items)),))
    if calibration.distortion is not None and calibration.distortion.coefficients:
        yield Section(
            title="What the lens does", blocks=(Plots(partial(lens_plots, calibration)),), printed=False
        )
    for finding in one.check:
        yield Note(text=f"{finding.message} [{finding.rule}]", tone=Tone.CAUTION)


def _relatives(relatives: tuple[RelatedEntry, ...]) -> Iterator[Block]:
    if relatives:
        caption = "The registry's entries of this model, and how the proposed K differs from each"
        yield Table.of(caption, relatives, RELATIVES)


def _findings(findings: Sequence[Finding], policy: str) -> Iterator[Block]:
    if not findings:
        return
    caption = f"K against the {policy} policy"
    table = Table.of(caption, findings, FINDINGS)
    if findings[0].severity is Severity.UNPROVEN:
        yield UNPROVEN
    is_refused = findings[0].severity in {Severity.UNPROVEN, Severity.ERROR}
    yield table if is_refused else Details(summary=f"{caption}: {len(findings)} findings", blocks=(table,))


def _solve(solve: ImageSolve, what: str, *, whole: bool) -> Iterator[Block]:
    if solve.reason is not None:
        yield Note(text=f"{solve.images} {what} give no K: {solve.reason}.", tone=Tone.CAUTION)
    if solve.result is None or solve.detections is None or not whole:
        return
    result, quality = solve.result, solve.result.calibration.quality
    rms = f", rms {quality.rms_px:.3f} px" if quality is not None and quality.rms_px is not None else ""
    command = "calibrate flight DIR" if result.flown is not None else "calibrate FRAMES"
    lead = (
        f"{len(result.rms_by_view)} of {solve.images} {what} count, of {result.observations.board}{rms}; "
        f"the {result.model.value} model. All of it: calibrary {command} --html FILE."
    )
    reasons = tuple(str(finding) for finding in result.findings)
    yield Section(
        title=f"The {what}",
        badge=Badge(result.verdict.value, OUTCOMES[result.verdict].tone),
        blocks=(
            lead,
            *((Bullets((*reasons, *solve.detections.notes)),) if reasons else ()),
            Plots(partial(fit_plots, result.views, result.observations, result.points)),
        ),
    )


def _sources(one: CameraDecision) -> Details:
    table = Table(
        caption="Files that were read; of images with equal metadata, one",
        columns=(Column("file"), Column("what"), Column("sha256")),
        rows=tuple((used.name, used.what, used.sha256) for used in one.sources[:MOST_ROWS]),
    )
    return Details(summary=f"{count(len(one.sources), 'source')}, with hashes", blocks=(table,))


def _sorted(done: OnboardReport) -> Section:
    found = done.sorted
    said = (
        f"{count(found.images, 'image')} of flights, {count(found.board_frames, 'frame')} of a board, "
        f"{count(found.calibration_files, 'calibration file')}, {len(found.skipped)} skipped"
    )
    blocks: list[Block] = [said]
    if found.skipped:
        blocks.append(Table.of("What was skipped", found.skipped[:FEW], SKIPPED))
    if len(found.skipped) > FEW:
        every = Table.of("What was skipped", found.skipped[:MOST_ROWS], SKIPPED)
        blocks += [
            f"{len(found.skipped) - FEW} more",
            Details(summary="All that was skipped", blocks=(every,)),
        ]
    return Section(title="What was in the folder", blocks=tuple(blocks))


def _percent(share: float, *, digits: int = 2) -> str:
    # + 0.0 removes the sign of −0.0.
    return minus(f"{round(share, digits + 2) + 0.0:+.{digits}%}")
