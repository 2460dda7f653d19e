"""HTML pages: a common style, no scripts by default, nothing loaded from the network.

A page consists of records; :func:`render_page` makes one HTML file from them. It escapes all text, limits its
length and spells out direction overrides, so text from files and tags can be passed unchanged. Each plot of
:mod:`calibrary.pages.plots` is a :class:`Figure`::

    from calibrary.pages import Badge, Column, KeyValues, Note, Page, Section, Table, Tone, render_page
    from calibrary.pages.plots import Axis, bars

    rms = Axis("rms reprojection error", "px")
    views = bars(values, labels=names, axis=rms, limit=0.5, caption="Views above the line were left out.")
    K = KeyValues((("fx", "3657.02 ± 0.40 px"), ("fy", "3650.44 ± 0.40 px")))
    table = Table(caption="Rules", columns=(Column("rule"), Column("found", numeric=True)), rows=(("tilt", "6°"),))
    note = Note(text="normals spread 6°", action="tilt the board by 20°", tone=Tone.BAD)
    parts = (Section(title="Verdict", blocks=(note, K, table)), Section(title="Views", blocks=(views,)))
    page = Page(title="Calibration of …", lead="…", sections=parts, made_by="…", badge=Badge("refused", Tone.BAD))
    html = render_page(page)
"""

from calibrary.pages.content import (
    Badge,
    Block,
    Bullets,
    Cell,
    Code,
    Column,
    Details,
    Figure,
    KeyValues,
    Link,
    Note,
    Page,
    Section,
    SideBySide,
    Table,
    Tone,
)
from calibrary.pages.render import check_page_place, render_page, write_page

__all__ = [
    "Badge",
    "Block",
    "Bullets",
    "Cell",
    "Code",
    "Column",
    "Details",
    "Figure",
    "KeyValues",
    "Link",
    "Note",
    "Page",
    "Section",
    "SideBySide",
    "Table",
    "Tone",
    "check_page_place",
    "render_page",
    "write_page",
]
