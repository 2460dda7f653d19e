"""``calibrary registry site``: write the registry as web pages to a folder, or serve them on this machine."""

from __future__ import annotations

import argparse
import sys
from typing import TYPE_CHECKING

from calibrary.cli.flags import add_flags, call
from calibrary.cli.progress import Bar
from calibrary.cli.registry import add_registry_flag, entries, opened
from calibrary.jobs.fleet import Fleet

if TYPE_CHECKING:
    from calibrary.jobs.site.building import Site

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = (
    "Write the registry as web pages: a list to search and filter, a page for each camera with its "
    "history and downloads, and every change compared. They need no server and fetch nothing."
)
EXAMPLES = """\
examples:
  calibrary registry site public/               open public/index.html; no server is needed
  calibrary registry site --registry fleet/ /srv/www/cameras
  calibrary registry site --serve               prints the address to open in a browser; Ctrl-C ends it
  calibrary registry site --serve --port 8710

OUT is replaced as a whole, and only if it is new, empty, or an earlier site. The same commit gives the same bytes.
What --serve shows can be reached from this machine only. When the registry changes, the pages are rebuilt; reload them.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(parser, Fleet.write_site, positional={"out": "OUT"})
    served = parser.add_argument_group("in a browser on this machine, in place of OUT")
    served.add_argument("--serve", action="store_true", help="show the pages until Ctrl-C")
    add_flags(parser, Fleet.server, without=["told"], groups={str(served.title): ["port"]})
    add_registry_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note

    if arguments.serve and arguments.out is not None:
        arguments.parser.error("--serve writes no folder; leave out OUT")
    if arguments.port is not None and not arguments.serve:
        arguments.parser.error("--port goes with --serve")
    if arguments.serve:
        return _serve(arguments)
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


def _serve(arguments: argparse.Namespace) -> int:
    from calibrary.cli.console import note, plain

    remarks = note(arguments)

    def told(text: str) -> None:
        remarks.say(plain(text))

    try:
        with Bar(remarks, "making") as bar:
            server = call(opened(arguments).server, arguments, told=told, progress=bar)
        with server:
            sys.stdout.write(f"{server.url}\n")
            sys.stdout.flush()
            told("Ctrl-C ends it")
            server.run()
    except KeyboardInterrupt:
        told("ended")
    return 0
