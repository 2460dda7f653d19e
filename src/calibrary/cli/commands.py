"""Commands by name, and their parser. A command's module is loaded, and its arguments declared, when it is needed."""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib import import_module
from typing import Any, NamedTuple, NoReturn

from calibrary.cli.output import add_output_flags

__all__ = ["Command", "Commands", "Parser", "add_commands", "meant"]

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

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Suggest the nearest word for one that is not accepted."""
        if action.choices is None or value in action.choices:
            return
        words = [str(word) for word in action.choices]
        expected = meant(str(value), words) or f"expected {', '.join(words)}"
        raise argparse.ArgumentError(action, f"there is no {str(value)!r:.60}; {expected}")

    def error(self, message: str) -> NoReturn:
        """Print the error and where the flags are explained, and exit."""
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
        module: name of its module, which defines ``DESCRIPTION``, ``EXAMPLES``, ``add_arguments(parser)``,
            ``run(arguments)`` unless it only groups others, and ``PARSER`` if it needs its own parser class.
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
        module: Any = import_module(command.module)
        kind: type[Parser] = getattr(module, "PARSER", Parser)
        parser = kind(
            prog=f"{self._prog} {command.name}", description=module.DESCRIPTION, epilog=module.EXAMPLES
        )
        module.add_arguments(parser)
        if hasattr(module, "run"):
            add_output_flags(parser)
            parser.set_defaults(run=module.run, parser=parser)
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
