"""List the formats of calibration files, and how each counts.

>>> from calibrary.jobs.formats import formats
>>> [(one.name, one.access) for one in formats("kalibr").formats]
[('kalibr', 'read, write'), ('kalibr_results', 'read')]
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibrary.parsers.discovery import FormatListing
    from calibrary.parsers.discovery import ListedFormat as ListedFormat  # one row of the result

__all__ = ["formats"]


def formats(name: str = "") -> FormatListing:
    """List the formats of calibration files that are read and written, with their conventions.

    Args:
        name: part of a format's name or title, or a program that reads it.
    """
    from calibrary import parsers
    from calibrary.parsers.discovery import FormatListing, listing

    word = name.casefold()
    return FormatListing(
        formats=tuple(
            one
            for one in listing(parsers.formats()).formats
            if any(word in words.casefold() for words in (one.name, one.title, *one.programs))
        )
    )
