"""Addresses of the pages and files of a site, and relative links between them."""

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
    """Location of an entry's page and files relative to the site's root.

    Attributes:
        stem: common part of its addresses.
        is_published: whether the published files for programs are next to the site and contain the entry.
    """

    stem: str
    is_published: bool = False

    @classmethod
    def of(cls, path: str, *, proper: bool, published: bool = False) -> Place:
        """The location for the entry at a path.

        Args:
            path: in the registry.
            proper: whether the path is the one that follows from its camera; any other path could point
                outside the site or to another entry's page, and is replaced by a number.
            published: whether the published files for programs are next to the site.
        """
        stem = path.removeprefix(ROOT).removesuffix(SUFFIX)
        if proper and _SAFE.fullmatch(stem) and ".." not in stem:
            return cls(stem=stem, is_published=published)
        return cls(stem=f"elsewhere/{hashlib.sha256(path.encode('utf-8', 'surrogatepass')).hexdigest()[:16]}")

    @property
    def page(self) -> str:
        """Address of its page."""
        return f"cameras/{self.stem}.html"

    def step(self, name: str) -> str:
        """Address of the page of one change."""
        return f"changes/{self.stem}/{name}.html"

    def file(self, name: str) -> str:
        """Address of a file to download."""
        return f"files/{self.stem}/{name}"


def way(start: str, end: str) -> str:
    """Relative link from one page to another page or file."""
    return quote(posixpath.relpath(end, posixpath.dirname(start)), safe="/+~")
