"""Terminal output of ``calibrary extract``: a progress bar, then every camera with reasons and remedies.

A camera is one line of a table; below it, over the whole width, follow K and the reasons, which do not fit into
columns. So the output reads the same at 80 columns as at 200.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from types import TracebackType
from typing import TYPE_CHECKING, Self

from rich.console import Group, RenderableType
from rich.constrain import Constrain
from rich.padding import Padding
from rich.rule import Rule
from rich.table import Table
from rich.text import Text

from calibrary.cli.console import Screen, plain, printable
from calibrary.cli.progress import Bar
from calibrary.cli.tables import Column, fitted, single_lines
from calibrary.validation import UNPROVEN_LEGEND, Severity, Verdict

if TYPE_CHECKING:
    from pathlib import Path

    from calibrary.jobs.extract.cameras import StateDocument
    from calibrary.jobs.extract.extraction import JudgedCamera
    from calibrary.jobs.extract.fallback import Step
    from calibrary.jobs.extract.report import ExtractReport, Outputs
    from calibrary.jobs.images.folders import SkippedFile

STYLES = {Verdict.VALID: "bold green", Verdict.UNPROVEN: "bold yellow", Verdict.REJECTED: "bold red"}
MOST_REJECTED = 12
FEW = 3
"""So many files are named one by one without --explain."""
WIDEST = 110
"""Widest line; longer lines of text are hard to read."""

DOING = {
    "images": "reading images",
    "features": "finding features",
    "pairs": "matching pairs of images",
    "placed": "placing images",
}

GAP = 2
COLUMNS = {"verdict": 8, "images": 6, "fx/W": 6, "grade": 10}
"""Column widths; the camera's name takes the remaining width."""

BRIEF = (
    Column(name="verdict"),
    Column(name="camera"),
    Column(name="images", rank=4, right=True),
    Column(name="fx px", rank=1, right=True),
    Column(name="grade", rank=3),
    Column(name="use", rank=2),
)
CHAIN = (Column(name="step"), Column(name="outcome"), Column(name="", rank=1, wraps=True))
PIXEL_RULES = frozenset({"pixels", "distortion-as-stated", "zoomed", "cropped"})
GROUP_RULES = frozenset({"one-unit", "one-calibration"})
MOST_STATES = 6
INDENT = COLUMNS["verdict"] + GAP


