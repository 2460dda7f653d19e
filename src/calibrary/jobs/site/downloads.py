"""A calibration in every format that holds it, ready to be taken; of the others, why they are not there."""

from __future__ import annotations

from msgspec import Struct

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.errors import InputError
from calibrary.parsers.fit import reason_for_fit
from calibrary.records import replace
from calibrary.registry.entry import Entry
from calibrary.registry.paths import slug

__all__ = ["Download", "downloads"]


class Download(Struct, frozen=True, kw_only=True):
    """One format.

    Attributes:
        format: its name.
        title: what people call it.
        name: the file's; None where there is none.
        data: its bytes.
        remark: how well it holds K and the lens, or why there is no file.
        left_out: what else is known and not in the file.
        address: below the site's root, of a file that others wrote; None for the entry's own.
    """

    format: str
    title: str
    name: str | None = None
    data: bytes = b""
    remark: str = ""
    left_out: str = ""
    address: str | None = None


def downloads(entry: Entry) -> tuple[Download, ...]:
    """Every format that can be written, in alphabetical order.

    A lens model or a K that a format has no place for could be fitted to what it has. That takes up to a second a file,
    so it is left to ``calibrary convert``, which also says by how much such a file is off.
    """
    calibration = entry.calibration
    camera = calibration.camera
    size = "{}x{}".format(*calibration.intrinsics.image_size)
    stem = f"{slug(camera.model or '')}-{size}"
    return tuple(
        _download(calibration, record, f"{stem}-{record.name}{record.suffixes[0]}")
        for record in parsers.formats()
        if record.write is not None
    )


def _download(calibration: Calibration, record: parsers.Format, name: str) -> Download:
    reason = reason_for_fit(calibration, record.capacity) if record.capacity is not None else None
    if reason is not None:
        remark = f"{reason}; calibrary convert fits the nearest and says how far it is off"
        return Download(format=record.name, title=record.title, remark=remark)
    try:
        data, verdict = parsers.encode([calibration], record, name=name)
    except InputError as error:
        return Download(format=record.name, title=record.title, remark=error.message)
    return Download(
        format=record.name,
        title=record.title,
        name=name,
        data=data,
        remark=str(replace(verdict, dropped=())),
        left_out=", ".join(verdict.dropped) or "nothing",
    )
