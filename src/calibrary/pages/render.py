"""From a page's records to one HTML file that needs nothing beside it."""

from __future__ import annotations

import base64
import hashlib
from functools import cache
from importlib import resources

from calibrary.extras import PAGES, require
from calibrary.pages.content import Page
from calibrary.pages.palette import style_rules

__all__ = ["render_page"]


def render_page(page: Page, *, script: str | None = None) -> str:
    """The page as HTML: no network, no script but the one given, and nothing in it that is not from ``page``.

    The policy in its head forbids the rest even where something had slipped through: only this very style sheet,
    this very script and pictures inside the page are allowed.

    Args:
        page: what it says.
        script: ours, never from input; the page has to serve without it.

    Raises:
        InputError: a figure's drawing is not an SVG.
        MissingExtraError: what fills and draws pages is not installed.
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
    """How a Content-Security-Policy names this very text."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


@cache
def _style() -> str:
    own = resources.files("calibrary.pages").joinpath("style.css").read_text(encoding="utf-8")
    return style_rules() + "\n" + own
