"""The parser of every command: one line for what is wrong with the arguments, and help that keeps its lines."""

from __future__ import annotations

import argparse
from typing import Any, NoReturn

__all__ = ["Parser"]

EXIT_USAGE = 2


class Parser(argparse.ArgumentParser):
    """An argument parser that ends with one line in place of a block of usage."""

    def __init__(self, **settings: Any) -> None:
        """As the base; examples keep their lines."""
        settings.setdefault("formatter_class", argparse.RawDescriptionHelpFormatter)
        super().__init__(**settings)

    # The base has overloads of this one signature; Any says the same as all of them.
    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """As the base; what is not understood is said by the command that it was given to."""
        arguments, unknown = self.parse_known_args(args, namespace)
        if unknown:
            getattr(arguments, "parser", self).error(f"unrecognized arguments: {' '.join(unknown)}")
        return arguments

    def error(self, message: str) -> NoReturn:
        """Say what is wrong and where the flags are explained."""
        self.exit(EXIT_USAGE, f"{self.prog}: {message.rstrip('.')}; see '{self.prog} --help'\n")
