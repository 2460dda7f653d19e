"""What is fuzzed: one function of bytes for every reader, which raises only what a reader must never raise.

The readers promise for any bytes at all: an error of calibrary's own or calibrations that can be used, within
two seconds and 512 MiB. ``identify`` is the way a file without a named format takes, through every sniffer;
``image`` reads what an image's head says.
"""

from __future__ import annotations

import json
import tempfile
import zlib
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TypeAlias

import numpy as np

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.errors import CalibraryError
from calibrary.parsers.content import Content
from calibrary.parsers.format import Format
from calibrary.parsers.images import read_image
from calibrary.parsers.reading import identified, read_content
from calibrary.records import to_json

__all__ = ["IDENTIFY", "IMAGE", "MAX_GROWTH_MIB", "MAX_SECONDS", "Target", "target_named", "targets"]

IDENTIFY, IMAGE = "identify", "image"
MAX_SECONDS = 2.0
MAX_GROWTH_MIB = 512
SIZE = (4000, 3000)
RAYS = np.array([[0.0, 0.0, 1.0], [0.3, -0.2, 1.0], [-0.9, 0.7, 1.0], [1.0, 1.0, -0.5]])

Target: TypeAlias = Callable[[bytes], None]


def targets() -> tuple[str, ...]:
    """Every reader by its format's name, and the two ways in that need none."""
    return (IDENTIFY, IMAGE, *(record.name for record in parsers.formats() if record.read is not None))


def target_named(name: str) -> Target:
    """The function that is fed."""
    if name == IDENTIFY:
        return _identify
    if name == IMAGE:
        return _image
    [record] = (item for item in parsers.formats() if item.name == name)
    return lambda data: _read(data, record)


def _identify(data: bytes) -> None:
    content = Content(data, "fuzzed")
    for record in parsers.formats():
        record.sniff(content)
    try:
        identified(content)
        _use(read_content(content, image_size=SIZE))
    except CalibraryError as error:
        str(error)


def _read(data: bytes, record: Format) -> None:
    content = Content(data, "fuzzed")
    record.sniff(content)
    # What the caller says is drawn by the bytes themselves, so that a file alone tells its whole story.
    dice = zlib.crc32(data)
    options: dict[str, str] = {}
    for option in record.options:
        dice, choice = divmod(dice, len(option.values) + 1)
        if choice:
            options[option.name] = option.values[choice - 1]
    size = SIZE if record.needs_image_size or dice % 4 == 0 else None
    try:
        _use(read_content(content, record=record, image_size=size, options=options))
    except CalibraryError as error:
        str(error)


def _image(data: bytes) -> None:
    # Images are read from files, of which no more than the head is taken in.
    with tempfile.NamedTemporaryFile(suffix=".jpg") as file:
        file.write(data)
        file.flush()
        try:
            _use(read_image(Path(file.name)))
        except CalibraryError as error:
            str(error)


def _use(calibrations: Iterable[Calibration]) -> None:
    """What everybody does with a calibration that was read."""
    for item in calibrations:
        pixels = item.project(RAYS)
        item.unproject(np.nan_to_num(pixels))
        json.dumps(to_json(item), allow_nan=False).encode()