class Display:
    """Terminal output of one run.

    Args:
        screen: console for the results.
        remarks: console for progress and notes.
    """

    def __init__(self, screen: Screen, remarks: Screen) -> None:
        self._screen, self._remarks = screen, remarks
        self._bar = Bar(remarks, "")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.__exit__(kind, error, trace)

    def progress(self, done: int, total: int, what: str) -> None:
        """Update the progress bar."""
        self._bar(done, total, DOING[what])

    def show(self, report: ExtractReport, *, program: str | None, dry_run: bool, explain: bool) -> None:
        """Show the whole result, with the verdict last."""
        for warning in report.warnings:
            self._remarks.say(f"[yellow]note[/]: {plain(warning)}")
        if self._screen.quiet:
            return
        if explain:
            self._screen.table(judgement(report, width=self._screen.at_most(WIDEST)))
            self._tell_fallbacks(report)
        else:
            self._tell_briefly(report)
        if report.outputs.files:
            self._tell_files(report.outputs, program=program, dry_run=dry_run, explain=explain)
        unmeasured = sum(c.uncalibrated for c in report.judged if c.calibration is not None)
        self._screen.say("")
        if unmeasured:
            self._screen.say(
                f"[yellow]uncalibrated[/]: for {unmeasured} of {len(report.judged)} cameras the principal point "
                "and the distortion were not measured; good enough for SfM to converge, not for survey accuracy"
            )
        self._screen.say(verdict(report))

    def _tell_briefly(self, report: ExtractReport) -> None:
        """Show one line for each camera; for one that is not valid also its reason and the next step."""
        cameras = sorted(report.judged, key=lambda camera: list(Verdict).index(camera.verdict))
        rows, below = [], []
        for camera in cameras:
            K = camera.calibration.intrinsics if camera.calibration is not None else None
            rows.append(
                (
                    f"[{STYLES[camera.verdict]}]{camera.verdict.value}[/]",
                    f"[bold]{plain(camera.name)}[/]",
                    str(camera.camera.count),
                    f"{K.fx:.2f}" if K is not None else "—",
                    camera.calibration.grade.value if camera.calibration is not None else "—",
                    camera.use.use.value if camera.use is not None else "",
                )
            )
            below.append(list(_said_briefly(camera)))
        width = min(self._screen.width, WIDEST)
        (head, *lines), left_out = single_lines(BRIEF, rows, width)
        self._screen.show([head])
        for line, more in zip(lines, below, strict=True):
            self._screen.show([line])
            for text in more:
                self._screen.say(text, indent=GAP)
        if left_out:
            self._remarks.say(
                f"[dim]left out in this width: {', '.join(left_out)}; --explain shows everything[/]"
            )
        if any(camera.verdict is Verdict.UNPROVEN for camera in cameras):
            self._screen.say(f"[dim]{UNPROVEN_LEGEND}[/]")
        for items, unlisted, what in (
            (report.rejected, report.more_rejected, "cannot be read"),
            (report.skipped, report.more_skipped, "skipped"),
        ):
            for one in items[:FEW]:
                self._screen.say(f"{what}: {plain(one.name)}: {plain(one.reason)}")
            unnamed = len(items) + unlisted - FEW
            if unnamed > 0:
                self._screen.say(f"{what}: {unnamed} more, in the report")

    def _tell_fallbacks(self, report: ExtractReport) -> None:
        """Show the fallback steps of each camera that used them; cameras with the same steps are grouped."""
        by_steps: dict[tuple[Step, ...], list[JudgedCamera]] = {}
        for camera in report.judged:
            if camera.fallback is not None and camera.fallback.steps and camera.outranked is None:
                by_steps.setdefault(camera.fallback.steps, []).append(camera)
        for steps, cameras in by_steps.items():
            names = "; ".join(plain(camera.name) for camera in cameras)
            self._screen.say("")
            self._screen.say(f"[bold]Fallbacks tried[/] for {names}")
            chain = [
                (
                    step.step.value,
                    f"[bold]{step.outcome.value}[/]",
                    plain(f"{step.source}: {step.why}" if step.source else step.why),
                )
                for step in steps
            ]
            width = self._screen.at_most(WIDEST) - GAP
            self._screen.show(fitted(CHAIN, chain, width, header=False), indent=GAP)
            self._tell_seeds(cameras)

    def _tell_seeds(self, cameras: list[JudgedCamera]) -> None:
        seeds = [c.fallback.seed for c in cameras if c.fallback is not None and c.fallback.seed is not None]
        if len(seeds) == 1:
            self._screen.say("  To self-calibrate from the seed:")
            from calibrary.jobs.extract.hand_off import seed_command

            for command in seed_command(seeds[0]).replace(" && ", " &&\n").splitlines():
                self._screen.verbatim(f"    {printable(command)}", style="dim")
        elif seeds:
            self._screen.say("  To self-calibrate from a seed, take its COLMAP commands from the report.")

    def _tell_files(self, outputs: Outputs, *, program: str | None, dry_run: bool, explain: bool) -> None:
        from calibrary.jobs.extract.outputs import left_over

        self._screen.say("")
        verb = "Would write" if dry_run else "Wrote"
        if explain or len(outputs.files) <= FEW:
            self._screen.say(f"[bold]{verb}[/] {plain(', '.join(str(path) for path in outputs.files))}")
        else:
            self._screen.say(f"[bold]{verb}[/] {plain(', '.join(_in_short(outputs.files)))}")
        if outputs.task is not None:
            linked = "copied" if outputs.task.copied else "linked"
            for folder, count in Counter(path.parent for path in outputs.task.images).items():
                self._screen.say(f"  {plain(str(folder))}: {_count(count, 'image')}, {linked}")
        if outputs.stale:
            self._remarks.say(f"[yellow]note[/]: {plain(left_over(outputs.stale))}")
        for slug, why in outputs.not_handed_over.items():
            self._screen.say(f"[yellow]not handed to {program}[/]: {plain(slug)}: {plain(why)}")
        for slug, what in outputs.refine.items():
            self._screen.say(f"[dim]to {program}[/]: {plain(slug)}: {plain(what)}")
        for note in outputs.hand_off_notes:
            self._screen.say(f"[yellow]note[/]: {plain(note)}")
        if outputs.database is not None:
            count = len(outputs.database.after)
            verb = "would be written" if dry_run else "written"
            self._screen.say(f"{count} cameras {verb} into {plain(str(outputs.database.path))}")
        if outputs.hand_off_failed:
            self._screen.say(f"[red]nothing is handed to {program}[/]: {plain(outputs.hand_off_failed)}")


