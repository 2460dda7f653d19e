"""What an inspection shows: of each file its format, its calibrations with all digits, and how it counts."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Final

from calibrary.calibration import Calibration
from calibrary.jobs.inspect.run import InspectedFile, InspectFilesReport
from calibrary.pages.wording import count, made_by
from calibrary.view import Badge, Block, Bullets, KeyValues, Note, Section, Tone, View

if TYPE_CHECKING:
    from calibrary.jobs.inspect import UnsizedCalibration

NOT_SHOWN: Final = (
    "positions, serial numbers, people's names, thumbnails, binary values, and tags without a known name"
)


def told(done: InspectFilesReport) -> View:
    """Describe what files contain."""
    cameras = sum(len(one.calibrations) + len(one.unsized) for one in done.files)
    unread = sum(one.error is not None for one in done.files)
    is_good = done.is_read and done.is_plausible
    each = tuple(Section(title=str(one.path), blocks=tuple(_file(one))) for one in done.files)
    return View(
        title=f"Contents of {count(len(done.files), 'file')}",
        badge=Badge("read", Tone.GOOD) if is_good else Badge("look at it", Tone.BAD),
        lead=f"{count(len(done.files), 'file')}, {count(cameras, 'calibration')}"
        + (f", {unread} not read" if unread else "")
        + ("" if done.is_plausible else ", an unlikely K among them"),
        sections=(Section(title="Files", blocks=each),),
        made_by=made_by(),
    )


def _file(one: InspectedFile) -> Iterator[Block]:
    if one.error is not None:
        yield Note(text=f"not read: {one.error}", tone=Tone.BAD)
        return
    yield f"{one.title or ''}{f': {one.why}' if one.why else ''}"
    if one.tags is not None:
        yield KeyValues(tuple((tag.name, tag.value) for tag in one.tags))
    if one.tags_left_out:
        yield f"{one.tags_left_out} more are not shown: {NOT_SHOWN}"
    for calibration in one.calibrations:
        yield from _calibration(calibration)
    for unsized in one.unsized:
        yield from _calibration(unsized)
    for reason in one.implausible:
        yield Note(text=f"an unlikely K: {reason}", tone=Tone.BAD)
    if one.conventions:
        yield Bullets(one.conventions)
    for warning in one.warnings:
        yield Note(text=warning, tone=Tone.CAUTION)


def _calibration(calibration: Calibration | UnsizedCalibration) -> Iterator[Block]:
    K, lens, quality = calibration.intrinsics, calibration.distortion, calibration.quality
    numbers = [
        f"{name} {value:.4f}" if value is not None else f"{name} unknown"
        for name, value in (("fx", K.fx), ("fy", K.fy), ("cx", K.cx), ("cy", K.cy))
    ]
    numbers += [f"skew {K.skew:.6g}"] if K.skew else []
    frame = "{}×{} px".format(*K.image_size) if K.image_size else "an image of unknown size, px"
    coefficients = "  ".join(f"{name} {value:.8g}" for name, value in lens.shown.items()) if lens else ""
    yield f"{calibration.camera}  {calibration.grade.value}"
    yield f"{'  '.join(numbers)}  in {frame} from the outer corner"
    yield f"distortion {lens.model}  {coefficients}" if lens is not None else "distortion unknown"
    if quality is not None and quality.rms_px is not None:
        yield f"rms {quality.rms_px:.4g} px"
    yield from (f"assumed: {text}" for text in calibration.provenance.assumptions)
    yield from (f"note: {text}" for text in calibration.notes)
