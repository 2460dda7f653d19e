"""What a result shows, in a notebook: the answer's tables and sentences, in the notebook's own colours."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from html import escape

from calibrary.interop.notebook import html_rows, html_table
from calibrary.pages.wording import visible
from calibrary.view import Block, Bullets, KeyValues, Note, Section, SideBySide, Table, text_of, view_of


def in_notebook(result: object) -> str:
    """The answer of a result as HTML: what a terminal shows."""
    view = view_of(result)
    parts = [part for one in view.sections if one.printed for part in _blocks(one.blocks)]
    return "".join((f"<p><b>{_text(view.lead)}</b></p>", *parts))


def _blocks(blocks: Iterable[Block]) -> Iterator[str]:
    for block in blocks:
        match block:
            case Table():
                rows = [[visible(text_of(cell)) for cell in row] for row in block.rows]
                yield html_rows([one.title for one in block.columns], rows, title=block.caption)
            case KeyValues():
                yield html_table("", [(name, visible(text_of(cell))) for name, cell in block.items])
            case Bullets():
                items = "".join(f"<li>{_text(text_of(item))}</li>" for item in block.items)
                yield f"<ul>{items}</ul>"
            case Note():
                action = f"<br>→ {_text(block.action)}" if block.action is not None else ""
                yield f"<p>{_text(block.text)}{action}</p>"
            case SideBySide() | Section():
                yield from _blocks(block.blocks)
            case str():
                yield f"<p>{_text(block)}</p>"
            case _:
                pass


def _text(text: str) -> str:
    return escape(visible(text))