def _said_briefly(camera: JudgedCamera) -> Iterator[str]:
    """The reason why a camera's K is not valid or not from its images, and the next step."""
    if camera.outranked is not None and camera.fallback is not None:
        yield f"[dim]K from {plain(camera.fallback.steps[0].source or '')} of the registry[/]"
    if camera.reason:
        yield plain(camera.reason)
    if camera.advice:
        yield f"[bold]→ {plain(camera.advice)}[/]"
    for text in (*_pixels(camera), *_group(camera)):
        yield f"[yellow]{plain(text.plain)}[/]"


def _in_short(files: Iterable[Path]) -> Iterator[str]:
    """Names of the files; several files of K by their common form."""
    kinds: dict[Path, list[Path]] = {}
    for path in files:
        kind = path.with_name(f"{path.name.partition('.')[0]}.*.npy") if path.suffix == ".npy" else path
        kinds.setdefault(kind, []).append(path)
    for kind, alike in kinds.items():
        yield f"{kind} ({len(alike)} files)" if len(alike) > 1 else str(alike[0])


def judgement(report: ExtractReport, *, width: int) -> RenderableType:
    """All cameras, and the images without an identifiable camera, rendered for a width in columns."""
    parts = [_cameras(report, width)]
    if any(camera.verdict is Verdict.UNPROVEN for camera in report.judged):
        parts.append(Text(UNPROVEN_LEGEND, "dim"))
    if report.rejected:
        parts.append(_skipped(report.rejected, report.more_rejected, "cannot be read"))
    if report.skipped:
        parts.append(_skipped(report.skipped, report.more_skipped, "skipped"))
    return Constrain(Group(*parts), width)


def verdict(report: ExtractReport) -> str:
    """The last line, in rich's markup: number of cameras by verdict."""
    counts = [(verdict, sum(c.verdict is verdict for c in report.judged)) for verdict in Verdict]
    found = ", ".join(f"[{STYLES[verdict]}]{count} {verdict}[/]" for verdict, count in counts if count)
    policy, cameras = plain(report.policy), _count(len(report.judged), "camera")
    unread = f"; [red]{report.unread}[/]" if report.unread else ""
    return f"[bold]{cameras}[/], judged by the {policy} policy: {found or 'none'}{unread}"


def _cameras(report: ExtractReport, width: int) -> RenderableType:
    """All cameras; those that need attention come last, nearest to the prompt."""
    cameras = sorted(report.judged, key=lambda camera: list(Verdict).index(camera.verdict))
    left = max(12, width - sum(COLUMNS.values()) - GAP * len(COLUMNS))
    name_width = min(left, max((len(c.name) for c in cameras), default=0))
    head = _line(
        [Text(name, "dim") for name in ("verdict", "camera, K in px", "images", "fx/W", "grade")], name_width
    )
    line_width = min(width, name_width + sum(COLUMNS.values()) + GAP * len(COLUMNS))
    rule = Padding(Rule(style="dim"), (0, width - line_width, 0, 0))
    return Group(head, rule, *(_camera(c, name_width) for c in cameras))


def _camera(camera: JudgedCamera, name_width: int) -> RenderableType:
    calibration = camera.calibration
    over_width, grade = "—", "—"
    if calibration is not None:
        K = calibration.intrinsics
        over_width, grade = f"{K.fx / K.image_size[0]:.3f}", calibration.grade.value
    line = _line(
        [
            Text(camera.verdict.value, STYLES[camera.verdict]),
            Text(printable(camera.name), "bold"),
            Text(str(camera.camera.count)),
            Text(over_width),
            Text(grade),
        ],
        name_width,
    )
    below = Text("\n").join(_below(camera))
    return Group(line, Padding(below, (0, 0, 1, INDENT), expand=False))


def _line(cells: list[Text], name_width: int) -> Table:
    """One row of the list; a table of its own, so that the text below it can span all columns."""
    line = Table.grid(padding=(0, GAP, 0, 0))
    for name in ("verdict", "camera", "images", "fx/W", "grade"):
        numeric = name in {"images", "fx/W"}
        line.add_column(
            width=COLUMNS.get(name, name_width), justify="right" if numeric else "left", overflow="fold"
        )
    line.add_row(*cells)
    return line


