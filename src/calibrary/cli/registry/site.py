"""``calibrary registry site``: write the registry as web pages to a folder."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from calibrary.cli.flags import add_flags, call
from calibrary.cli.progress import Bar
from calibrary.cli.registry import add_registry_flag, entries, opened
from calibrary.jobs.fleet import Fleet

if TYPE_CHECKING:
    from calibrary.jobs.site.building import Site

DESCRIPTION = (
    "Write the registry as web pages: a list to search and filter, a page for each camera with its "
    "history and downloads, and every change compared. They need no server and fetch nothing."
)
EXAMPLES = """\
examples:
  calibrary registry site public/               open public/index.html; no server is needed
  calibrary registry site --registry fleet/ /srv/www/cameras

OUT is replaced as a whole, and only if it is new, empty, or an earlier site. The same commit gives the same bytes.
"calibrary desk" shows the pages of the registry as it is now in a browser, and works with it.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(parser, Fleet.write_site, positional={"out": "OUT"})
    add_registry_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note

    with Bar(note(arguments), "making") as bar:
        site = call(opened(arguments).write_site, arguments, progress=bar)
    return _show(arguments, site)


def _show(arguments: argparse.Namespace, site: Site) -> int:
    from calibrary.cli.console import errors, out, plain

    pages = sum(name.endswith(".html") for card in site.cards for name in card.files) + 1
    out(arguments).say(
        f"{entries(len(site.cards))} in {pages} pages; open {plain(str(site.root / 'index.html'))}"
    )
    broken = [card for card in site.cards if card.page is None]
    for card in broken:
        errors().say(f"[red]not shown[/] {plain(card.problem or card.id)}")
    return 1 if broken else 0
