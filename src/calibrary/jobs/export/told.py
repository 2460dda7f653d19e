"""What an export shows: how exactly the format represents each entry."""

from __future__ import annotations

from calibrary.jobs.export.run import ExportReport
from calibrary.pages.wording import count, made_by
from calibrary.view import Badge, Column, Section, Table, Tone, View

NOT_EXACT = (Column("entry", lambda row: row.entry), Column("verdict", str))
LEFT_OUT = (Column("left out", lambda row: row.entry), Column("why", lambda row: row.reason))


def told(done: ExportReport, place: str) -> View:
    """Describe an export into a file or folder."""
    changed = [one for one in done.written if one.verdict.value != "exact"]
    said = (f"it has no place for: {', '.join(done.dropped)}",) if done.dropped else ()
    tables = (
        *((Table.of("Entries that it represents less than exactly", changed, NOT_EXACT),) if changed else ()),
        *((Table.of("Entries that it cannot represent", done.left_out, LEFT_OUT),) if done.left_out else ()),
    )
    number = len(done.written)
    return View(
        title=f"Export as {done.format}",
        badge=Badge("exact", Tone.GOOD)
        if not (changed or done.left_out)
        else Badge("not exact", Tone.CAUTION),
        lead=f"{place}: {count(number, 'entry', 'entries')} as {done.format}, {number - len(changed)} exact (0.000 px)",
        sections=(Section(title="Entries", blocks=(*tables, *said)),),
        made_by=made_by(),
    )
