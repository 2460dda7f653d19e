"""A command as a declaration over a job: its flags are the job's parameters, what it shows is the job's result.

>>> COMMAND = Shown(check, DESCRIPTION, EXAMPLES, doing="checking", exits={"is_right": 1})

The module of a command has one ``COMMAND``. What differs is a subclass with a method of its own.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from calibrary.cli.commands import (
    Command,
    Parser,
    add_commands,
    add_json_flag,
    add_output_flags,
    add_table_flag,
    check_table_flag,
    print_json,
    write_table,
)
from calibrary.cli.flags import add_flags, call

if TYPE_CHECKING:
    from calibrary.jobs.tables.rows import Table


class Shown:
    """A command that calls its job and shows the result: as its view, a JSON document, a table.

    Args:
        job: the function; of a command of the registry, a method of the registry.
        description: first paragraph of the help text.
        examples: its last.
        run: what the command does, where that is another thing than one call and one view; gives the exit code.
        said: lines that are printed in place of a view.
        doing: what the progress bar says; None for a job that takes no time.
        exits: what is asked of the result, and the exit code if it is not so; the first that is not decides.
        json: whether there is ``--json``.
        table: what a row of ``--table`` is, and the function that makes the table.
        told: package of the function that describes the result, if the result's record stands in another.
        always: structs among the job's parameters that are passed with their defaults if no flag fills them.
        switches: further flags without a value, with their help.
        kind: class of the parser.
        flags: as for :func:`~calibrary.cli.flags.add_flags`.
    """

    def __init__(  # noqa: PLR0913  one for each thing in which commands differ
        self,
        job: Callable[..., Any],
        description: str,
        examples: str,
        *,
        run: Callable[[argparse.Namespace], int] | None = None,
        said: Callable[[Any, argparse.Namespace], Iterable[str]] | None = None,
        doing: str | None = None,
        exits: Mapping[str, int] | None = None,
        json: bool = True,
        table: tuple[str, Callable[[Any], Table]] | None = None,
        told: str | None = None,
        always: Collection[str] = (),
        switches: Mapping[str, str] | None = None,
        kind: type[Parser] = Parser,
        **flags: Any,
    ) -> None:
        self.job: Final = job
        self._texts: Final = {"description": description, "epilog": examples}
        self._by_hand, self._said, self._doing = run, said, doing
        self._exits, self._told = exits or {}, told
        self._json, self._table, self._switches = json, table, switches or {}
        self._kind, self._flags, self._always = kind, flags, always

    def parser(self, prog: str) -> argparse.ArgumentParser:
        """Make the parser of the command."""
        parser = self._kind(prog=prog, **self._texts)
        self.add_arguments(parser)
        add_output_flags(parser)
        parser.set_defaults(run=self.run, parser=parser)
        return parser

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the command's arguments."""
        add_flags(parser, self.job, **self._flags)
        for names, text in self._switches.items():
            parser.add_argument(*names.split(), action="store_true", help=text)
        if self._json:
            add_json_flag(parser)
        if self._table is not None:
            add_table_flag(parser, self._table[0])

    def run(self, arguments: argparse.Namespace) -> int:
        """Run the command; returns the exit code."""
        self.check(arguments)
        if self._by_hand is not None:
            return self._by_hand(arguments)
        done = self.done(arguments)
        if self._table is not None:
            write_table(arguments.table, partial(self._table[1], done))
        if self._json and arguments.json:
            self.print_document(done, arguments)
        else:
            self.show(done, arguments)
        return self.exit_code(done, arguments)

    def check(self, arguments: argparse.Namespace) -> None:
        """End with a usage error, before any work, if the flags contradict one another."""
        if self._table is not None:
            check_table_flag(arguments)

    def done(self, arguments: argparse.Namespace, job: Callable[..., Any] | None = None) -> Any:
        """Call the job, with a progress bar if it takes time; returns its result."""
        job = job or self.job
        if self._doing is None:
            return call(job, arguments, self._always)
        from calibrary.cli.console import note
        from calibrary.cli.progress import Bar

        with Bar(note(arguments), self._doing) as bar:
            return call(job, arguments, self._always, progress=bar)

    def print_document(self, done: Any, arguments: argparse.Namespace) -> None:  # noqa: ARG002  for subclasses
        """Print the result as JSON."""
        print_json(done)

    def show(self, done: Any, arguments: argparse.Namespace, **how: Any) -> None:
        """Show the view of the result; ``how`` goes to the function that makes it."""
        from calibrary.cli.console import out

        if self._said is not None:
            for line in self._said(done, arguments):
                out(arguments).say(line)
            return
        from calibrary.cli.terminal import show
        from calibrary.view import view_of

        view = view_of(done, self._told, **how)
        show(out(arguments), view, whole=getattr(arguments, "explain", False))

    def exit_code(self, done: Any, arguments: argparse.Namespace) -> int:  # noqa: ARG002  for subclasses
        """The exit code that follows from the result."""
        return next((code for name, code in self._exits.items() if not getattr(done, name)), 0)


class Group:
    """A command that groups others."""

    def __init__(self, description: str, examples: str, commands: Sequence[Command]) -> None:
        self._texts, self._commands = {"description": description, "epilog": examples}, commands

    def parser(self, prog: str) -> argparse.ArgumentParser:
        """Make the parser of the group."""
        parser = Parser(prog=prog, **self._texts)
        add_commands(parser, self._commands, title="commands")
        return parser
