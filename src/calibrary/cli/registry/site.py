"""``calibrary registry site``: write the registry as web pages to a folder."""

from __future__ import annotations

import argparse
from pathlib import Path

from calibrary.cli.progress import Bar
from calibrary.cli.registry.place import add_registry_flag, opened

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = (
    "Write the registry as web pages: a list to search and filter, a page for each camera with its "
    "history and downloads, and every change compared. They need no server and fetch nothing."
)
EXAMPLES = """\
examples:
  calibrary registry site public/               open public/index.html; no server is needed
  calibrary registry site --registry fleet/ /srv/www/cameras

OUT is replaced as a whole, and only if it is new, empty, or an earlier site. The same commit gives the same bytes.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("out", type=Path, metavar="OUT", help="the folder")
    add_registry_flag(parser)
    parser.add_argument(
        "--workers", type=worker_count, metavar="N", help="processes (default: one per processor)"
    )


def worker_count(text: str) -> int:
    """Parse a number of processes.

    Raises:
        ArgumentTypeError: the text is not a number of processes.
    """
    if not text.isdecimal() or not 1 <= int(text) <= 256:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a whole number of processes, 1 … 256")
    return int(text)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import errors, note, out, plain

    folder = arguments.out
    with Bar(note(arguments), "making") as bar:
        site = opened(arguments).write_site(folder, workers=arguments.workers, progress=bar)
    pages = sum(name.endswith(".html") for card in site.cards for name in card.files) + 1
    out(arguments).say(
        f"{len(site.cards)} entries in {pages} pages; open {plain(str(folder / 'index.html'))}"
    )
    broken = [card for card in site.cards if card.page is None]
    for card in broken:
        errors().say(f"[red]not shown[/] {plain(card.problem or card.id)}")
    return 1 if broken else 0
