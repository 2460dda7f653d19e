"""``calibrary registry list``: list the cameras of the fleet, filtered and sorted by any field."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from calibrary.cli.commands import Parser, check_table_flag, print_json, write_table
from calibrary.cli.flags import call
from calibrary.cli.registry import OfRegistry, opened
from calibrary.cli.tables import Column, single_lines
from calibrary.cli.words import Words
from calibrary.jobs.fleet import Fleet
from calibrary.jobs.tables import entries

if TYPE_CHECKING:
    from calibrary.cli.console import Screen
    from calibrary.jobs.fleet import EntryListing

DESCRIPTION = (
    "List the cameras of the fleet, one line for each entry, selected and sorted by any of their fields."
)
CONDITIONS = """\
conditions, which all have to be true:
  field=VALUE     is one of VALUE,VALUE…; of tags, has one        field!=VALUE   is none of them
  field~TEXT      contains one of TEXT,TEXT…, in any case         field!~TEXT    contains none of them
  field<VALUE     also <=, >, >=: numbers, days, text             field, !field  is stated, is not stated
You may shorten a day: date=2026-05. Quote values with blanks or commas: notes~"spare lens".
Fields: id label unit tags notes status grade firmware make model serial lens focal size fx fy cx cy date tool operator
rms sigma from until distortion …, and every field that 'calibrary registry show KEY' prints: quality.views, k1.
"""
EXAMPLES = f"""\
examples:
  calibrary registry list
  calibrary registry list dji --status approved
  calibrary registry list --where 'grade=calibrated date<2025-01-01 label~P4R' --sort date,-fx
  calibrary registry list --where 'tags=survey !until' --columns label,fx,sigma,date
  calibrary registry list --at 2026-05-01 --json
  calibrary registry list --table fleet.csv      or fleet.parquet; units are in the columns' names

{CONDITIONS}"""


EXIT_UNREADABLE = 1


class _ListParser(Parser):
    """Parser that takes ``-fx`` in ``--sort -fx`` as a field, where argparse would see a flag."""

    # The base class has four overloads of this signature; Any covers all of them.
    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse the arguments after the command's name, as the base class does."""
        words = list(args or ())
        if "--sort" in words[:-1]:
            at = words.index("--sort")
            words[at : at + 2] = [f"--sort={words[at + 1]}"]
        return super().parse_known_args(words, namespace)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import errors, note, out

    check_table_flag(arguments)
    found = call(opened(arguments).listing, arguments)
    write_table(arguments.table, lambda: entries(found))
    if arguments.json:
        print_json(found.to_dict())
    elif found.chosen.rows:
        _show(out(arguments), note(arguments), found)
    elif not found.unreadable:
        note(arguments).say(
            "no entry fits; 'calibrary registry add FILE' puts one in, and 'calibrary registry status' shows what "
            "waits on branches"
        )
    for text in found.notes:
        errors().say(("note", "yellow"), f" {text}")
    for error in found.unreadable:
        errors().say(("not listed", "red"), f" {error}")
    return EXIT_UNREADABLE if found.unreadable else 0


COLUMNS = (
    Column(name="label"),
    Column(name="entry"),
    Column(name="status", rank=1),
    Column(name="fx px", rank=2, right=True),
    Column(name="grade", rank=3),
    Column(name="made on", rank=4),
    Column(name="tags", rank=5),
    Column(name="distortion", rank=6),
    Column(name="cx px", rank=7, right=True),
    Column(name="cy px", rank=7, right=True),
)
STYLES = {"approved": "green", "draft": "yellow", "retired": "dim"}


def _show(screen: Screen, remarks: Screen, found: EntryListing) -> None:
    rows: list[tuple[Words, ...]]
    if found.columns is not None:
        columns = tuple(Column(name=field.rpartition(".")[2]) for field in found.columns)
        rows = [tuple(_text(row.get(field)) for field in found.columns) for row in found.chosen.rows]
    else:
        columns = COLUMNS
        rows = [*_rows(found)]
    lines, left_out = single_lines(columns, rows, screen.width, styled=screen.is_terminal)
    screen.show(lines)
    if left_out and remarks.is_terminal:
        remarks.say((f"left out in this width: {', '.join(left_out)}; --columns chooses others", "dim"))


def _rows(found: EntryListing) -> Iterator[tuple[Words, ...]]:

    for row, short in zip(found.chosen.rows, found.short_ids(), strict=True):
        status, tags = str(row["status"]), row.get("tags")
        state = "proposed" if row["proposed"] else status
        state += ", proposal pending" if "proposal" in row else ""
        yield (
            str(row.get("label", "")),
            short,
            (state, STYLES[status]),
            f"{row['intrinsics.fx']:.2f}",
            str(row["grade"]),
            str(row.get("provenance.date", ""))[:10],
            " ".join(tags) if isinstance(tags, tuple) else "",
            str(row.get("distortion.model", "unknown")),
            f"{row['intrinsics.cx']:.2f}",
            f"{row['intrinsics.cy']:.2f}",
        )


def _text(value: object) -> str:
    if isinstance(value, tuple):
        return ", ".join(map(str, value))
    return f"{value:.10g}" if isinstance(value, float) else "" if value is None else str(value)


COMMAND = OfRegistry(
    Fleet.listing,
    DESCRIPTION,
    EXAMPLES,
    run=run,
    positional={"words": "WORD"},
    spelled={"statuses": "--status", "grades": "--grade"},
    kind=_ListParser,
    at=True,
    table=("the entries", entries),
)
