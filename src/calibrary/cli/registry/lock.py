"""``calibrary registry lock``: pin the entries that a run depends on."""

from __future__ import annotations

import argparse
from pathlib import Path

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.registry.place import add_registry_flag, note_waiting, opened

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

LOCK_FILE = "calibrary.lock"
"""Copy of :data:`calibrary.registry.locking.LOCK_FILE`, so as not to load that module."""

DESCRIPTION = "Pin entries as they are now, so that a run can be repeated on the same ones."
EXAMPLES = """\
examples:
  calibrary registry lock                                every approved and held entry
  calibrary registry lock flight/                        the entries that apply to a flight's images
  calibrary registry lock dji/fc6310r sony/dsc-rx1rm2
  calibrary extract --image-dir flight/ --registry fleet --locked       later, with these only

Later runs read a registry in git at the pinned commit, and report what has changed since. They refuse a registry that
has lost that commit, and a plain folder in which a pinned entry has changed.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "what", nargs="*", metavar="IMAGE_DIR|KEY", help="images or entries (default: all usable ones)"
    )
    parser.add_argument(
        "--out", type=Path, default=Path(LOCK_FILE), metavar="FILE", help=f"lock file (default: {LOCK_FILE})"
    )
    parser.add_argument("--recursive", action="store_true", help="go into the sub-folders of IMAGE_DIR")
    parser.add_argument("--at", metavar="REV", help="as it was at a commit, tag, branch or day")
    add_registry_flag(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note, out, plain

    registry = opened(arguments)
    found = registry.lock(arguments.what, recursive=arguments.recursive)
    for sentence in found.unanswered:
        note(arguments).say(f"[yellow]note[/] {plain(sentence)}")
    note_waiting(arguments, registry, [pin.path for pin in found.lock.pins])
    found.write(arguments.out)
    lock = found.lock
    count = len(lock.pins)
    at = f" at {lock.commit[:12]}" if lock.commit is not None else ""
    line = f"{arguments.out}: {count} {'entry' if count == 1 else 'entries'} pinned{at}"
    out(arguments).say(plain(line))
    if arguments.json:
        print_json(found.to_dict())
    return 0
