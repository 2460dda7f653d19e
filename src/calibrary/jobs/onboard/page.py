"""Page of a payload: for every camera the decision, all estimates, the entry, and entries of the same model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from calibrary.calib.verdict import BoardVerdict
from calibrary.jobs.calibrate.page_plots import fit_plots
from calibrary.jobs.onboard.report import (
    Agreement,
    CameraDecision,
    Decision,
    ImageSolve,
    Kind,
    OnboardReport,
    ProposedEntry,
    RelatedEntry,
)
from calibrary.pages.plots import Axis, Interval, Role, distortion_map, intervals, radial_curve
from calibrary.pages.wording import (
    SEVERITIES,
    UNPROVEN,
    count,
    cut_table,
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
    Section,
    SideBySide,
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
SOLVES: Final = {
    BoardVerdict.PASS: Tone.GOOD,
    BoardVerdict.PROVISIONAL: Tone.CAUTION,
    BoardVerdict.REFUSE: Tone.BAD,
}
PX: Final = Axis("fx", "px")
MOST_ROWS: Final = 200
MOST_SOLVES: Final = 3
"""Most board calibrations shown with plots."""


def onboard_page(done: OnboardReport) -> View:
    """Make the page."""
    cameras = len(done.cameras)
    title = str(done.cameras[0].camera) if cameras == 1 else f"{cameras} cameras"
    refused = sum(one.decision is Decision.REFUSED for one in done.cameras)
    if not done.cameras:
        badge, lead = Badge("no camera", Tone.BAD), "No camera could be identified in the folder."
    elif refused:
        badge = Badge("refused", Tone.BAD)
        lead = f"{refused} of {cameras} cameras refused, so nothing is written into the registry."
    elif any(one.decision is Decision.PROPOSED for one in done.cameras):
        badge, lead = (
            Badge("draft proposed", Tone.GOOD),
            "A draft is on a branch, awaiting approval.",
        )
    elif ready := sum(one.decision is Decision.READY for one in done.cameras):
        badge, lead = (
            Badge("ready, not written", Tone.CAUTION),
            f"{count(ready, 'draft')} could be proposed; nothing is written into the registry.",
        )
    else:
        badge, lead = (
            Badge("nothing new", Tone.NEUTRAL),
            "The registry already contains everything from these sources.",
        )
    solves = 0
    sections = []
    for one in done.cameras:
        solves += sum(solve is not None and solve.result is not None for solve in (one.board, one.flight))
        sections.append(_camera(one, done, whole=solves <= MOST_SOLVES))
    return View(
        title=f"New payload: {title}",
        badge=badge,
        lead=lead,
        sections=(*sections, _sorted(done)),
        made_by=made_by(f"from {Path(done.folder).name}"),
    )


def _camera(one: CameraDecision, done: OnboardReport, *, whole: bool) -> Section:
    blocks: list[Block] = [Note(text=sentence(one.reason), action=one.next, tone=DECISIONS[one.decision])]
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
    if not one.estimates:
        return
    rows = []
    for estimate in one.estimates:
        K, standing = estimate.intrinsics, estimate.standing
        rows.append(
            (
                estimate.name,
                estimate.kind.value,
                estimate.grade.value if estimate.grade is not None else "–",
                f"{K.fx:.2f}",
                f"{K.fy:.2f}",
                f"{K.cx:.2f}" if estimate.measured_centre else "–",
                f"{K.cy:.2f}" if estimate.measured_centre else "–",
                f"{_percent(estimate.difference)}{estimate.of_what}"
                if estimate.difference is not None
                else "–",
                Badge(standing, STANDINGS[standing]) if standing is not None else "–",
            )
        )
    yield Table(
        caption="Estimates at the size of the images, in px. Difference: the largest of fx and fy, and of the "
        "principal point where both measured it.",
        columns=(
            Column("estimate"),
            Column("kind"),
            Column("grade"),
            *(Column(name, numeric=True) for name in ("fx", "fy", "cx", "cy")),
            Column("difference", numeric=True),
            Column("result"),
        ),
        rows=tuple(rows),
    )
    yield _chart(one)


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
    yield f"The entry {entry.id}:"
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
    yield KeyValues(tuple(items))
    if calibration.distortion is not None and calibration.distortion.coefficients:
        arrows, _ = distortion_map(calibration)
        plots = SideBySide((arrows, radial_curve(calibration)))
        yield Section(title="What the lens does", blocks=(plots,), printed=False)
    for finding in one.check:
        yield Note(text=f"{finding.message} [{finding.rule}]", tone=Tone.CAUTION)


def _relatives(relatives: tuple[RelatedEntry, ...]) -> Iterator[Block]:
    if not relatives:
        return
    rows = []
    for one in relatives:
        verdict: Cell = one.reason or "–"
        if one.verdict is not None:
            told = f"{one.verdict.value}: {', '.join(one.kinds)}" if one.kinds else one.verdict.value
            verdict = Badge(told, Tone.CAUTION if one.alarm else Tone.GOOD)
        rows.append(
            (
                one.id,
                "this camera" if one.own else "another",
                one.status.value,
                _percent(one.focal_change, digits=3) if one.focal_change is not None else "–",
                f"{one.max_px:.2f}" if one.max_px is not None else "–",
                verdict,
            )
        )
    yield Table(
        caption="The registry's entries of this model, and how the proposed K differs from each",
        columns=(
            Column("entry"),
            Column("of"),
            Column("status"),
            Column("Δf / f", numeric=True),
            Column("at most (px)", numeric=True),
            Column("verdict"),
        ),
        rows=tuple(rows),
    )


def _findings(findings: Sequence[Finding], policy: str) -> Iterator[Block]:
    if not findings:
        return
    caption = f"K against the {policy} policy"
    table = Table(
        caption=caption,
        columns=(Column("rule"), Column("result"), Column("what was found and expected")),
        rows=tuple((f.rule, Badge(f.severity.value, SEVERITIES[f.severity]), f.message) for f in findings),
    )
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
        badge=Badge(result.verdict.value, SOLVES[result.verdict]),
        blocks=(
            lead,
            *((Bullets((*reasons, *solve.detections.notes)),) if reasons else ()),
            *fit_plots(result.views, result.observations, "corners" if result.flown is None else "points"),
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
    counts = KeyValues(
        (
            ("images of flights", str(found.images)),
            ("frames of a board", str(found.board_frames)),
            ("calibration files", str(found.calibration_files)),
            ("skipped", str(len(found.skipped))),
        )
    )
    blocks: list[Block] = [counts]
    if found.skipped:
        rows = [(one.name, one.reason) for one in found.skipped]
        columns = (Column("file"), Column("reason"))
        blocks += cut_table("What was skipped", columns, rows, most=MOST_ROWS, rest="the JSON")
    return Section(title="What was in the folder", blocks=tuple(blocks), printed=False)


def _percent(share: float, *, digits: int = 1) -> str:
    # + 0.0 removes the sign of −0.0.
    return minus(f"{round(share, digits + 2) + 0.0:+.{digits}%}")
