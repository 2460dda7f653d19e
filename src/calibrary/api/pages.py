"""Writing of HTML pages."""

from __future__ import annotations

from pathlib import Path

from calibrary.atomic import write_files
from calibrary.pages import check_page_place

__all__ = ["check_page_place", "write_page"]


def write_page(path: Path, html: str) -> None:
    """Write a page atomically.

    Raises:
        InputError: the file cannot be written.
    """
    write_files({path: html.encode()})
