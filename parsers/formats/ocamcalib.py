"""``calib_results.txt`` of OCamCalib, D. Scaramuzza's toolbox for omnidirectional cameras.

In the format's own words, headings beginning with ``#`` in between::

    5 -3.2e+02 0.0 8.6e-04 -3.5e-08 6.7e-09        the DIRECT mapping function, a0 a1 a2 a3 a4
    11 407.2 159.7 …                                the inverse mapping function
    261.7 326.9                                     center: "row" and "column", from 0
    1.0020 0.0014 0.0001                            affine parameters "c", "d", "e"
    480 640                                         image size: "height" and "width"

A ray is (x, y, a0 + a2·ρ² + …) of the sensor's x (down) and y (right), with row = c·x + d·y + centre and column = e·x +
y + centre. The third axis points backwards, so a0 is negative, and −a0 is the focal length on the axis. K is f·(1 e; d
c) brought to its upper triangle; where d is not zero that turns the camera about its axis, by as much as the notes say.
The inverse function is a fit to the direct one, so calibrary reads the direct one.

Sources: OCamCalib, ``ocam_functions.cpp``; D. Scaramuzza and others, IROS 2006.
"""

from __future__ import annotations

import json
import math

from calibrary.calibration import Calibration, Origin
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Direction, Native, Tangential
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._json_text import loaded
from calibrary.parsers.formats._taylor import taylor_lens, upper_triangle
from calibrary.parsers.formats._text_rows import text_of

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    direction=Direction.DISTORTED_TO_UNDISTORTED,
    tangential=Tangential.NONE,
    coefficients=("a0", "a1", "a2", "a3", "a4"),
    remarks=(
        "rows come before columns",
        "the polynomial takes a radius in px to the ray's third component",
    ),
)
HEADING = "#polynomial coefficients for the DIRECT mapping function"
MAX_BYTES = 64 * 1024
"""A hundred times what such a file contains."""
CLEARLY = 2.0
"""How many times farther from the image's middle the other reading of a centre is, at least."""
MOST = 64
"""Coefficients in either function, as in the toolbox's own reader."""
PREFIX = "ocamcalib/"


def sniff(content: Content) -> Sniff | None:
    """The first heading is the same in every file; in JSON the two polynomials."""
    if {"pol", "invpol", "xc", "yc"} <= set(content.json_keys):
        return Sniff(Sure.MAGIC, "JSON with pol, invpol, xc and yc")
    if content.first_line.replace("# ", "#", 1).startswith(HEADING):
        return Sniff(Sure.MAGIC, "the first line is OCamCalib's heading of the direct mapping function")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera of the file."""
    if data.lstrip().startswith(b"{"):
        return [_of_json(loaded(data, context), context)]
    direct, inverse, centre, affine, size = _rows(data)
    coefficients = _counted(direct, "direct mapping function")
    if not coefficients[0] < 0:
        place = "direct mapping function"
        raise ParseError(
            f"a0 is {coefficients[0]:g}, expected a negative one: the axis points backwards", place=place
        )
    lens, f = taylor_lens([-value for value in coefficients], place="direct mapping function")
    row, column = strict.numbers(centre, count=2, place="center")
    c, d, e = strict.numbers(affine, count=3, place="affine parameters")
    height, width = strict.numbers(size, count=2, place="image size")
    image_size = context.size(strict.image_size(width, height, place="image size"))
    fx, skew, fy, turn = upper_triangle(f, c, d, e, place="affine parameters")
    native = Native(fx=fx, fy=fy, cx=column, cy=row, skew=skew)
    turned = f"the camera's frame is turned about its axis by {math.degrees(turn):.4f}° against OCamCalib's"
    return [
        context.calibration(
            CONVENTION.intrinsics(native, image_size),
            lens,
            notes=(turned,) if turn else (),
            extras=((PREFIX + "invpol", " ".join(inverse.split())),),
        )
    ]


def _of_json(document: Node, context: ReadContext) -> Calibration:
    """The names of OCamCalib's C structure, whose axis some turn forwards and whose centre some write column first."""
    polynomial = document["pol"]
    values = polynomial.numbers()
    sign = -1 if values and values[0] < 0 else 1
    lens, f = taylor_lens([sign * value for value in values], place="pol")
    width, height = size = context.size(document.image_size("width", "height"))
    xc, yc, c, d, e = (document[key].number() for key in ("xc", "yc", "c", "d", "e"))
    off = [math.hypot(x / width - 0.5, y / height - 0.5) for x, y in ((xc, yc), (yc, xc))]
    if min(off) * CLEARLY > max(off):
        document["xc"].fail(
            f"it is not clear whether xc {xc:g} and yc {yc:g} are column and row or, as OCamCalib's, row and column; "
            "write the camera as OCamCalib's calib_results.txt"
        )
    is_column_first = off[0] < off[1]
    matrix = (f * c, 1 / c, e / c, d / c) if is_column_first and c else (f, c, d, e)
    fx, skew, fy, turn = upper_triangle(*matrix, place="c, d, e")
    cx, cy = (xc, yc) if is_column_first else (yc, xc)
    native = Native(fx=fx, fy=fy, cx=cx, cy=cy, skew=skew)
    notes = [
        f"xc and yc were taken as {'column and row' if is_column_first else 'row and column'}, by the image size"
    ]
    notes += (
        [f"the camera's frame is turned about its axis by {math.degrees(turn):.4f}° against the file's"]
        if turn
        else []
    )
    extras = ((PREFIX + "invpol", " ".join(json.dumps(value) for value in document["invpol"].numbers())),)
    return context.calibration(CONVENTION.intrinsics(native, size), lens, notes=notes, extras=extras)


def _rows(data: bytes) -> tuple[str, str, str, str, str]:
    """The five rows of numbers."""
    text = text_of(data, most=MAX_BYTES)
    if not text.lstrip().startswith("#"):
        raise ParseError(f"it does not begin with {HEADING}")
    rows = [row for raw in strict.lines(text) if (row := raw.strip()) and not row.startswith("#")]
    if len(rows) != 5:
        raise ParseError(f"{len(rows)} rows of numbers, expected 5")
    return rows[0], rows[1], rows[2], rows[3], rows[4]


def _counted(row: str, place: str) -> tuple[float, ...]:
    """The numbers of a row that begins with their count."""
    count, *rest = row.split()
    promised = strict.whole(count, place=place)
    if not 1 <= promised <= MOST:
        raise ParseError(f"{promised} coefficients, expected 1 to {MOST}", place=place)
    return strict.numbers(" ".join(rest), count=promised, place=place)


FORMAT = Format(
    name="ocamcalib",
    title="OCamCalib (Scaramuzza) calib_results.txt",
    suffixes=(".txt", ".json"),
    syntaxes=(Syntax.TEXT, Syntax.JSON),
    reference="https://sites.google.com/site/scarabotix/ocamcalib-omnidirectional-camera-calibration-toolbox-for-matlab",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
