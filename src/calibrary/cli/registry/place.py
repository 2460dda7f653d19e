"""The flag that says which registry, and the registry that it means."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibrary.api.fleet import Fleet

__all__ = ["add_registry_flag", "note_cut", "opened"]


def add_registry_flag(parser: argparse.ArgumentParser) -> None:
    """Add ``--registry``."""
    parser.add_argument(
        "--registry",
        type=Path,
        metavar="PATH",
        help="which one; folder:PATH for files without git. See calibrary registry --help for the default",
    )


def note_cut(arguments: argparse.Namespace, registry: Fleet) -> None:
    """Say on standard error that the history is not whole, where it is not."""
    from calibrary.cli.console import note, plain

    if registry.cut is not None:
        note(arguments).say(plain(registry.cut))


def opened(arguments: argparse.Namespace, at: str | None = None) -> Fleet:
    """The registry that is meant, at a revision.

    Raises:
        RegistryError: none is meant.
    """
    from calibrary.api.fleet import Fleet

    return Fleet.named(arguments.registry, at)
