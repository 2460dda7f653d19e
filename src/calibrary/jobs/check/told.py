"""What a check shows: of each file whether its K is right for each camera, and what the pixels say."""

from __future__ import annotations

from typing import Final

from calibrary.jobs.check.run import CheckReport
from calibrary.jobs.extract.calibration_files import Rightness
from calibrary.pages.wording import count, made_by
from calibrary.sfm.pixel_check import PixelVerdict
from calibrary.view import Badge, Block, Bullets, Column, Section, Table, Tone, View

VERDICTS: Final = {Rightness.RIGHT: Tone.GOOD, Rightness.OFF: Tone.BAD, Rightness.UNKNOWN: Tone.CAUTION}
PIXELS: Final = {
    PixelVerdict.AGREES: Tone.GOOD,
    PixelVerdict.CONTRADICTS: Tone.BAD,
    PixelVerdict.CANNOT_TELL: Tone.CAUTION,
}
FILES: Final = (
    Column("file", lambda one: one.file),
    Column("camera", lambda one: one.camera or "", rank=1),
    Column("verdict", lambda one: Badge(one.verdict.value, VERDICTS[one.verdict])),
    Column("why", lambda one: one.message, below=""),
)
BY_PIXELS: Final = (
    Column("K of", lambda one: one.camera),
    Column("the pixels say", lambda one: Badge(one.pixels.verdict.value, PIXELS[one.pixels.verdict])),
    Column("why", lambda one: "; ".join(filter(None, (one.pixels.figures, one.pixels.reason))), below=""),
)


def told(done: CheckReport) -> View:
    """Describe a check; the answer is of the K that is about to be used."""
    blocks: list[Block] = []
    if done.files:
        blocks.append(Table.of("Each file, and each camera that it may belong to", done.files, FILES))
    if done.by_pixels:
        blocks.append(Table.of("The images' own K, by the pixels", done.by_pixels, BY_PIXELS))
    if done.not_read:
        blocks.append(Bullets(tuple(f"not read  {one.name}: {one.reason}" for one in done.not_read)))
    return View(
        title=f"Check of {count(len(done.files), 'file')}",
        badge=Badge("right", Tone.GOOD) if done.is_right else Badge("not right", Tone.BAD),
        lead=_answer(done),
        sections=(Section(title="Files", blocks=tuple(blocks)),),
        made_by=made_by(),
    )


def _answer(done: CheckReport) -> str:
    if not done.files:
        said = ", ".join(sorted({one.pixels.verdict.value for one in done.by_pixels})) or "nothing"
        return f"the pixels say of the images' own K: {said}"
    if done.is_right:
        return "the K you are about to use is right"
    wrong = [one for one in done.files if one.verdict is not Rightness.RIGHT]
    if not wrong:
        return "the pixels contradict the K that the images state"
    number = f"{len(wrong)} of {len(done.files)}: " if len(done.files) > 1 else ""
    return f"{number}the K you are about to use {wrong[0].answer or f'cannot be used: {wrong[0].message}'}"
