"""The flag that selects the registry, and opening of that registry."""

from __future__ import annotations

import argparse
import shlex
from typing import TYPE_CHECKING

from calibrary.cli.flags import add_flags, call
from calibrary.jobs.fleet import Fleet

if TYPE_CHECKING:
    from collections.abc import Iterable

__all__ = ["add_registry_flag", "note_cut", "note_waiting", "opened", "where"]


def add_registry_flag(parser: argparse.ArgumentParser, *, at: bool = False) -> None:
    """Add ``--registry``, and ``--at`` for a command that reads an earlier state."""
    add_flags(parser, Fleet.named, without=() if at else ("at",))


def where(arguments: argparse.Namespace) -> str:
    """Return the flag that selects the same registry in the next command; empty if none was given."""
    return f" --registry {shlex.quote(str(arguments.registry))}" if arguments.registry is not None else ""


def opened(arguments: argparse.Namespace) -> Fleet:
    """Open the selected registry, at the selected state.

    Raises:
        RegistryError: no registry is selected.
    """
    return call(Fleet.named, arguments)


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
