"""Commands by name, and their parser. A command's module is loaded, and its arguments declared, when it is needed.

With them the flags that every command has, and the output of ``--json``. No heavy library is loaded here.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from codecs import getincrementaldecoder
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, NoReturn

if TYPE_CHECKING:
    from calibrary.jobs.tables.rows import Table
    from calibrary.records import Record


EXIT_USAGE = 2


class Parser(argparse.ArgumentParser):
    """An argument parser that reports an error in one line instead of printing the usage."""

    def __init__(self, **settings: Any) -> None:
        """Create the parser; line breaks of the examples are kept."""
        settings.setdefault("formatter_class", argparse.RawDescriptionHelpFormatter)
        super().__init__(**settings)

    # The base class has overloads of this signature; Any covers all of them.
    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse the arguments; unrecognised ones are reported by the command that they were given to."""
        arguments, unknown = self.parse_known_args(args, namespace)
        if unknown:
            getattr(arguments, "parser", self).error(f"unrecognized arguments: {' '.join(unknown)}")
        return arguments

    def _match_arguments_partial(
        self, actions: Sequence[argparse.Action], arg_strings_pattern: str
    ) -> list[int]:
        """Leave what may be given last open while flags follow: ``check FOLDER --recursive FILE``."""
        # In Python 3.11 the base class takes the file as not given once a flag follows.
        counts: list[int] = super()._match_arguments_partial(actions, arg_strings_pattern)
        while counts and counts[-1] == 0 and "O" in arg_strings_pattern:
            counts.pop()
        return counts

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Suggest the nearest word for one that is not accepted."""
        if action.choices is None or value in action.choices:
            return
        words = [str(word) for word in action.choices]
        expected = meant(str(value), words) or f"expected {', '.join(words)}"
        raise argparse.ArgumentError(action, f"there is no {str(value)!r:.60}; {expected}")

    def error(self, message: str) -> NoReturn:
        """Print the error and where the flags are explained, and exit."""
        if message.startswith("the following arguments are required") and (
            example := re.search(r"^  (calibrary .*?)(?:  |$)", self.epilog or "", re.MULTILINE)
        ):
            message += f", as in {example[1]!r}"
        stop = "" if message.endswith("?") else ";"
        self.exit(EXIT_USAGE, f"{self.prog}: {message.rstrip('.')}{stop} see '{self.prog} --help'\n")


def meant(word: str, words: Iterable[str]) -> str:
    """Return "did you mean NAME?" for the name that is spelled most like a word; empty if none is."""
    from difflib import get_close_matches

    by_key = {one.casefold(): one for one in words}
    near = get_close_matches(word.casefold(), by_key, 1, cutoff=0.75)
    return f"did you mean {by_key[near[0]]}?" if near else ""


class Command(NamedTuple):
    """Description of a command that does not require its module.

    Attributes:
        name: as typed.
        help: its line in the list of commands.
        module: name of its module, whose ``COMMAND`` makes the parser.
    """

    name: str
    help: str
    module: str


class Commands(Mapping[str, argparse.ArgumentParser]):
    """Mapping of command names to parsers, each created on first access."""

    def __init__(self, prog: str, commands: Sequence[Command]) -> None:
        self._prog = prog
        self._commands = {command.name: command for command in commands}
        self._parsers: dict[str, argparse.ArgumentParser] = {}

    def __getitem__(self, name: str) -> argparse.ArgumentParser:
        if name not in self._parsers:
            self._parsers[name] = self._parser_of(self._commands[name])
        return self._parsers[name]

    def __contains__(self, name: object) -> bool:
        return name in self._commands

    def __iter__(self) -> Iterator[str]:
        return iter(self._commands)

    def __len__(self) -> int:
        return len(self._commands)

    def _parser_of(self, command: Command) -> argparse.ArgumentParser:
        declared = import_module(command.module).COMMAND
        parser: argparse.ArgumentParser = declared.parser(f"{self._prog} {command.name}")
        return parser


def add_commands(parser: argparse.ArgumentParser, commands: Sequence[Command], **settings: Any) -> None:
    """Add commands to a parser.

    Args:
        parser: of the command that groups them.
        commands: in the order of the help text.
        settings: arguments of :meth:`argparse.ArgumentParser.add_subparsers`.
    """
    action = parser.add_subparsers(metavar="COMMAND", required=True, **settings)
    action._choices_actions += [action._ChoicesPseudoAction(one.name, [], one.help) for one in commands]
    lazily: Any = Commands(parser.prog, commands)
    action.choices = action._name_parser_map = lazily


GROUP = "what is printed"
PART_BYTES = 1 << 20
_BEYOND_ASCII = re.compile(r"[^\x00-\x7f]+")


def add_json_flag(parser: argparse.ArgumentParser) -> None:
    """Add ``--json``."""
    _group(parser).add_argument(
        "--json",
        action="store_true",
        help="print one JSON document on standard output, and nothing else there",
    )


def add_table_flag(parser: argparse.ArgumentParser, of: str, *, name: str = "--table") -> None:
    """Add ``--table``, or another flag of a table.

    Args:
        parser: of the command.
        of: what a row represents.
        name: of the flag.
    """
    _group(parser).add_argument(
        name,
        metavar="FILE",
        help=f"also write a table of {of}: .csv, or .parquet (calibrary[tables]); - prints CSV in place of the results",
    )


def check_table_flag(arguments: argparse.Namespace, *, name: str = "table") -> None:
    """Check before any work is done that the table can be written."""
    place = getattr(arguments, name)
    if place == "-" and arguments.json:
        arguments.parser.error(f"--{name.replace('_', '-')} - and --json both print on standard output")
    if place not in {None, "-"}:
        from calibrary.jobs.tables.rows import check_table_place

        check_table_place(Path(place))


def write_table(place: str | None, table: Callable[[], Table]) -> None:
    """Write the table to the place given by the flag of :func:`add_table_flag`, if it was given."""
    if place == "-":
        sys.stdout.write(table().to_csv())
    elif place is not None:
        table().write(Path(place))


def add_output_flags(parser: argparse.ArgumentParser) -> None:
    """Add ``--quiet`` and ``--verbose``."""
    amount = _group(parser).add_mutually_exclusive_group()
    amount.add_argument("--quiet", "-q", action="store_true", help="print only results and errors")
    amount.add_argument(
        "--verbose", "-v", action="count", default=0, help="print more on standard error; twice: every detail"
    )


def print_json(document: Mapping[str, object] | Record, *, indent: Literal[2] | None = 2) -> None:
    """Print the document as ASCII, whatever the terminal's language."""
    from calibrary.records import encoded

    octets, decoder = encoded(document, indent=indent or 0), getincrementaldecoder("utf-8")()
    # In parts, because each step to the terminal copies what it is given.
    for start in range(0, len(octets), PART_BYTES):
        text = decoder.decode(octets[start : start + PART_BYTES])
        sys.stdout.write(text if text.isascii() else _BEYOND_ASCII.sub(_escaped, text))
    sys.stdout.write("\n")


def _escaped(found: re.Match[str]) -> str:
    return json.dumps(found[0])[1:-1]


def _group(parser: argparse.ArgumentParser) -> argparse._ArgumentGroup:
    """The argument group of these flags, which ``--json`` may already have created."""
    for group in parser._action_groups:
        if group.title == GROUP:
            return group
    return parser.add_argument_group(GROUP)
