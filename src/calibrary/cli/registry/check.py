"""``calibrary registry check``: check all entries; for users, and for a hook or CI that accepts a push."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.progress import Bar
from calibrary.cli.registry.place import add_registry_flag, opened

if TYPE_CHECKING:
    from calibrary.cli.console import Screen
    from calibrary.jobs.fleet.results import CheckResult

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

EXIT_BAD = 1

DESCRIPTION = "Check entries against the schema, their digest, path, provenance, the policy and one another."
EXAMPLES = """\
examples:
  calibrary registry check                               all that is committed
  calibrary registry check origin/main..HEAD             what a branch changes, and what that affects
  calibrary registry check --worktree                    the files in the folder, before they are committed
  calibrary registry check --signatures --allowed-signers signers origin/main..HEAD

exit code 0: no error, possibly warnings; 1: at least one error, or a commit that no listed signer signed.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "range", nargs="?", metavar="REV..REV", help="only what changed between two revisions"
    )
    parser.add_argument("--worktree", action="store_true", help="the files of the checkout, committed or not")
    parser.add_argument(
        "--policy",
        metavar="{fleet,source}|FILE",
        help="use these limits instead of those in registry.yaml",
    )
    parser.add_argument(
        "--signatures", action="store_true", help="also check that a listed signer signed every commit"
    )
    parser.add_argument(
        "--allowed-signers",
        type=Path,
        metavar="FILE",
        help="file of the ssh keys that may sign, as for ssh-keygen(1); it is never taken from the repository itself",
    )
    add_registry_flag(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note, out

    if arguments.worktree and (arguments.range is not None or arguments.signatures):
        arguments.parser.error("--worktree looks at files: it goes with neither REV..REV nor --signatures")
    if arguments.allowed_signers is not None and not arguments.signatures:
        arguments.parser.error("--allowed-signers goes with --signatures")
    registry = opened(arguments)
    with Bar(note(arguments), "checking") as bar:
        done = registry.check(
            arguments.range, policy=arguments.policy, work_tree=arguments.worktree, progress=bar
        )
    if arguments.signatures:
        done = done.with_signatures(registry.unsigned(arguments.allowed_signers, arguments.range))
    if arguments.json:
        print_json(done.to_dict())
    else:
        _show(out(arguments), done)
    return 0 if done.is_good else EXIT_BAD


def _show(screen: Screen, done: CheckResult) -> None:
    from calibrary.cli.console import plain

    styles = {"error": "bold red", "warning": "yellow"}
    report = done.checked.report
    findings = report.findings
    for finding in findings:
        said = f"{finding.message}; {finding.remedy}" if finding.remedy else finding.message
        style = styles.get(finding.severity.value, "")
        place, severity = plain(finding.place or ""), f"[{style}]{finding.severity.value}[/]"
        screen.say(f"{place}: {severity}: {plain(said)} [dim]({finding.rule})[/]")
    for line in done.unsigned or ():
        screen.say(f"[bold red]not signed[/]: {plain(line)}")
    errors = len(report.errors)
    warnings = len(findings) - errors
    counts = f"{errors} error{'s' * (errors != 1)}, {warnings} warning{'s' * (warnings != 1)}"
    verdict = "[bold green]good[/]" if done.is_good else "[bold red]bad[/]"
    screen.say(f"{verdict}: {plain(done.checked.what)}: {counts}")
