"""``calibrary registry set``: set labels, tags, notes and days of many entries in one commit, by a table too."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from calibrary.cli.commands import Parser
from calibrary.cli.flags import add_flags, call
from calibrary.cli.registry import OfRegistry, entries, opened
from calibrary.cli.registry.changes import YES, agreed, decide
from calibrary.cli.registry.list_ import CONDITIONS
from calibrary.jobs.fleet import Fleet

if TYPE_CHECKING:
    from calibrary.jobs.fleet.changes import ProposedChange

DESCRIPTION = (
    "Set labels, tags, notes or days of entries, in one commit; the command first shows what changes."
)
EXAMPLES = f"""\
examples:
  calibrary registry set dji/fc6310r/sn-0e25 label=P4R-03        your name for a unit, by its serial number too
  calibrary registry set P4R-03 P4R-05 +survey -spare            tags
  calibrary registry set P4R-03 notes="lens replaced in May"
  calibrary registry set --where 'model=FC6310R tags=survey' +season-2026 --dry-run
  calibrary registry set --where 'grade=calibrated date<2024' valid-until=2026-12-31 --yes
  calibrary registry set --out fleet.csv                         a table of all entries, for a spreadsheet
  calibrary registry set --table fleet.csv --dry-run             what was edited in it

FIELD=VALUE is label=, tags= += -=, notes= +=, valid-from= or valid-until=; an empty value removes the field. A label
belongs to one unit and is for all its entries; it is a KEY from then on. A tag has lower-case letters,
digits and . _ -. Labels, tags and notes are written into the entry, and its approval stays valid. Days decide which K
an image gets, so new days are a proposal that 'calibrary registry approve' approves. Only 'add' and 'approve' change K.

A table is one that --out wrote and any spreadsheet saved, or your own with the columns serial and label. Commas,
semicolons or tabs separate its cells; it may have decimal commas and a byte order mark. Label, tags and notes are taken
from it; the other columns are for reading. A colleague's change since then stays; a row in which both of you changed
one cell is refused. If a row is wrong, nothing is written (exit code 1).

{CONDITIONS}"""
MINUS = "\u2212"
TABLE = "as a table"


class _SetParser(Parser):
    """Parser that takes ``-spare`` as a tag to remove, where argparse would see a flag."""

    # The base class has four overloads of this signature; Any covers all of them.
    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse the arguments after the command's name, as the base class does."""
        known = self._option_string_actions
        words = [
            f"{MINUS}{word[1:]}"
            if word.startswith("-") and word[1:2].isalnum() and word not in known
            else word
            for word in args or ()
        ]
        return super().parse_known_args(words, namespace)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    registry, words = opened(arguments), arguments.words
    changes = [word.replace(MINUS, "-", 1) for word in words if "=" in word or word[:1] in {"+", MINUS}]
    keys = [word for word in words if word not in changes and not word.startswith(MINUS)]
    if arguments.out is not None:
        if words or arguments.table is not None:
            arguments.parser.error(
                "--out writes a table and sets nothing; leave out KEY, FIELD=VALUE and --table"
            )
        return _written(arguments, registry)
    change = call(registry.propose_edit, arguments, keys=keys, changes=changes)
    return decide(
        arguments,
        change,
        is_agreed=_is_agreed,
        as_table=True,
        remedy="put these rows right first" if change.proposals.problems else "put the errors right first",
    )


def _written(arguments: argparse.Namespace, registry: Fleet) -> int:
    from calibrary.cli.console import note

    count = call(registry.write_table, arguments)
    note(arguments).say(f"wrote {entries(count)} to {arguments.out!s}")
    return 0


def _is_agreed(arguments: argparse.Namespace, change: ProposedChange) -> bool:
    due = change.proposals.due
    what = due[0].id if len(due) == 1 else f"these {len(due)} entries"
    return not arguments.dry_run and agreed(arguments, f"Change {what}?")


class _Set(OfRegistry):
    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the words, and the flags of both jobs."""
        parser.add_argument(
            "words",
            nargs="*",
            metavar="KEY… FIELD=VALUE +TAG -TAG",
            help="entries, and what to set, add or remove",
        )
        super().add_arguments(parser)
        add_flags(parser, Fleet.write_table, groups={TABLE: ("out",)}, optional=("out",))


COMMAND = _Set(
    Fleet.propose_edit,
    DESCRIPTION,
    EXAMPLES,
    run=run,
    kind=_SetParser,
    groups={TABLE: ("table",)},
    without=("keys", "changes", "force", "branch", "valid_from", "valid_until"),
    switches={"--dry-run": "show what would change, and write nothing"} | YES,
)
