"""``calibrary registry approve``: approve proposed entries after review."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from calibrary.cli.commands import print_json
from calibrary.cli.flags import call
from calibrary.cli.registry import OfRegistry, opened, where
from calibrary.cli.registry.changes import agreed, can_ask, decide, screen_of_change
from calibrary.cli.registry.sync import SYNC, between_syncs
from calibrary.jobs.fleet import Fleet

if TYPE_CHECKING:
    from calibrary.jobs.fleet.changes import ProposedChange

DESCRIPTION = (
    "Approve proposals, so that runs use them: all of those named, or none if the check reports an error."
)
EXAMPLES = """\
examples:
  calibrary registry approve fc6310r                                  shows what changes, and asks
  calibrary registry approve fc6310r --digest 5d0c82e16a3b            only the file that 'add' or 'show' printed
  calibrary registry approve fc6310r@1f3a9c2                          the proposal of that commit
  calibrary registry approve fc6310r --sync                           fetches before it shows, and sends what it wrote
  calibrary registry approve registry.yaml                            who may approve from now on
  calibrary registry approve --from onboard/dji-fc6310r               all that 'calibrary onboard' proposed there

An approval is bound to the content that you reviewed. Without a digest or commit, the command shows the proposal and
asks on a terminal, and refuses elsewhere; --yes approves what it shows. A K that contradicts what is known of the
camera needs --force and a --reason, and stays marked.
"""


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    return between_syncs(arguments, _approve)


def _approve(arguments: argparse.Namespace) -> int:
    if RULES in arguments.keys:
        return _approve_rules(arguments)
    change = call(opened(arguments).propose_approval, arguments)
    return decide(arguments, change, is_agreed=_is_agreed)


RULES = "registry.yaml"


def _approve_rules(arguments: argparse.Namespace) -> int:
    """Put in force what registry.yaml asks for, once somebody has looked at it."""
    from calibrary.cli.console import errors

    if len(arguments.keys) > 1:
        arguments.parser.error(f"{RULES} is approved alone, without entries")
    fleet = opened(arguments)
    (asked, oid), (now, _) = fleet.rules()
    screen = screen_of_change(arguments)
    for line in ("in force:", *now.splitlines(), "registry.yaml asks for:", *asked.splitlines()):
        screen.say(line)
    digest = arguments.digests[0] if arguments.digests else oid
    if not arguments.digests:
        if not (arguments.yes or can_ask()):
            arguments.parser.error(
                "nothing was written: there is no terminal to ask on. Once you have looked at it: calibrary registry "
                f"approve {RULES}{where(arguments)} --digest {oid[:12]}"
            )
        if not agreed(arguments, "Put that in force?"):
            screen.say("nothing was written")
            return 0
    done = fleet.approve_rules(digest, arguments.reason)
    screen.say(f"approved in commit {(done.commit or '')[:12]}")
    for warning in done.warnings:
        errors().say(("note", "yellow"), f" {warning}")
    if arguments.json:
        print_json(done)
    return 0


def _is_agreed(arguments: argparse.Namespace, change: ProposedChange) -> bool:
    """Whether the change was reviewed: identified by its digest or commit, or confirmed now."""
    pending = [one for one in change.proposals.due if one.seen is not None]
    at_commits = bool(arguments.keys) and all("@" in key for key in arguments.keys)
    if not pending or arguments.digests or at_commits:
        return True
    names = pending[0].id if len(pending) == 1 else f"these {len(pending)} entries"
    if not (arguments.yes or can_ask()):
        digests = " ".join(f"--digest {(one.seen or '')[:12]}" for one in pending)
        branch = f" --from {arguments.source}" if arguments.source is not None else ""
        arguments.parser.error(
            f"nothing was written: there is no terminal to ask on. Once you have looked at it: calibrary registry "
            f"approve {' '.join(one.id for one in pending)}{branch}{where(arguments)} {digests}"
        )
    return agreed(arguments, f"Approve {names}?")


COMMAND = OfRegistry(
    Fleet.propose_approval,
    DESCRIPTION,
    EXAMPLES,
    run=run,
    positional={"keys": "KEY"},
    spelled={"source": "--from", "digests": "--digest"},
    without=("approve", "branch"),
    switches={"--yes -y": "approve what is proposed now, without asking"} | SYNC,
)
