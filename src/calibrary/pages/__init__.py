"""HTML pages: a common style, no scripts by default, nothing loaded from the network.

A page shows a :class:`~calibrary.view.View`; :func:`render_page` makes one HTML file from it. Each plot of
:mod:`calibrary.pages.plots` is a :class:`~calibrary.view.Figure`::

    from calibrary.pages import render_page
    from calibrary.pages.plots import Axis, bars
    from calibrary.view import Badge, Column, KeyValues, Note, Section, Table, Tone, View

    rms = Axis("rms reprojection error", "px")
    views = bars(values, labels=names, axis=rms, limit=0.5, caption="Views above the line were left out.")
    K = KeyValues((("fx", "3657.02 ± 0.40 px"), ("fy", "3650.44 ± 0.40 px")))
    table = Table(caption="Rules", columns=(Column("rule"), Column("found", numeric=True)), rows=(("tilt", "6°"),))
    note = Note(text="normals spread 6°", action="tilt the board by 20°", tone=Tone.BAD)
    parts = (Section(title="Verdict", blocks=(note, K, table)), Section(title="Views", blocks=(views,)))
    page = View(title="Calibration of …", lead="…", sections=parts, made_by="…", badge=Badge("refused", Tone.BAD))
    html = render_page(page)
"""

from __future__ import annotations

import base64
import hashlib
from functools import cache
from importlib import resources
from pathlib import Path

from msgspec import Struct

from calibrary.atomic import check_folder, write_files
from calibrary.errors import InputError
from calibrary.extras import PAGES, require
from calibrary.pages.palette import style_rules
from calibrary.view import Link, View

__all__ = ["Frame", "check_page_place", "render_page", "served_policy", "write_page"]


class Frame(Struct, frozen=True, kw_only=True):
    """What a server puts around each of its pages.

    Attributes:
        ways: the pages that every page leads to.
        script: address of the script of all pages.
        token: proof in each form that it is from a page of this server.
    """

    ways: tuple[Link, ...]
    script: str
    token: str

    def way_of(self, address: str) -> Link | None:
        """The way that leads to an address, or to a page above it; None if no one does."""
        above = [way for way in self.ways if f"{address}/".startswith(f"{way.target.rstrip('/')}/")]
        found = max(above, key=lambda way: len(way.target), default=None)
        return found if found is None or found.target != "/" or address == "/" else None


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


def write_page(path: Path, page: View) -> None:
    """Render a page and write it atomically.

    Raises:
        InputError: the file cannot be written.
    """
    write_files({path: render_page(page).encode()})


def render_page(page: View, *, script: str | None = None, frame: Frame | None = None, at: str = "") -> str:
    """Render a page as HTML that loads nothing from the network and runs no script except ``script``.

    As a second barrier, the Content-Security-Policy in its head allows only this style sheet, this script and
    embedded pictures.

    Args:
        page: the content.
        script: JavaScript of calibrary, never from input; the page must also work without it.
        frame: what a server puts around it; the policy is then in the server's headers, by :func:`served_policy`.
        at: the page's address there.

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
    return fill(page, security=security, style=style, script=script, frame=frame, at=at)


def served_policy() -> str:
    """The Content-Security-Policy of a page with a frame: this style sheet, and of its server scripts and answers."""
    return (
        f"default-src 'none'; style-src {_digest(_style())}; script-src 'self'; connect-src 'self'; "
        "img-src 'self' data:; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
    )


def _digest(text: str) -> str:
    """The hash by which a Content-Security-Policy allows this text."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


@cache
def _style() -> str:
    own = resources.files("calibrary.pages").joinpath("style.css").read_text(encoding="utf-8")
    return style_rules() + "\n" + own