def _below(camera: JudgedCamera) -> Iterator[Text]:
    """Text below a camera: K and its source, the reasons why it is not valid, what to do, and the other estimates."""
    yield from _k(camera)
    if camera.verdict is not Verdict.VALID:
        first, more = camera.camera.names[0], camera.camera.count - 1
        yield Text(printable(f"images: {first} and {more} more" if more else f"image: {first}"), "dim")
    yield from _states(camera)
    reason = camera.reason or ""
    if reason:
        yield Text(printable(reason))
    if camera.advice:
        yield Text(f"→ {printable(camera.advice)}", "bold")
    yield from _pixels(camera)
    evidence = camera.camera.evidence
    for conflict in evidence.conflicts:
        if conflict.other.tag not in reason:
            found = f"{conflict.other.tag} disagrees by {conflict.difference:+.1%}: {conflict.cause.value}"
            yield Text(printable(found), "yellow")
    images = camera.camera.count
    for dropped, count in camera.camera.dropped:
        if dropped.tag not in reason:
            of = "" if count == images else f" of {count} of {images} images"
            yield Text(printable(f"{dropped.tag}{of} is not believed: {dropped.reason}"), "dim")


def _pixels(camera: JudgedCamera) -> Iterator[Text]:
    """Result of the check of K and its distortion against the pixels."""
    report = camera.report
    for finding in report.findings if report is not None else ():
        if finding.rule in PIXEL_RULES and finding.message not in (camera.reason or ""):
            yield Text(printable(finding.message), "green" if finding.severity is Severity.PASS else "yellow")


def _k(camera: JudgedCamera) -> Iterator[Text]:
    """K and its source."""
    if camera.calibration is None:
        return
    K = camera.calibration.intrinsics
    yield Text(f"fx {K.fx:.2f}  fy {K.fy:.2f}  cx {K.cx:.2f}  cy {K.cy:.2f}")
    from_where = camera.calibration.provenance
    words = (from_where.tag, from_where.adaptation)
    if camera.calibration is camera.camera.calibration and any(words):
        yield Text(f"from {printable(', '.join(word for word in words if word))}", "dim")
    elif camera.outranked is not None and camera.fallback is not None:
        [step] = camera.fallback.steps
        yield Text(printable(f"from {step.source} of the registry: {step.why}"), "dim")
    if camera.use is not None:
        yield Text(printable(f"use: {camera.use.use}, {camera.use.why}"), "dim")


def _states(camera: JudgedCamera) -> Iterator[Text]:
    """Number of images per camera state, if there are several, and the findings of the group."""
    states = camera.states
    if len(states) > 1:
        counts = [f"{state.count} {_described(state)}" for state in states[:MOST_STATES]]
        if len(states) > MOST_STATES:
            counts.append(f"{len(states) - MOST_STATES} more states in the report")
        yield Text(printable(f"states: {'; '.join(counts)}"), "dim")
    yield from _group(camera)


def _group(camera: JudgedCamera) -> Iterator[Text]:
    """The findings of the camera's images as a group."""
    findings = camera.camera.report.findings if camera.camera.report is not None else ()
    for finding in findings:
        if finding.rule in GROUP_RULES and finding.message not in (camera.reason or ""):
            yield Text(printable(finding.message), "yellow")


def _described(state: StateDocument) -> str:
    words = [
        state.verdict.value,
        *([state.grade.value] if state.grade is not None else ["no K of their own"]),
    ]
    if state.firmware is not None:
        words.append(f"firmware {state.firmware}")
    if state.seen:
        words.append(f"{state.pixels.value} ({'; '.join(state.seen)})")
    return ", ".join(words)


def _skipped(rejected: tuple[SkippedFile, ...], unlisted: int, what: str) -> RenderableType:
    folders = sum(item.name.endswith("/") for item in rejected)
    images = len(rejected) + unlisted - folders
    counts = [_count(images, "image")] if images else []
    counts += [_count(folders, "folder")] if folders else []
    lines: list[RenderableType] = [Text(f"{' and '.join(counts)} {what}", "bold")]
    for item in rejected[:MOST_REJECTED]:
        lines.append(Padding(Text(printable(item.name)), (0, 0, 0, GAP)))
        lines.append(Padding(Text(printable(item.reason)), (0, 0, 0, 2 * GAP)))
    more = len(rejected) + unlisted - MOST_REJECTED
    if more > 0:
        lines.append(Text(f"  … and {more} more{'' if unlisted else ', listed in the report'}"))
    return Group(*lines)


def _count(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"
