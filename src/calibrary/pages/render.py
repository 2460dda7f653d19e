"""Rendering of a page's records to one self-contained HTML file."""

from __future__ import annotations

import base64
import hashlib
from functools import cache
from importlib import resources
from pathlib import Path

from calibrary.atomic import check_folder, write_files
from calibrary.errors import InputError
from calibrary.extras import PAGES, require
from calibrary.pages.content import Page
from calibrary.pages.palette import style_rules

__all__ = ["check_page_place", "render_page", "write_page"]


def check_page_place(html: str | Path | None) -> Path | None:
    """Check before any work that a page can be written; returns its path, and None where no page is wanted.

    Raises:
        InputError: the name is not an .html, or its folder is not writable.
        MissingExtraError: the libraries that draw pages are not installed.
    """
    if html is None:
        return None
    require(PAGES, "a page")
    path = Path(html)
    if path.suffix.lower() not in {".html", ".htm"}:
        raise InputError("expected a name that ends in .html", source=str(path), place="--html")
    check_folder(path, place="--html")
    return path


def write_page(path: Path, page: Page) -> None:
    """Render a page and write it atomically.

    Raises:
        InputError: the file cannot be written.
    """
    write_files({path: render_page(page).encode()})


def render_page(page: Page, *, script: str | None = None) -> str:
    """Render a page as HTML that loads nothing from the network and runs no script except ``script``.

    As a second barrier, the Content-Security-Policy in its head allows only this style sheet, this script and
    embedded pictures.

    Args:
        page: the content.
        script: JavaScript of calibrary, never from input; the page must also work without it.

    Raises:
        InputError: a figure's drawing is not an SVG.
        MissingExtraError: the libraries that render pages are not installed.
    """
    require(PAGES, "a page")
    from calibrary.pages.template import fill  # noqa: PLC0415  Jinja2, which a plain install leaves out

    style = _style()
    scripts = f" script-src {_digest(script)};" if script is not None else ""
    security = (
        f"default-src 'none'; style-src {_digest(style)};{scripts} img-src data:; base-uri 'none'; "
        "form-action 'none'"
    )
    return fill(page, security=security, style=style, script=script)


def _digest(text: str) -> str:
    """The hash by which a Content-Security-Policy allows this text."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


@cache
def _style() -> str:
    own = resources.files("calibrary.pages").joinpath("style.css").read_text(encoding="utf-8")
    return style_rules() + "\n" + own
