"""``calibrary registry label``: set the name that the fleet uses for a unit."""

from __future__ import annotations

import argparse

from calibrary.cli.output import add_json_flag
from calibrary.cli.registry.deciding import decide
from calibrary.cli.registry.place import add_registry_flag, opened

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = (
    "Give a unit a label: all of its entries get it, in one commit, and you can use it as a KEY from then on."
)
EXAMPLES = """\
examples:
  calibrary registry label dji/fc6310r/sn-0e25 P4R-03
  calibrary registry label 0V2LG3H0 P4R-03                the serial number; only its hash is in the registry
  calibrary registry label P4R-03 --remove                before another unit gets this name

A label belongs to one unit. It does not affect which K is used, and needs no approval.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("key", metavar="KEY", help="KEY of the unit, or of one of its entries")
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument("label", nargs="?", metavar="LABEL", help="such as P4R-03")
    what.add_argument("--remove", action="store_true", help="remove its label")
    parser.add_argument("--reason", metavar="TEXT", help="why, for the history")
    add_registry_flag(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    label = None if arguments.remove else arguments.label
    return decide(arguments, opened(arguments).propose_label(arguments.key, label), "labelled", as_table=True)
