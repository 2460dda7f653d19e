"""``calibrary registry check``: whether every entry is sound, for people and for a push to be judged by."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.registry.place import add_registry_flag, snapshot_of
from calibrary.cli.registry.progress import Bar

if TYPE_CHECKING:
    from calibrary.cli.console import Screen
    from calibrary.policy import Policy
    from calibrary.registry.check_registry import Checked

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

EXIT_BAD = 1

DESCRIPTION = "Hold entries against the schema, their digest, path, provenance, the policy and one another."
EXAMPLES = """\
examples:
  calibrary registry check                               all that is committed
  calibrary registry check origin/main..HEAD             what a branch changes, and what that meets
  calibrary registry check --worktree                    the files as they lie here, before they are committed
  calibrary registry check --signatures --allowed-signers signers origin/main..HEAD

exit code 0: no error, warnings perhaps; 1: at least one error, or a commit that no listed signer signed.
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
        help="limits in place of those that registry.yaml names",
    )
    parser.add_argument(
        "--signatures", action="store_true", help="also check that a listed signer signed every commit"
    )
    parser.add_argument(
        "--allowed-signers",
        type=Path,
        metavar="FILE",
        help="who may sign with an ssh key, as ssh-keygen(1) writes it; never taken from the repository itself",
    )
    add_registry_flag(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note, out
    from calibrary.registry.check_registry import (
        check_all,
        check_range,
        check_signatures,
        check_work_tree,
        document_of,
        parse_range,
    )

    if arguments.worktree and (arguments.range is not None or arguments.signatures):
        arguments.parser.error("--worktree looks at files: it goes with neither REV..REV nor --signatures")
    if arguments.allowed_signers is not None and not arguments.signatures:
        arguments.parser.error("--allowed-signers goes with --signatures")
    snapshot, policy = snapshot_of(arguments), _policy(arguments)
    before, after = parse_range(arguments.range) if arguments.range is not None else (None, None)
    with Bar(note(arguments), "checking") as bar:
        if arguments.worktree:
            done = check_work_tree(snapshot, policy, progress=bar)
        elif before is not None:
            done = check_range(snapshot, before, after, policy, progress=bar)
        else:
            done = check_all(snapshot, policy, progress=bar)
    unsigned = None
    if arguments.signatures:
        unsigned = check_signatures(snapshot, arguments.allowed_signers, before=before, after=after)
    if arguments.json:
        print_json(document_of(done, unsigned))
    else:
        _show(out(arguments), done, unsigned)
    return 0 if done.report.is_good and not unsigned else EXIT_BAD


def _policy(arguments: argparse.Namespace) -> Policy | None:
    from calibrary.policy_file import policy_named

    return policy_named(arguments.policy) if arguments.policy is not None else None


def _show(screen: Screen, done: Checked, unsigned: tuple[str, ...] | None) -> None:
    from calibrary.cli.console import plain
    from calibrary.validation import Severity

    styles = {Severity.ERROR: "bold red", Severity.WARNING: "yellow"}
    findings = done.report.findings
    for finding in findings:
        said = f"{finding.message}; {finding.remedy}" if finding.remedy else finding.message
        style = styles.get(finding.severity, "")
        place, severity = plain(finding.place or ""), f"[{style}]{finding.severity.value}[/]"
        screen.say(f"{place}: {severity}: {plain(said)} [dim]({finding.rule})[/]")
    for line in unsigned or ():
        screen.say(f"[bold red]not signed[/]: {plain(line)}")
    errors = len(done.report.errors)
    warnings = len(findings) - errors
    counts = f"{errors} error{'s' * (errors != 1)}, {warnings} warning{'s' * (warnings != 1)}"
    verdict = "[bold green]good[/]" if done.report.is_good and not unsigned else "[bold red]bad[/]"
    screen.say(f"{verdict}: {plain(done.what)}: {counts}")
