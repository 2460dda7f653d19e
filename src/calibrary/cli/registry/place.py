"""The flag that says which registry, and the registry that it means."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibrary.api.fleet import Fleet

__all__ = ["add_registry_flag", "opened"]


def add_registry_flag(parser: argparse.ArgumentParser) -> None:
    """Add ``--registry``."""
    parser.add_argument(
        "--registry",
        type=Path,
        metavar="PATH",
        help="which one; see calibrary registry --help for the default",
    )


def opened(arguments: argparse.Namespace, at: str | None = None) -> Fleet:
    """The registry that is meant, at a revision.

    Raises:
        RegistryError: none is meant.
    """
    from calibrary.api.fleet import Fleet

    return Fleet.named(arguments.registry, at)
