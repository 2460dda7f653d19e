"""File formats with the relative poses of a rig's cameras, read and written as :class:`~calibrary.rig.Rig`.

Each format has a module with ``sniff``, ``read`` and ``write``. A camera's lens is read and written by the
format's module for single cameras, if there is one.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

from msgspec import Struct

from calibrary.atomic import write_files
from calibrary.errors import InputError
from calibrary.parsers.content import Content
from calibrary.parsers.rigs import colmap_rig, kalibr_chain, micasense, opencv_stereo
from calibrary.rig import Rig

__all__ = ["RIG_FORMATS", "RigFormat", "encode_rig", "format_of_name", "read_rig", "write_rig"]


class RigFormat(Struct, frozen=True, kw_only=True):
    """A rig file format.

    Attributes:
        title: common name.
        sniff: returns whether content is of this format.
        read: reads the rig from a file's path and bytes.
        write: makes the bytes of a rig for a file name.
    """

    title: str
    sniff: Callable[[Content], bool]
    read: Callable[[Path, bytes], Rig]
    write: Callable[[Rig, str], bytes]


RIG_FORMATS: Final = {
    name: RigFormat(title=module.TITLE, sniff=module.sniff, read=module.read, write=module.write)
    for name, module in (
        ("kalibr", kalibr_chain),
        ("opencv", opencv_stereo),
        ("colmap", colmap_rig),
        ("micasense", micasense),
    )
}
"""Formats by the program that reads them, the word of ``--to``."""
MOST_BYTES: Final = 2_000_000


def read_rig(path: Path) -> Rig:
    """Read the rig of a file; the format is recognised by content.

    Raises:
        InputError: the file cannot be read, or has none of these formats.
        ParseError: the file is broken.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror or error}", source=path.name) from None
    if len(data) > MOST_BYTES:
        raise InputError(f"is {len(data)} bytes long, expected at most {MOST_BYTES}", source=path.name)
    content = Content(data, path.name)
    for one in RIG_FORMATS.values():
        if one.sniff(content):
            return one.read(path, data)
    titles = ", ".join(one.title for one in RIG_FORMATS.values())
    raise InputError(f"does not say where the cameras of a rig are; expected {titles}", source=path.name)


def write_rig(rig: Rig, path: Path, form: str | None = None) -> None:
    """Write the file of a rig.

    Args:
        rig: with calibrations.
        path: file to create or replace.
        form: one of :data:`RIG_FORMATS`; by default that of the file's name.

    Raises:
        InputError: the format is unknown, or the file cannot be written.
        UnsupportedModelError: the format cannot represent these cameras.
    """
    write_files({path: encode_rig(rig, form or format_of_name(path.name), path.name)})


def encode_rig(rig: Rig, form: str, name: str) -> bytes:
    """Encode a rig in a format.

    Args:
        rig: with calibrations.
        form: one of :data:`RIG_FORMATS`.
        name: of the file.

    Raises:
        InputError: the format is unknown.
        UnsupportedModelError: the format cannot represent these cameras.
    """
    found = RIG_FORMATS.get(form)
    if found is None:
        raise InputError(f"no rig format {form!r:.40}; expected {', '.join(RIG_FORMATS)}", place="--to")
    return found.write(rig, name)


def format_of_name(name: str) -> str:
    """The default format for a file name.

    Raises:
        InputError: the name matches several formats or none.
    """
    lower = name.lower()
    if "camchain" in lower or "kalibr" in lower:
        return "kalibr"
    if lower.endswith(".json"):
        if "micasense" in lower or "relatives" in lower:
            return "micasense"
        return "colmap"
    if lower.endswith((".yml", ".xml", ".yaml")):
        return "opencv"
    raise InputError(
        f"the name {name!r:.60} says no rig format; give --to {' | '.join(RIG_FORMATS)}", place="--to"
    )
