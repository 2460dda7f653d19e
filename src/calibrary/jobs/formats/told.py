"""What the list of formats shows; of a name that was asked for also how each format counts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from calibrary.pages.wording import count, made_by
from calibrary.parsers.discovery import FormatListing, ListedFormat
from calibrary.view import Block, Code, Column, Section, Table, View

FORMATS: Final = (
    Column("name", lambda one: one.name),
    Column("what it is", lambda one: one.title, rank=2),
    Column("access", lambda one: one.access, rank=1),
    Column("usual names", lambda one: " ".join(one.suffixes), rank=3),
)


def told(found: FormatListing, name: str = "") -> View:
    """Describe the formats that have a name, or all of them."""
    blocks: list[Block] = [Table.of("Calibration files", found.formats, FORMATS)]
    for one in found.formats if name else ():
        is_alone = one.name == name or len(found.formats) == 1
        blocks.append(
            Section(title=f"{one.name} — {one.title}", blocks=tuple(_details(one, is_alone=is_alone)))
        )
    if not name:
        programs = ", ".join(sorted({program for one in found.formats for program in one.programs}))
        blocks.append(f"A program stands for the format that it reads, as in --to metashape: {programs}")
    return View(
        title="Calibration files that are read and written",
        lead=count(len(found.formats), "format"),
        sections=(Section(title="Formats", blocks=tuple(blocks)),),
        made_by=made_by(),
    )


def _details(one: ListedFormat, *, is_alone: bool) -> Iterator[Block]:
    yield one.reference
    if one.programs:
        yield f"--to {' or --to '.join(one.programs)} stands for it"
    yield from (fact.replace("`", "") for fact in ((one.refuses,) if one.refuses else one.facts))
    if one.refuses is None and is_alone:
        yield Code(text=one.words, label="An example in its own words")
