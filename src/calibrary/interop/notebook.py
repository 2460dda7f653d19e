"""A record as a notebook shows it: a small HTML table, everything in it escaped."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

__all__ = ["html_table"]


def html_table(title: str, rows: Sequence[tuple[str, str]]) -> str:
    """A table of names and values; rows without a value are left out."""
    body = "".join(
        f'<tr><th style="text-align:left">{escape(name)}</th><td style="text-align:left">{escape(value)}</td></tr>'
        for name, value in rows
        if value
    )
    return f"<table><caption>{escape(title)}</caption><tbody>{body}</tbody></table>"
