"""The flag that says which registry, and the registry that it means."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibrary.keep.keeper import Keeper

__all__ = ["add_registry_flag", "opened"]


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
