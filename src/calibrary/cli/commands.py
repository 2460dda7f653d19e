"""Commands by name; the module of one is loaded, and its arguments are declared, when it is asked for."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from importlib import import_module
from typing import Any, NamedTuple

from calibrary.cli.output import add_output_flags
from calibrary.cli.parser import Parser

__all__ = ["Command", "Commands", "add_commands"]


class Command(NamedTuple):
    """A command, described without its module.

    Attributes:
        name: as it is typed.
        help: its line in the list of commands.
        module: with ``DESCRIPTION``, ``EXAMPLES``, ``add_arguments(parser)``, ``run(arguments)`` unless it only groups
            others, and ``PARSER`` if its parser is not the plain one.
    """

    name: str
    help: str
    module: str


class Commands(Mapping[str, argparse.ArgumentParser]):
    """The parsers of commands, each made when it is first looked up."""

    def __init__(self, prog: str, commands: Sequence[Command]) -> None:
        self._prog = prog
        self._commands = {command.name: command for command in commands}
        self._parsers: dict[str, argparse.ArgumentParser] = {}

    def __getitem__(self, name: str) -> argparse.ArgumentParser:
        if name not in self._parsers:
            self._parsers[name] = self._made(self._commands[name])
        return self._parsers[name]

    def __contains__(self, name: object) -> bool:
        return name in self._commands

    def __iter__(self) -> Iterator[str]:
        return iter(self._commands)

    def __len__(self) -> int:
        return len(self._commands)

    def _made(self, command: Command) -> argparse.ArgumentParser:
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
    """Let a parser's next argument be one of these commands.

    Args:
        parser: of the command that groups them.
        commands: in the order in which its help lists them.
        settings: of :meth:`argparse.ArgumentParser.add_subparsers`.
    """
    action = parser.add_subparsers(metavar="COMMAND", required=True, **settings)
    action._choices_actions += [action._ChoicesPseudoAction(one.name, [], one.help) for one in commands]
    lazily: Any = Commands(parser.prog, commands)
    action.choices = action._name_parser_map = lazily
