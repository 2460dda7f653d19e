"""The files of an entry to download: its own, one in every format that can represent it, and the published one."""

from __future__ import annotations

from pathlib import Path

from msgspec import Struct

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.errors import InputError
from calibrary.parsers.fit import reason_for_fit
from calibrary.records import replace
from calibrary.registry.entry import Entry
from calibrary.registry.paths import slug
from calibrary.registry.published.layout import camera_path

__all__ = ["Download", "downloads", "published_file"]


class Download(Struct, frozen=True, kw_only=True):
    """One format.

    Attributes:
        format: name of the format.
        title: common name of the format.
        name: of the file; None if there is none.
        data: content of the file.
        remark: how exactly it represents K and the lens, or why there is no file.
        left_out: known data that the file does not contain.
        address: relative to the site's root, of a published file; None for a file of the entry itself.
    """

    format: str
    title: str
    name: str | None = None
    data: bytes = b""
    remark: str = ""
    left_out: str = ""
    address: str | None = None


def downloads(entry: Entry, data: bytes) -> tuple[Download, ...]:
    """Files in all formats that can be written, in alphabetical order, and the entry's own file with its bytes.

    A lens model that a format cannot represent could be refitted to one of its models. That takes up to a
    second per file, so it is left to ``calibrary convert``, which also reports the error of such a file.
    """
    calibration = entry.calibration
    camera = calibration.camera
    size = "{}x{}".format(*calibration.intrinsics.image_size)
    stem = f"{slug(camera.model or '')}-{size}"
    written = [
        _download(calibration, record, f"{stem}-{record.name}{record.suffixes[0]}")
        for record in parsers.formats()
        if record.write is not None
    ]
    name = f"{Path(entry.path).stem}-entry.yaml"
    own = Download(
        format="entry", title="calibrary entry", name=name, data=data, remark="exact", left_out="nothing"
    )
    return (*written, own)


def published_file(entry: Entry) -> Download:
    """The published file for programs that contains the entry."""
    address = camera_path(entry.calibration.camera)
    return Download(
        format="published",
        title="for programs, over HTTP",
        name=address.rpartition("/")[2],
        remark="every entry of this camera, with the digest of its file",
        left_out="drafts, labels, tags",
        address=address,
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
