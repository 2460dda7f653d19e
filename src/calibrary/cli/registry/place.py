"""The flag that says which registry, and the registry that it means."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from calibrary.api.fleet import Fleet
    from calibrary.api.fleet_view import FleetView

__all__ = ["add_layers_flag", "add_registry_flag", "note_cut", "note_waiting", "opened", "viewed"]


def add_registry_flag(parser: argparse.ArgumentParser) -> None:
    """Add ``--registry``."""
    parser.add_argument(
        "--registry",
        type=_folder,
        metavar="PATH",
        help="which one; folder:PATH for files without git. See calibrary registry --help for the default",
    )


def add_layers_flag(parser: argparse._ActionsContainer, text: str) -> None:
    """Add ``--registry`` of a command that reads several, published ones too."""
    parser.add_argument("--registry", action="append", metavar="PATH|URL", help=text)


def _folder(text: str) -> Path:
    """A registry's folder.

    Raises:
        ArgumentTypeError: it is an address on the web.
    """
    if text.lower().startswith(("http://", "https://")):
        raise argparse.ArgumentTypeError(
            f"{text}: a published registry is read by 'resolve', 'extract' and 'check'; this needs a registry's folder"
        )
    return Path(text)


def note_cut(arguments: argparse.Namespace, registry: FleetView) -> None:
    """Say on standard error that the history is not whole, where it is not."""
    from calibrary.cli.console import note, plain

    if registry.cut is not None:
        note(arguments).say(plain(registry.cut))


def note_waiting(arguments: argparse.Namespace, registry: FleetView, paths: Iterable[str]) -> None:
    """Say on standard error for which of some entries another K waits for approval."""
    from calibrary.cli.console import note, plain

    if (sentence := registry.waiting(paths)) is not None:
        note(arguments).say(f"[yellow]note[/] {plain(sentence)}")


def opened(arguments: argparse.Namespace) -> Fleet:
    """The registry that is meant, to be changed.

    Raises:
        RegistryError: none is meant.
    """
    from calibrary.api.fleet import Fleet

    return Fleet.named(arguments.registry)


def viewed(arguments: argparse.Namespace, at: str | None = None) -> FleetView:
    """The registry that is meant, at a revision; to be read, without loading what changes one.

    Raises:
        RegistryError: none is meant.
    """
    from calibrary.api.fleet_view import FleetView

    return FleetView.named(arguments.registry, at)
