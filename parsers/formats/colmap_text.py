"""COLMAP's ``cameras.txt``: one line for each camera of a reconstruction.

In the format's own words::

    # Camera list with one line of data per camera:
    #   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]
    # Number of cameras: 2
    1 OPENCV 5472 3648 3650.12 3648.77 2745.81 1820.37 -0.0125 0.0231 -0.00037 0.00081
    2 SIMPLE_RADIAL 4000 3000 2981.4 2000 1500 -0.03

The parameters are those of the model, see :mod:`calibrary.interop.colmap`. Lines that begin with # are comments. If the
last of them counts more cameras than the file has, the file was cut off. COLMAP writes it after bundle adjustment; a
folder that contains ``cameras.bin`` as well is read from that.

Source: COLMAP documentation, "Output Format".
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import chain

from calibrary.arrays import np
from calibrary.calibration import Calibration, Grade
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.interop.colmap import COLMAP_MODELS, PANORAMAS, ColmapModel, model_named
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure, WriteContext
from calibrary.parsers.formats._colmap import (
    CAPACITY,
    CONVENTION,
    MAX_CAMERAS,
    StoredCamera,
    StoredColumns,
    cameras,
    records,
)
from calibrary.parsers.on_demand import FEW, Columns

HEADING = (
    "# Camera list with one line of data per camera:",
    "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]",
)
MAX_BYTES = 8 * 1024 * 1024
LARGEST_WHOLE = 2.0**53

_COUNT = re.compile(r"#\s*Number of cameras:\s*(\d{1,9})\b")
_PANORAMAS = dict(PANORAMAS.values())
_NAMES = "|".join([*(model.name for model in COLMAP_MODELS), *_PANORAMAS])
_CAMERA = re.compile(rf"\d{{1,10}}\s+(?:{_NAMES})\s+\d{{1,7}}\s+\d{{1,7}}\s+[-+.\d]")


def sniff(content: Content) -> Sniff | None:
    """The heading that COLMAP writes; without it, a line that has a number and one of its models."""
    if content.first_line == HEADING[0]:
        return Sniff(Sure.MAGIC, f"the first line is '{HEADING[0]}'")
    first = next((line for line in content.lines if not line.startswith("#")), "")
    if _CAMERA.match(first):
        return Sniff(Sure.SHAPE, f"the first line that is not a comment is a camera, '{first[:40]}…'")
    return None


def read(data: bytes, context: ReadContext) -> Sequence[Calibration]:
    """Every camera, in the order of the lines."""
    strict.refuse_longer(data, MAX_BYTES, "COLMAP's text")
    found: list[StoredCamera] = []
    announced = 0
    rows = strict.lines(strict.decode(data))
    for index, row in enumerate(rows, start=1):
        text = row.strip()
        if text.startswith("#"):
            count = _COUNT.match(text)
            announced = int(count[1]) if count else announced
        elif text:
            alike = None if found else _alike(rows, index)
            if alike is not None and len(alike) >= announced:
                return cameras(alike, context, grade=Grade.ADJUSTED)
            if len(found) == MAX_CAMERAS:
                raise ParseError(f"there are over {MAX_CAMERAS} cameras")
            found.append(_camera(text.split(), place=f"line {index}"))
    if len(found) < announced:
        raise ParseError(
            f"{len(found)} cameras where the heading counts {announced}; the file is cut short, or correct it"
        )
    return cameras(found, context, grade=Grade.ADJUSTED)


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """As COLMAP writes it, with digits that read back bit for bit."""
    lines = [*HEADING, f"# Number of cameras: {len(calibrations)}"]
    for number, camera in records(calibrations):
        lines.append(
            f"{number} {camera.model} {camera.width} {camera.height} {' '.join(map(repr, camera.params))}"
        )
    return "".join(f"{line}\n" for line in lines).encode()


def write_columns(columns: Columns) -> bytes | None:
    """The same of many cameras of one of COLMAP's models."""
    model = columns.model
    if not isinstance(model, ColmapModel):
        return None
    numbers = np.concatenate([columns.K[:, 2 - model.focals :], columns.coefficients], axis=1).tolist()
    lines = [
        f"{number} {model.name} {width} {height} {' '.join(map(repr, own))}"
        for number, (width, height), own in zip(
            columns.ids.tolist(), columns.sizes.tolist(), numbers, strict=True
        )
    ]
    return "\n".join([*HEADING, f"# Number of cameras: {len(lines)}", *lines, ""]).encode()


def _alike(rows: Sequence[str], first: int) -> StoredColumns | None:
    """The cameras from a line on as columns, where all are of one model and there is nothing else; else None."""
    words = [row.split() for row in rows[first - 1 :]]
    name = words[0][1] if len(words[0]) > 1 else ""
    model = model_named(name)
    if (
        model is None
        or not FEW <= len(words) <= MAX_CAMERAS
        or set(map(len, words)) != {4 + model.count}
        or {row.pop(1) for row in words} != {name}
    ):
        return None
    values = strict.plain_numbers(" ".join(map(" ".join, words)), [*chain.from_iterable(words)])
    if values is None:
        return None
    table = np.array(values).reshape(len(words), -1)
    heads = table[:, :3]
    if not ((heads >= 0) & (heads < LARGEST_WHOLE) & (heads == np.floor(heads))).all():
        return None
    return StoredColumns(model, heads[:, 0], heads[:, 1:], table[:, 3:], "line {}", first)


def _camera(words: list[str], *, place: str) -> StoredCamera:
    """One line's camera."""
    if len(words) < 5:
        raise ParseError(
            f"{len(words)} words, expected a number, a model, a width, a height and the parameters",
            place=place,
        )
    number, width, height = (strict.whole(words[i], place=place) for i in (0, 2, 3))
    name = words[1]
    model = model_named(name)
    if model is None and name not in _PANORAMAS:
        raise UnsupportedModelError(
            f"COLMAP has no model {strict.shown(name)} that is known here, expected one of "
            f"{', '.join(item.name for item in COLMAP_MODELS)}",
            place=place,
        )
    count = model.count if model is not None else _PANORAMAS[name]
    if number < 0:
        raise ParseError(f"camera {number}, expected a number from 0", place=place)
    if len(words) - 4 != count:
        raise ParseError(f"{name} with {len(words) - 4} parameters, expected {count}", place=place)
    return StoredCamera(
        number=number,
        model=model or name,
        width=width,
        height=height,
        parameters=tuple(strict.number(word, place=place) for word in words[4:]),
        place=place,
    )


FORMAT = Format(
    name="colmap_text",
    title="COLMAP cameras.txt",
    suffixes=(".txt",),
    syntaxes=(Syntax.TEXT,),
    reference="https://colmap.github.io/format.html#cameras-txt",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    write_columns=write_columns,
    capacity=CAPACITY,
)
