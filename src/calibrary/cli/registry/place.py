"""The flag that says which registry, and the registry that it means."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibrary.keep.keeper import Keeper
    from calibrary.keep.shelf import Shelf

__all__ = ["add_registry_flag", "opened", "shelf_of"]


def add_registry_flag(parser: argparse.ArgumentParser) -> None:
    """Add ``--registry``."""
    parser.add_argument(
        "--registry",
        type=Path,
        metavar="PATH",
        help="which one; see calibrary registry --help for the default",
    )


def opened(arguments: argparse.Namespace) -> Keeper:
    """The registry that is meant.

    Raises:
        RegistryError: there is none.
    """
    from calibrary.keep.keeper import Keeper
    from calibrary.keep.place import require_registry

    return Keeper.open(require_registry(arguments.registry))


def shelf_of(arguments: argparse.Namespace, rev: str | None = None) -> Shelf:
    """The entries of the registry that is meant, at a revision; a plain folder of files will do.

    Raises:
        RegistryError: there is none, or no such revision.
    """
    from calibrary.keep.place import require_registry
    from calibrary.keep.shelf import open_shelf

    return open_shelf(require_registry(arguments.registry), rev)
