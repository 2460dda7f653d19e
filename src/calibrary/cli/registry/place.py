"""The flag that selects the registry, and opening of that registry."""

from __future__ import annotations

import argparse
import shlex
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from calibrary.jobs.fleet import Fleet

__all__ = ["add_layers_flag", "add_registry_flag", "note_cut", "note_waiting", "opened", "where"]


def add_registry_flag(parser: argparse.ArgumentParser) -> None:
    """Add ``--registry``."""
    parser.add_argument(
        "--registry",
        metavar="PATH",
        help="the registry; folder:PATH for files without git. calibrary registry --help explains the default",
    )


def add_layers_flag(parser: argparse._ActionsContainer, text: str) -> None:
    """Add ``--registry`` for a command that reads several registries, including published ones."""
    parser.add_argument("--registry", action="append", metavar="PATH|URL", help=text)


def where(arguments: argparse.Namespace) -> str:
    """Return the flag that selects the same registry in the next command; empty if none was given."""
    return f" --registry {shlex.quote(str(arguments.registry))}" if arguments.registry is not None else ""


def note_cut(arguments: argparse.Namespace, registry: Fleet) -> None:
    """Report on standard error if the history is incomplete."""
    from calibrary.cli.console import note, plain

    if registry.cut is not None:
        note(arguments).say(plain(registry.cut))


def note_waiting(arguments: argparse.Namespace, registry: Fleet, paths: Iterable[str]) -> None:
    """Report on standard error which of the given entries have another K that waits for approval."""
    from calibrary.cli.console import note, plain

    if (sentence := registry.waiting(paths)) is not None:
        note(arguments).say(f"[yellow]note[/] {plain(sentence)}")


def opened(arguments: argparse.Namespace, at: str | None = None) -> Fleet:
    """Open the selected registry, at a revision for queries.

    Raises:
        RegistryError: no registry is selected.
    """
    from calibrary.jobs.fleet import Fleet

    return Fleet.named(arguments.registry, at)
