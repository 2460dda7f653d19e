"""The flag that says which registry, and the registry that it means."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibrary.registry.registry import Registry
    from calibrary.registry.snapshot import Snapshot

__all__ = ["add_registry_flag", "opened", "snapshot_of"]


def add_registry_flag(parser: argparse.ArgumentParser) -> None:
    """Add ``--registry``."""
    parser.add_argument(
        "--registry",
        type=Path,
        metavar="PATH",
        help="which one; see calibrary registry --help for the default",
    )


def opened(arguments: argparse.Namespace) -> Registry:
    """The registry that is meant.

    Raises:
        RegistryError: there is none.
    """
    from calibrary.registry.configuration import require_registry
    from calibrary.registry.registry import Registry

    return Registry.open(require_registry(arguments.registry))


def snapshot_of(arguments: argparse.Namespace, rev: str | None = None) -> Snapshot:
    """The entries of the registry that is meant, at a revision; a plain folder of files will do.

    Raises:
        RegistryError: there is none, or no such revision.
    """
    from calibrary.registry.configuration import require_registry
    from calibrary.registry.registry import open_snapshot

    return open_snapshot(require_registry(arguments.registry), rev)
