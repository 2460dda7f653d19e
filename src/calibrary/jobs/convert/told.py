"""What a conversion shows: of each file where it was written, and how exactly it represents the calibration."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from calibrary.calibration import Grade
from calibrary.jobs.convert.run import ConvertedFile, ConvertReport
from calibrary.pages.wording import count, made_by
from calibrary.view import Badge, Block, Column, Section, Table, Tone, View

FILES: Final = (
    Column("source", lambda one: one.source + (f", camera {one.camera}" if one.camera is not None else "")),
    Column("written", lambda one: one.output or "—"),
    Column(
        "verdict",
        lambda one: "; not measured: a ".join([str(one), *([", ".join(one.priors)] * bool(one.priors))]),
    ),
)


def told(done: ConvertReport, place: str) -> View:
    """Describe a conversion into a file or folder."""
    written = sum(one.output is not None for one in done.files)
    is_one = len(done.files) == 1 and done.is_good
    table = Table.of("Each calibration, and what the format represents of it", done.files, FILES)
    return View(
        title=f"Conversion of {count(len(done.files), 'file')}",
        badge=Badge("written", Tone.GOOD) if done.is_good else Badge("not all written", Tone.BAD),
        lead=str(done.files[0]) if is_one else f"wrote {written} of {len(done.files)} into {place}",
        sections=(Section(title="Files", blocks=tuple(_one(done.files[0], place)) if is_one else (table,)),),
        made_by=made_by(),
    )


def _one(done: ConvertedFile, place: str) -> Iterator[Block]:
    if done.into:
        cameras = f"camera{'s' if done.into[1:] else ''} {', '.join(map(str, done.into))}"
        yield f"wrote {cameras} of {place} ({done.format}); its images keep their cameras"
        yield f"to put back what was there: sqlite3 {place} < {Path(place).parent / str(done.backup)}"
    else:
        yield f"wrote {place} ({done.format})"
    if done.priors:
        yield f"not measured, to start an adjustment with: its K is a {_grades(done.priors)}"


def _grades(priors: tuple[Grade, ...]) -> str:
    return ", ".join(f"{grade.value} ({grade.meaning})" for grade in priors)
