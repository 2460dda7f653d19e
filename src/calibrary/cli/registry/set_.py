"""``calibrary registry set``: set labels, tags, notes and dates of many entries, as one commit."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from calibrary.cli.output import add_json_flag
from calibrary.cli.registry.asking import add_yes_flag, agreed
from calibrary.cli.registry.deciding import decide
from calibrary.cli.registry.list_ import CONDITIONS, add_where_flag
from calibrary.cli.registry.place import add_registry_flag, opened

if TYPE_CHECKING:
    from calibrary.jobs.fleet.changes import ProposedChange

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = (
    "Set fields of one entry or of many, except K, in one commit; the command first shows what changes."
)
EXAMPLES = f"""\
examples:
  calibrary registry set P4R-03 notes="lens replaced in May"
  calibrary registry set --where 'model=FC6310R tags=survey' tags+=season-2026 --dry-run
  calibrary registry set --where 'grade=calibrated date<2024' valid-until=2026-12-31 --yes

FIELD=VALUE is label=, tags= += -=, notes= +=, valid-from= or valid-until=; an empty value removes the field.
Labels, tags and notes are written into the entry, and its approval stays valid. Days decide which K an image gets, so
new days are a proposal that 'calibrary registry approve' approves. Only 'add' and 'approve' change K.

{CONDITIONS}"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("words", nargs="+", metavar="KEY… FIELD=VALUE…", help="entries, and fields to set")
    add_where_flag(parser)
    parser.add_argument("--dry-run", action="store_true", help="show what would change, and write nothing")
    parser.add_argument(
        "--approve", action="store_true", help="approve other days at once, as 'add --approve'"
    )
    parser.add_argument("--reason", metavar="TEXT", help="why, for the history")
    add_registry_flag(parser)
    add_yes_flag(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    assignments = [word for word in arguments.words if "=" in word]
    keys = [word for word in arguments.words if "=" not in word]
    if not assignments:
        arguments.parser.error("expected FIELD=VALUE")
    if not (keys or arguments.where):
        arguments.parser.error("say of which entries: KEY, or --where CONDITIONS")
    change = opened(arguments).propose_edit(
        keys, assignments, where=arguments.where, approve=arguments.approve
    )
    return decide(arguments, change, "changed", is_agreed=_is_agreed, as_table=True)


def _is_agreed(arguments: argparse.Namespace, change: ProposedChange) -> bool:
    due = change.proposals.due
    what = due[0].entry.id if len(due) == 1 else f"these {len(due)} entries"
    return not arguments.dry_run and agreed(arguments, f"Change {what}?")
