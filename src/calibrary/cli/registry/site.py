"""``calibrary registry site``: write the registry as web pages to a folder."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from calibrary.cli.registry import OfRegistry, entries
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


def _said(site: Site, _: argparse.Namespace) -> list[str]:
    pages = sum(name.endswith(".html") for card in site.cards for name in card.files) + 1
    broken = [f"not shown {card.problem or card.id}" for card in site.cards if card.page is None]
    return [*broken, f"{entries(len(site.cards))} in {pages} pages; open {site.root / 'index.html'}"]


COMMAND = OfRegistry(
    Fleet.write_site,
    DESCRIPTION,
    EXAMPLES,
    positional={"out": "OUT"},
    doing="making",
    said=_said,
    exits={"is_whole": 1},
    json=False,
)
