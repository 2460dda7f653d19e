"""The list of all cameras: a plain table, with a small script for searching, filtering and sorting."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import resources

from msgspec import Struct

from calibrary.jobs.site.addresses import INDEX, way
from calibrary.jobs.site.history import STATUSES
from calibrary.pages import Badge, Cell, Column, Link, Note, Page, Section, Table, Tone, render_page
from calibrary.pages.wording import count
from calibrary.policy import Policy
from calibrary.registry.entry import Status

__all__ = ["Card", "listing"]

# The style sheet shows the first nine columns, on a phone three; the others serve for searching and filtering.
COLUMNS = (
    Column("camera"),
    Column("status"),
    Column("fx (px)", numeric=True),
    Column("σ of fx (px)", numeric=True),
    Column("label"),
    Column("last change"),
    Column("grade"),
    Column("firmware"),
    Column("calibrated on"),
    Column("lens"),
    Column("uncertainty"),
    Column("revisions", numeric=True),
    Column("make"),
    Column("model"),
    Column("tags"),
)


class Card(Struct, frozen=True, kw_only=True):
    """Row of the list for an entry.

    Attributes:
        path: of its file in the registry.
        id: its longest KEY.
        page: address of its page; None if the entry cannot be read.
        problem: why it cannot be read.
        make, model, grade, lens, firmware, made_on, label, tags: from the entry.
        status: None if the entry cannot be read.
        fx, std_fx: px.
        uncertainty: kind of uncertainty that it states.
        revisions: number of revisions.
        verdict: of the newest change of the calibration, with its tone.
        files: addresses of all written files.
    """

    path: str
    id: str
    page: str | None = None
    problem: str | None = None
    make: str = ""
    model: str = ""
    status: Status | None = None
    grade: str = ""
    lens: str = ""
    firmware: str = ""
    made_on: str = ""
    label: str = ""
    tags: str = ""
    fx: float | None = None
    std_fx: float | None = None
    uncertainty: str = ""
    revisions: int = 0
    verdict: tuple[str, Tone] | None = None
    files: tuple[str, ...] = ()


def listing(cards: Sequence[Card], policy: Policy, made_by: str) -> str:
    """Make the page as HTML.

    Args:
        cards: in the order of the list.
        policy: of the registry.
        made_by: for the footer.
    """
    readable = [card for card in cards if card.page is not None]
    broken = [card for card in cards if card.page is None]
    usable = sum(card.status is not None and card.status.is_usable for card in readable)
    drafts = sum(card.status is Status.DRAFT for card in readable)
    parts = [f"{count(len(readable), 'camera')}, {usable} of them in use"]
    parts += [f"{count(drafts, 'draft')} to approve"] if drafts else []
    parts += [f"{len(broken)} that cannot be read"] if broken else []
    sections = []
    if broken:
        sections.append(
            Section(
                title="What cannot be read",
                blocks=(
                    Note(
                        text="These files are not entries; nothing is shown of them.",
                        action="calibrary registry check names what to correct",
                        tone=Tone.BAD,
                    ),
                    Table(
                        caption="Entries that cannot be read",
                        columns=(Column("entry"), Column("reason")),
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
        lead=f"{'; '.join(parts)}. Checked against the {policy.name} policy.",
        sections=tuple(sections),
        contents=False,
        made_by=made_by,
    )
    return render_page(page, script=_script() if readable else None)


def _row(card: Card, page: str, status: Status) -> tuple[Cell, ...]:
    return (
        Link(card.id, way(INDEX, page)),
        Badge(status.value, STATUSES[status]),
        f"{card.fx:.2f}" if card.fx is not None else "–",
        f"{card.std_fx:.2g}" if card.std_fx is not None else "–",
        card.label or "–",
        Badge(*card.verdict) if card.verdict is not None else "–",
        card.grade,
        card.firmware or "–",
        card.made_on or "–",
        card.lens,
        card.uncertainty,
        str(card.revisions),
        card.make,
        card.model,
        card.tags or "–",
    )


def _script() -> str:
    return resources.files("calibrary.jobs.site").joinpath("list.js").read_text(encoding="utf-8")
