"""``calibrary registry check``: check all entries; for users, and for a hook or CI that accepts a push."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from calibrary.cli.commands import add_json_flag, print_json
from calibrary.cli.flags import add_flags, call
from calibrary.cli.progress import Bar
from calibrary.cli.registry import add_registry_flag, opened
from calibrary.jobs.fleet import Fleet

if TYPE_CHECKING:
    from calibrary.cli.console import Screen
    from calibrary.jobs.fleet import CheckDocument

EXIT_BAD = 1

DESCRIPTION = "Check entries against the schema, their digest, path, provenance, the policy and one another."
EXAMPLES = """\
examples:
  calibrary registry check                               all that is committed
  calibrary registry check origin/main..HEAD             what a branch changes, and what that affects
  calibrary registry check --worktree                    the files in the folder, before they are committed

exit code 0: no error, possibly warnings; 1: at least one error.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(parser, Fleet.check, positional={"span": "REV..REV"})
    add_registry_flag(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note, out

    with Bar(note(arguments), "checking") as bar:
        done = call(opened(arguments).check, arguments, progress=bar)
    if arguments.json:
        print_json(done)
    else:
        _show(out(arguments), done)
    return 0 if done.is_good else EXIT_BAD


def _show(screen: Screen, done: CheckDocument) -> None:
    from calibrary.cli.console import plain

    styles = {"error": "bold red", "warning": "yellow"}
    for finding in done.findings:
        said = f"{finding.message}; {finding.remedy}" if finding.remedy else finding.message
        style = styles.get(finding.severity.value, "")
        place, severity = plain(finding.place or ""), f"[{style}]{finding.severity.value}[/]"
        screen.say(f"{place}: {severity}: {plain(said)} [dim]({finding.rule})[/]")
    errors = len(done.errors)
    warnings = len(done.findings) - errors
    counts = f"{errors} error{'s' * (errors != 1)}, {warnings} warning{'s' * (warnings != 1)}"
    verdict = "[bold green]good[/]" if done.is_good else "[bold red]bad[/]"
    screen.say(f"{verdict}: {plain(done.what)}: {counts}")
