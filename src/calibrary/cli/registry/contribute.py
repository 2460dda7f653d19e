"""``calibrary registry contribute``: write an entry for a public registry, without private data."""

from __future__ import annotations

import argparse
from pathlib import Path

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.registry.place import add_registry_flag, opened

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = (
    "Write an approved entry as a proposal for a public registry. The proposal is of the model, with the "
    "evidence behind it (digests, date, tool, σ) and without serial number, label, tags, notes, and names of "
    "files and people."
)
EXAMPLES = """\
examples:
  calibrary registry contribute fc6310r ../public-registry    then commit it there, and open a pull request

The calibration of one unit is an estimate for its model: the grade becomes derived, the tolerance at least 3 %, and σ
is stated as evidence of that unit. The command refuses drafts, retired entries, typed and overridden values, and a unit
from which another unit of the model differs by more than 3 %. Look at the file before you send it.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("key", metavar="KEY", help="the entry")
    parser.add_argument(
        "out", type=Path, metavar="OUT", help="a clone of the public registry, or any other folder"
    )
    add_registry_flag(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import out, plain
    from calibrary.records import to_json

    done = opened(arguments).contribute(arguments.key, arguments.out)
    if arguments.json:
        print_json(to_json(done))
        return 0
    screen = out(arguments)
    screen.say(f"wrote {plain(done.file)}: grade {done.grade.value}, a draft for review")
    if done.left_out:
        screen.say(f"left out: {plain(', '.join(done.left_out))}; look at the file before you send it")
    return 0
