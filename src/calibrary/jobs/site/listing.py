"""The list of all cameras: a plain table, which a small script lets people search, filter and sort."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources

from calibrary.jobs.site.addresses import INDEX, way
from calibrary.jobs.site.words import STATUSES
from calibrary.jobs.site.work import Card
from calibrary.pages import Badge, Cell, Column, Link, Note, Page, Section, Table, Tone, render_page
from calibrary.policy import Policy
from calibrary.registry.entry import Status

__all__ = ["listing"]

COLUMNS = (
    Column("camera"),
    Column("label"),
    Column("status"),
    Column("last change"),
    Column("grade"),
    Column("fx (px)", numeric=True),
    Column("σ of fx", numeric=True),
    Column("uncertainty"),
    Column("lens"),
    Column("firmware"),
    Column("made on", numeric=True),
    Column("revisions", numeric=True),
    Column("make"),
    Column("model"),
    Column("tags"),
)


def listing(cards: Sequence[Card], policy: Policy, made_by: str) -> str:
    """The page as HTML.

    Args:
        cards: in the order of the list.
        policy: that the registry is held to.
        made_by: for the foot.
    """
    readable = [card for card in cards if card.page is not None]
    broken = [card for card in cards if card.page is None]
    usable = sum(card.status is not None and card.status.is_usable for card in readable)
    drafts = sum(card.status is Status.DRAFT for card in readable)
    parts = [f"{_count(len(readable), 'camera')}, {usable} of them in use"]
    parts += [f"{_count(drafts, 'draft')} to look at"] if drafts else []
    parts += [f"{len(broken)} that cannot be read"] if broken else []
    sections = []
    if broken:
        sections.append(
            Section(
                title="What cannot be read",
                blocks=(
                    Note(
                        text="These entries are no entries; nothing is shown of them.",
                        action="calibrary registry check says what to put right",
                        tone=Tone.BAD,
                    ),
                    Table(
                        caption="Entries that cannot be read",
                        columns=(Column("entry"), Column("why")),
                        rows=tuple((card.id, card.problem or "") for card in broken),
                    ),
                ),
            )
        )
    if readable:
        table = Table(
            caption="Every camera of the registry; its name leads to its page",
            columns=COLUMNS,
            rows=tuple(
                _row(card, card.page, card.status)
                for card in cards
                if card.page is not None and card.status is not None
            ),
        )
        sections.insert(0, Section(title="Cameras", anchor="cameras", blocks=(table,)))
    else:
        empty = Note(
            text="The registry contains no camera yet.", action="calibrary registry add FILE puts one in"
        )
        sections.insert(0, Section(title="Cameras", anchor="cameras", blocks=(empty,)))
    page = Page(
        title="Camera registry",
        lead=f"{'; '.join(parts)}. Held to the {policy.name} policy.",
        sections=tuple(sections),
        contents=False,
        made_by=made_by,
    )
    return render_page(page, script=_script() if readable else None)


def _row(card: Card, page: str, status: Status) -> tuple[Cell, ...]:
    return (
        Link(card.id, way(INDEX, page)),
        card.label or "–",
        Badge(status.value, STATUSES[status]),
        Badge(*card.verdict) if card.verdict is not None else "–",
        card.grade,
        f"{card.fx:.2f}" if card.fx is not None else "–",
        f"{card.std_fx:.2g}" if card.std_fx is not None else "–",
        card.uncertainty,
        card.lens,
        card.firmware or "–",
        card.made_on or "–",
        str(card.revisions),
        card.make,
        card.model,
        card.tags or "–",
    )


def _script() -> str:
    return resources.files("calibrary.jobs.site").joinpath("list.js").read_text(encoding="utf-8")


def _count(count: int, what: str) -> str:
    return f"{count} {what}" if count == 1 else f"{count} {what}s"
