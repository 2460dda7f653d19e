"""What a person sees of ``calibrary extract``: a progress bar, then a table that tells what to do."""

from __future__ import annotations

from types import TracebackType
from typing import Self

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from calibrary.cli.console import make_console, plain
from calibrary.extract.fallback import Step
from calibrary.extract.gather import Rejected
from calibrary.extract.hand_off import Solver, seed_command
from calibrary.extract.outcome import CameraOutcome, Outcome
from calibrary.extract.outputs import Outputs
from calibrary.validation import Verdict

__all__ = ["Display"]

STYLES = {Verdict.VALID: "bold green", Verdict.UNPROVEN: "bold yellow", Verdict.REJECTED: "bold red"}
MOST_REJECTED = 12


class Display:
    """The terminal's side of one run; with ``quiet`` only what is urgent is said."""

    def __init__(self, *, quiet: bool) -> None:
        self._quiet = quiet
        self._console = make_console(stderr=True)
        self._progress = Progress(
            TextColumn("reading images"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
            console=self._console,
            transient=True,
            disable=not self._console.is_terminal,
        )
        self._task = self._progress.add_task("reading", total=None)

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.stop()

    def found(self, count: int) -> None:
        """The number of images is known."""
        self._progress.update(self._task, total=count)

    def advance(self, count: int) -> None:
        """So many more images are read."""
        self._progress.advance(self._task, count)

    def show(self, outcome: Outcome, outputs: Outputs, *, solver: Solver, dry_run: bool) -> None:
        """Tell the whole outcome."""
        for warning in outcome.warnings:
            self._say(f"[yellow]note[/]: {plain(warning)}")
        if self._quiet:
            return
        self._console.print(_camera_table(outcome))
        if outcome.rejected:
            self._console.print(_rejected_table(outcome.rejected))
        self._tell_fallbacks(outcome)
        self._tell_files(outputs, solver=solver, dry_run=dry_run)
        if outcome.uncalibrated:
            self._say(
                "[yellow]uncalibrated[/]: at least one camera goes on with its principal point in the middle and its "
                "distortion unknown; good enough for SfM to converge, not for survey accuracy"
            )

    def _tell_fallbacks(self, outcome: Outcome) -> None:
        """The chain of each camera that went through it; cameras for which it ended alike are told together."""
        told: dict[tuple[str, ...], list[CameraOutcome]] = {}
        for camera in outcome.cameras:
            if camera.fallback is not None and camera.fallback.steps:
                lines = tuple(_step_line(step) for step in camera.fallback.steps)
                told.setdefault(lines, []).append(camera)
        for lines, cameras in told.items():
            names = "; ".join(plain(str(camera.camera.key)) for camera in cameras)
            self._say(f"\n[bold]fallbacks tried[/] for {names}")
            for line in lines:
                self._say(f"  {line}")
            seed = cameras[0].fallback.seed if cameras[0].fallback is not None else None
            if seed is not None:
                which = (
                    ""
                    if len(cameras) == 1
                    else f" (of {plain(str(cameras[0].camera.key))}; all in the report)"
                )
                self._say(f"  [dim]to self-calibrate{which}: {plain(seed_command(seed))}[/]")

    def _tell_files(self, outputs: Outputs, *, solver: Solver, dry_run: bool) -> None:
        self._say("\nwould write" if dry_run else "\nwrote")
        for path in outputs.files:
            self._say(f"  {plain(str(path))}")
        for path in outputs.stale:
            self._say(f"[yellow]note[/]: {plain(str(path))} is of an earlier run, not of this one; remove it")
        if solver is not Solver.NONE and outputs.not_handed_over:
            names = ", ".join(outputs.not_handed_over)
            self._say(f"[yellow]not handed to {solver.value}[/]: {plain(names)}: no valid K")

    def _say(self, text: str) -> None:
        self._console.print(text, highlight=False, soft_wrap=True)


def _step_line(step: Step) -> str:
    source = f" {plain(step.source)}" if step.source else ""
    return f"{step.step.value}: [bold]{step.outcome.value}[/]{source} — {plain(step.why)}"


def _camera_table(outcome: Outcome) -> Table:
    table = Table(title=f"Cameras, judged by the {outcome.policy.name} policy", title_justify="left")
    table.add_column("camera", ratio=3, min_width=16)
    table.add_column("images", justify="right", no_wrap=True)
    table.add_column("K in px", no_wrap=True)
    table.add_column("fx/W", justify="right", no_wrap=True)
    table.add_column("grade", no_wrap=True)
    table.add_column("verdict", no_wrap=True)
    table.add_column("why, and what to do", ratio=4, min_width=24)
    for camera in outcome.cameras:
        table.add_row(
            plain(str(camera.camera.key)),
            str(len(camera.camera.names)),
            *_numbers(camera),
            Text(camera.verdict.value, style=STYLES[camera.verdict]),
            _why(camera),
            end_section=True,
        )
    return table


def _numbers(camera: CameraOutcome) -> tuple[str, str, str]:
    calibration = camera.calibration
    if calibration is None:
        return "—", "—", "—"
    K = calibration.intrinsics
    matrix = f"fx {K.fx:.2f}  fy {K.fy:.2f}\ncx {K.cx:.2f}  cy {K.cy:.2f}"
    return matrix, f"{K.fx / K.image_size[0]:.3f}", calibration.grade.value


def _why(camera: CameraOutcome) -> Text:
    text = Text()
    if camera.calibration is not None and camera.calibration.provenance.tag:
        text.append(f"from {camera.calibration.provenance.tag}")
        if camera.calibration.provenance.adaptation:
            text.append(f", {camera.calibration.provenance.adaptation}", style="dim")
    for line, style in ((camera.reason, ""), (camera.advice, "bold")):
        if line:
            text.append("\n" if text else "")
            text.append(f"→ {line}" if line is camera.advice else line, style=style)
    for conflict in camera.camera.evidence.conflicts:
        text.append(
            f"\n{conflict.other.tag} disagrees by {conflict.difference:+.1%}: {conflict.cause.value}",
            "yellow",
        )
    for dropped in camera.camera.evidence.dropped:
        text.append(f"\n{dropped.tag} is not believed: {dropped.reason}", style="dim")
    return text


def _rejected_table(rejected: tuple[Rejected, ...]) -> Table:
    table = Table(title=f"Images set aside: {len(rejected)}", title_justify="left")
    table.add_column("image", ratio=2)
    table.add_column("why", ratio=5)
    for item in rejected[:MOST_REJECTED]:
        table.add_row(plain(item.name), plain(item.reason))
    if len(rejected) > MOST_REJECTED:
        table.add_row("…", f"and {len(rejected) - MOST_REJECTED} more, listed in the report")
    return table
