"""Placing of a site: built next to its folder, then moved there as a whole, never over other files.

With it the addresses of its pages and files, and relative links between them.
"""

from __future__ import annotations

import hashlib
import posixpath
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import quote

from msgspec import Struct

from calibrary.atomic import check_folder
from calibrary.errors import InputError
from calibrary.registry.paths import ROOT, SUFFIX
from calibrary.registry.places import is_published
from calibrary.registry.published.write import OWN_NAMES, SITE_MARKER

INDEX = "index.html"

_SAFE = re.compile(r"[a-z0-9_][a-z0-9._~+-]*(?:/[a-z0-9_][a-z0-9._~+-]*){2,6}")


class Place(Struct, frozen=True, kw_only=True):
    """Location of an entry's page and files relative to the site's root.

    Attributes:
        stem: common part of its addresses.
    """

    stem: str

    @classmethod
    def of(cls, path: str, *, proper: bool) -> Place:
        """The location for the entry at a path.

        Args:
            path: in the registry.
            proper: whether the path is the one that follows from its camera; any other path could point
                outside the site or to another entry's page, and is replaced by a number.
        """
        stem = path.removeprefix(ROOT).removesuffix(SUFFIX)
        if proper and _SAFE.fullmatch(stem) and ".." not in stem:
            return cls(stem=stem)
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


MARKER = SITE_MARKER
"""File that marks a folder as a site made by calibrary."""

OURS = frozenset({MARKER, INDEX, "cameras", "changes", "files"})


def check_out(out: Path) -> Path:
    """Check that a site may be put into a folder; returns the folder with links resolved.

    Raises:
        InputError: the folder contains something else, or its parent is not writable.
    """
    place = Path(out).resolve()
    check_folder(place)
    if not place.exists():
        return place
    if not place.is_dir():
        raise InputError("is a file, expected a folder for the site", source=str(out))
    try:
        found = {item.name for item in place.iterdir()}
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", source=str(out)) from None
    if found and MARKER not in found and not is_published(str(place)):
        raise InputError(
            f"is not a site made by calibrary (it has no {MARKER}) and is not empty; name another folder",
            source=str(out),
        )
    if foreign := sorted(found - OURS - OWN_NAMES):
        raise InputError(
            f"contains {', '.join(foreign[:5])} beside the site, which replacing it would remove; move that elsewhere",
            source=str(out),
        )
    return place


@contextmanager
def replaced(out: Path) -> Iterator[Path]:
    """Context manager that gives a new folder, which replaces ``out`` on success and is removed on failure.

    A reader sees the old or the new site; for the moment between two renames, none.

    Raises:
        InputError: as for :func:`check_out`, or the folder cannot be written.
    """
    place = check_out(out)
    try:
        place.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=f".{place.name}.", dir=place.parent))
    except OSError as error:
        raise InputError(f"cannot be written: {error.strerror or error}", source=str(place.parent)) from None
    building, earlier = scratch / "new", scratch / "earlier"
    try:
        building.mkdir()
        yield building
        # Another process may have written there in the meantime.
        check_out(place)
        _swap(building, place, earlier)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _swap(building: Path, place: Path, earlier: Path) -> None:
    if is_published(str(place)):
        _swap_members(building, place, earlier)
        return
    try:
        if place.exists():
            place.rename(earlier)
        try:
            building.rename(place)
        except OSError:
            if earlier.exists():
                earlier.rename(place)
            raise
    except OSError as error:
        raise InputError(
            f"cannot be replaced: {error.strerror or error}; it is as it was", source=str(place)
        ) from None


def _swap_members(building: Path, place: Path, earlier: Path) -> None:
    """Replace the parts of a site; published files next to them stay unchanged.

    Raises:
        InputError: a part cannot be replaced.
    """
    try:
        earlier.mkdir()
        for name in sorted(OURS):
            if (place / name).exists():
                (place / name).rename(earlier / name)
            if (building / name).exists():
                (building / name).rename(place / name)
    except OSError as error:
        raise InputError(
            f"cannot be replaced: {error.strerror or error}; write it again", source=str(place)
        ) from None
