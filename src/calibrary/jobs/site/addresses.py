"""Where each page and file of a site lies, and the relative ways between them."""

from __future__ import annotations

import hashlib
import posixpath
import re
from urllib.parse import quote

from msgspec import Struct

from calibrary.registry.paths import ROOT, SUFFIX

__all__ = ["INDEX", "Place", "way"]

INDEX = "index.html"

_SAFE = re.compile(r"[a-z0-9_][a-z0-9._~+-]*(?:/[a-z0-9_][a-z0-9._~+-]*){2,6}")


class Place(Struct, frozen=True, kw_only=True):
    """Where an entry's page and all that belongs to it lie below the site's root.

    Attributes:
        stem: of its addresses.
        is_published: whether the files that programs read are beside the site and have the entry.
    """

    stem: str
    is_published: bool = False

    @classmethod
    def of(cls, path: str, *, proper: bool, published: bool = False) -> Place:
        """The place of the entry at a path.

        Args:
            path: in the registry.
            proper: whether it is where its camera belongs; any other path may be what its author wished to
                write outside the site, or over another's page, and gets a number instead.
            published: whether the files that programs read are beside the site.
        """
        stem = path.removeprefix(ROOT).removesuffix(SUFFIX)
        if proper and _SAFE.fullmatch(stem) and ".." not in stem:
            return cls(stem=stem, is_published=published)
        return cls(stem=f"elsewhere/{hashlib.sha256(path.encode('utf-8', 'surrogatepass')).hexdigest()[:16]}")

    @property
    def page(self) -> str:
        """Of its page."""
        return f"cameras/{self.stem}.html"

    def step(self, name: str) -> str:
        """Of the page of one change."""
        return f"changes/{self.stem}/{name}.html"

    def file(self, name: str) -> str:
        """Of a file to download."""
        return f"files/{self.stem}/{name}"


def way(start: str, end: str) -> str:
    """The relative address of one page or file as another links to it."""
    return quote(posixpath.relpath(end, posixpath.dirname(start)), safe="/+~")
