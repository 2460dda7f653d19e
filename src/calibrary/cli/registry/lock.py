"""``calibrary registry lock``: pin the entries that a run depends on."""

from __future__ import annotations

import argparse

from calibrary.cli.commands import add_json_flag, print_json
from calibrary.cli.flags import add_flags, call
from calibrary.cli.registry import add_registry_flag, entries, note_waiting, opened
from calibrary.jobs.fleet import Fleet

DESCRIPTION = "Pin entries as they are now, so that a run can be repeated on the same ones."
EXAMPLES = """\
examples:
  calibrary registry lock                                every approved entry
  calibrary registry lock flight/                        the entries that apply to a flight's images
  calibrary registry lock dji/fc6310r sony/dsc-rx1rm2
  calibrary extract --image-dir flight/ --registry fleet --locked       later, with these only

Later runs read a registry in git at the pinned commit, and report what has changed since. They refuse a registry that
has lost that commit, and a plain folder in which a pinned entry has changed.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(parser, Fleet.lock, positional={"what": "IMAGE_DIR|KEY"})
    add_registry_flag(parser, at=True)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note, out, plain

    registry = opened(arguments)
    lock = call(registry.lock, arguments)
    for sentence in lock.unanswered:
        note(arguments).say(f"[yellow]note[/] {plain(sentence)}")
    note_waiting(arguments, registry, [pin.path for pin in lock.pins])
    at = f" at {lock.commit[:12]}" if lock.commit is not None else ""
    file = arguments.out or "calibrary.lock"
    out(arguments).say(plain(f"{file}: {entries(len(lock.pins))} pinned{at}"))
    if arguments.json:
        print_json(lock)
    return 0
