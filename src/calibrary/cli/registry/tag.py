"""``calibrary registry tag``: add or remove tags, by which entries can be found."""

from __future__ import annotations

import argparse
from typing import Any

from calibrary.cli.output import add_json_flag
from calibrary.cli.parser import Parser
from calibrary.cli.registry.deciding import decide
from calibrary.cli.registry.list_ import add_where_flag
from calibrary.cli.registry.place import add_registry_flag, opened

__all__ = ["DESCRIPTION", "EXAMPLES", "PARSER", "add_arguments", "run"]

DESCRIPTION = "Add tags to entries or remove them, in one commit."
EXAMPLES = """\
examples:
  calibrary registry tag P4R-03 P4R-05 +survey -spare
  calibrary registry tag --where 'model=FC6310R grade=calibrated' +survey
  calibrary registry list --where tags=survey

A tag has lower-case letters, digits and . _ -. It does not affect which K is used, and needs no approval.
"""
MINUS = "\u2212"


class _TagParser(Parser):
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


PARSER = _TagParser


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "words", nargs="+", metavar="KEY… +TAG -TAG", help="entries, +tags to add, -tags to remove"
    )
    add_where_flag(parser)
    parser.add_argument("--reason", metavar="TEXT", help="why, for the history")
    add_registry_flag(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    add = [word[1:] for word in arguments.words if word.startswith("+")]
    remove = [word[1:] for word in arguments.words if word.startswith(MINUS)]
    keys = [word for word in arguments.words if not word.startswith(("+", MINUS))]
    if not (add or remove):
        arguments.parser.error("expected +TAG or -TAG")
    if not (keys or arguments.where):
        arguments.parser.error("say of which entries: KEY, or --where CONDITIONS")
    change = opened(arguments).propose_edit(keys, where=arguments.where, add_tags=add, remove_tags=remove)
    return decide(arguments, change, "tagged", as_table=True)
