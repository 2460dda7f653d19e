"""HTML tables of results for notebooks; all text is escaped.

They set no colours and run no scripts, so that they are readable in light and dark themes.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

MOST_ROWS = 20


def html_table(title: str, rows: Sequence[tuple[str, str]]) -> str:
    """Table of names and values; rows without a value are omitted."""
    body = "".join(
        f'<tr><th style="text-align:left">{escape(name)}</th><td style="text-align:left">{escape(value)}</td></tr>'
        for name, value in rows
        if value
    )
    return f"<table><caption>{escape(title)}</caption><tbody>{body}</tbody></table>"


def html_rows(
    columns: Sequence[str], rows: Sequence[Sequence[str]], *, title: str = "", many: int | None = None
) -> str:
    """Table that shows the first rows only, if there are many.

    Args:
        columns: column names.
        rows: at least the first twenty rows.
        title: title above the table.
        many: total number of rows, if ``rows`` does not contain all.
    """
    many = many if many is not None else len(rows)
    more = f"the first {MOST_ROWS} of {many}" if many > MOST_ROWS else ""
    caption = "; ".join(part for part in (title, more) if part)
    head = "".join(f'<th style="text-align:left">{escape(name)}</th>' for name in columns)
    lines = (
        "".join(f'<td style="text-align:left">{escape(cell)}</td>' for cell in row)
        for row in rows[:MOST_ROWS]
    )
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    above = f"<caption>{escape(caption)}</caption>" if caption else ""
    return f"<table>{above}<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
