"""Placing of a site: built next to its folder, then moved there as a whole, never over other files."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from calibrary.atomic import check_folder
from calibrary.errors import InputError
from calibrary.jobs.site.addresses import INDEX
from calibrary.registry.places import is_published
from calibrary.registry.published.output import OWN_NAMES, SITE_MARKER

__all__ = ["MARKER", "check_out", "replaced"]

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
