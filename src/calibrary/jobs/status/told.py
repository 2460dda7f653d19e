"""What the status of a registry shows: what waits, most urgent first, for whom, and the step that settles it."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from datetime import date
from functools import partial
from itertools import groupby
from typing import Final

from msgspec import Struct

from calibrary.errors import first_of
from calibrary.jobs.status.run import Matter, RegistryStatus
from calibrary.pages.wording import count, in_registry, made_by
from calibrary.view import Badge, Cell, Column, Link, Section, Table, Tone, View

MOST_ALIKE: Final = 5
"""Matters of one kind and of the same people that are shown one by one."""


class Row(Struct, frozen=True, kw_only=True):
    """A row: a matter, or many of one kind that wait for the same people."""

    kind: Badge
    what: Cell
    whom: str
    since: str
    until: str
    text: str
    next: str


MATTERS: Final = (
    Column("matter", lambda row: row.kind),
    Column("what", lambda row: row.what),
    Column("for", lambda row: row.whom, rank=1),
    Column("since", lambda row: row.since, rank=2),
    Column("until", lambda row: row.until, rank=3),
    Column("text", lambda row: row.text, below=""),
    Column("next", lambda row: row.next, below="→ "),
)


def told(
    found: RegistryStatus, *, registry: str = "", page_of: Callable[[Matter], str | None] | None = None
) -> View:
    """Describe what waits.

    Args:
        found: the result.
        registry: the flag that selects the registry, for the commands of the next steps.
        page_of: the page of a matter, where it has one.
    """
    mine = sum(one.yours for one in found.matters)
    who, others = found.person or "you", len(found.matters) - mine
    said = f"{mine} for {who}" if mine else f"nothing waits for {who}"
    more = f", {others} for others or later" if others else ""
    table = Table.of(
        "What waits, most urgent first", _rows(found, partial(in_registry, registry), page_of), MATTERS
    )
    return View(
        title="What waits",
        badge=Badge("waiting", Tone.CAUTION) if mine else Badge("nothing waits", Tone.GOOD),
        lead=f"{said}{more}; {count(found.entries, 'entry', 'entries')}",
        sections=(Section(title="Matters", blocks=(table,)),) if found.matters else (),
        contents=False,
        made_by=made_by(),
    )


def _rows(
    found: RegistryStatus, settles: Callable[[str], str], page_of: Callable[[Matter], str | None] | None
) -> Iterator[Row]:
    for _, group in groupby(found.matters, key=lambda one: (one.kind, one.yours, one.waits_for)):
        alike = [*group]
        if len(alike) > MOST_ALIKE:
            yield _many(alike, found.day, settles)
            continue
        for one in alike:
            target = page_of(one) if page_of is not None else None
            yield Row(
                kind=_badge(one, found.day),
                what=Link(one.what, target) if target is not None else one.what,
                whom=_whom(one),
                since=_age(one.since, found.day),
                until=str(one.due or ""),
                text=one.text,
                next=settles(one.next) if one.next is not None else "",
            )


def _many(alike: Sequence[Matter], today: date, settles: Callable[[str], str]) -> Row:
    steps = {one.next for one in alike}
    step = steps.pop() if len(steps) == 1 else "calibrary registry status --json"
    oldest = min((one.since for one in alike if one.since is not None), default=None)
    return Row(
        kind=_badge(alike[0], today),
        what=f"{len(alike)} ×",
        whom=_whom(alike[0]),
        since=_age(oldest, today),
        until="",
        text=first_of([one.what for one in alike]),
        next=settles(step) if step is not None else "",
    )


def _badge(one: Matter, today: date) -> Badge:
    is_late = one.due is not None and one.due <= today
    return Badge(one.kind.value, Tone.BAD if is_late and not one.yours else Tone.CAUTION)


def _whom(one: Matter) -> str:
    return "you" if one.yours else ", ".join(one.waits_for)


def _age(since: date | None, today: date) -> str:
    if since is None:
        return ""
    days = (today - since).days
    return "today" if days <= 0 else count(days, "day")
