"""The entries that a calibration becomes in a registry: shown, asked for and written; for all its commands."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from calibrary.arguments import Terms
from calibrary.cli.commands import print_json
from calibrary.cli.flags import add_flags, call
from calibrary.cli.registry import opened, where
from calibrary.cli.registry.changes import agreed, can_ask, screen_of_change
from calibrary.cli.shown import Shown

if TYPE_CHECKING:
    from calibrary.cli.console import Screen
    from calibrary.jobs.fleet import ChangedEntry, Entry


EXIT_NOT_PASSED = 1
EXIT_UNWRITTEN = 3
KEEPING = {
    "--yes -y": "write into the registry without asking",
    "--dry-run": "do everything but write into the registry",
}


class Kept(Shown):
    """A calibration, which may become entries of a registry.

    Args:
        made: makes the entries of a result.
    """

    def __init__(
        self,
        *declared: Any,
        made: Callable[[Any], Sequence[Entry]],
        switches: Mapping[str, str] | None = None,
        **more: Any,
    ) -> None:
        super().__init__(*declared, switches={**KEEPING, **(switches or {})}, **more)
        self._made = made

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the flags, with the terms on which the registry changes."""
        super().add_arguments(parser)
        add_flags(parser, _terms, without=("valid_from", "valid_until"))

    def check(self, arguments: argparse.Namespace) -> None:
        """End with a usage error, before any work, if the registry could not be written as the flags say."""
        terms = call(_terms, arguments)
        if is_kept(arguments):
            if not arguments.yes and not arguments.dry_run and not can_ask():
                arguments.parser.error(
                    "not a terminal, so nothing can be confirmed before the registry is written: give --yes"
                )
        elif terms != Terms():
            arguments.parser.error(
                "--approve, --reason, --force and --branch are of a registry: say --registry PATH or --as KEY"
            )

    def done(self, arguments: argparse.Namespace, _: Any = None) -> Any:
        """Calibrate, show the result, and keep it as the flags say."""
        from calibrary.cli.terminal import show
        from calibrary.view import view_of

        report = super().done(arguments)
        screen = screen_of_change(arguments)
        how: dict[str, Any] = {"files": tuple(_written(arguments, report))}
        if getattr(arguments, "correlations", False):
            how["correlations"] = True
        show(screen, view_of(report, **how))
        arguments.is_kept = keep(arguments, screen, report.verdict, lambda: self._made(report))
        return report

    def print_document(self, done: Any, _: argparse.Namespace) -> None:
        """Print the result in one line."""
        print_json(done, indent=None)

    def show(self, done: Any, arguments: argparse.Namespace, **_: Any) -> None:
        """Nothing more: it was shown before it was kept."""

    def exit_code(self, done: Any, arguments: argparse.Namespace) -> int:
        """The code of the verdict, of a file that could not be written, and of an entry that met an objection."""
        if done.unwritten is not None and done.verdict != "none":
            return EXIT_UNWRITTEN
        return 0 if done.is_good and arguments.is_kept else EXIT_NOT_PASSED


def _written(arguments: argparse.Namespace, report: Any) -> Iterator[str]:
    """Which of the files that the flags ask for were written, and why one was not."""
    if is_kept(arguments) and report.verdict == "none":
        yield "what is refused becomes no entry; nothing was written into the registry"
    if report.unwritten is not None:
        yield f"not written: {arguments.out}: {report.unwritten}"
    for name in ("html", "keep_corners", "out"):
        path = getattr(arguments, name, None)
        if path is not None and not (name == "out" and report.unwritten is not None):
            yield f"wrote {path}"
    if dropped := getattr(report, "dropped", ()):
        yield f"the format has no place for: {', '.join(dropped)}"


def is_kept(arguments: argparse.Namespace) -> bool:
    """Whether the flags ask for a registry entry."""
    return arguments.registry is not None or getattr(arguments, "as_", None) is not None


def keep(
    arguments: argparse.Namespace,
    screen: Screen,
    verdict: str,
    entries: Callable[[], Sequence[Entry]],
) -> bool:
    """Write the entries if the flags ask for it and verdict, check and user allow it.

    Returns:
        Whether there was no objection.
    """
    from calibrary.cli.registry.changes import show_findings, show_written

    if not is_kept(arguments):
        return True
    if verdict == "none":
        return False
    terms = call(_terms, arguments)
    change = opened(arguments).propose_entries(entries(), terms)
    found = change.report
    _show_entries(screen, found.entries)
    show_findings(screen, found.findings)
    if change.proposals.errors:
        screen.say("the check objects, so nothing was written into the registry")
        return False
    if not any(one.changes for one in found.entries):
        return True
    first, count = found.entries[0], len(found.entries)
    what = first.id if count == 1 else f"{count} entries"
    if arguments.dry_run or not agreed(arguments, f"Write {what}?"):
        screen.say("nothing was written into the registry")
        return True
    status, as_start = (
        first.status.value,
        " as a start: no solver keeps it fixed" if verdict != "fixed" else "",
    )
    change.write()
    show_written(screen, change.report, "approved" if status == "approved" else "wrote", count)
    if count == 1 and status == "draft":
        screen.say(
            f"a proposal is not used yet; next: calibrary registry approve {what}{where(arguments)} --digest "
            f"{(first.digest or '')[:12]}"
        )
    if as_start:
        screen.say(f"it is used{as_start}")
    return True


def _show_entries(screen: Screen, entries: Sequence[ChangedEntry]) -> None:
    """Show each entry compared with the present one; all of a new one is shown already."""
    from calibrary.cli.registry.changes import show_changes

    for one in entries:
        if not one.is_new:
            show_changes(screen, [one])
            continue
        screen.say(f"{one.id}  new")
        for warning in one.warnings:
            screen.say(f"  note: {warning}")


def _terms(terms: Terms | None = None) -> Terms:
    """On what terms the registry changes; as flags."""
    return terms or Terms()
