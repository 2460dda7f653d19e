"""Argument parser of all commands: reports an error in one line, and keeps line breaks in the help text."""

from __future__ import annotations

import argparse
from typing import Any, NoReturn

__all__ = ["Parser"]

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

    def error(self, message: str) -> NoReturn:
        """Print the error and where the flags are explained, and exit."""
        self.exit(EXIT_USAGE, f"{self.prog}: {message.rstrip('.')}; see '{self.prog} --help'\n")
