"""``K.txt``, ``K.csv`` and ScanNet's ``intrinsic_color.txt``: an intrinsic matrix by itself, as text.

In the format's own words::

    1170.19    0.0  647.75  0.0
       0.0 1170.19  483.75  0.0
       0.0     0.0     1.0  0.0
       0.0     0.0     0.0  1.0

Nine numbers of 3×3, or the sixteen of 4×4 with a column of zeros, on any number of lines, separated by blanks, commas
or semicolons, with or without brackets. The file does not state the image size, the pixel origin or a distortion.

Sources: numpy, ``savetxt``; ScanNet, README "Data Organization", ``intrinsic/intrinsic_color.txt``.
"""

from __future__ import annotations

import re

from calibrary.calibration import Calibration, Grade
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, Tangential
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._one_camera import camera
from calibrary.parsers.formats._text_rows import text_of
from calibrary.parsers.formats.pinhole_json import ORIGIN, chosen_origin
from calibrary.records import replace

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    tangential=Tangential.NONE,
    remarks=("K alone: the file contains no distortion and no image size", "the origin is not stated"),
)
MOST = 4096
SMALLEST = 10.0
"""px: a focal length shorter than that is another matrix's number."""
DERIVED = "a bare matrix does not say how it came about; taken as derived"
FIRST = frozenset("0123456789+-.[#")
_PARTS = re.compile(r"[\s,;\[\]]+")


def sniff(content: Content) -> Sniff | None:
    """Nothing but a K."""
    text = content.text
    if text is None or len(content.data) > MOST or content.first_line[:1] not in FIRST:
        return None
    try:
        _native(text)
    except ParseError:
        return None
    return Sniff(Sure.SHAPE, "it is nothing but a matrix that has the form of a K")


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one K."""
    native = _native(text_of(data, most=MOST))
    origin, sentence = chosen_origin(context, CONVENTION.origin)
    convention = replace(CONVENTION, origin=origin)
    return [
        replace(
            camera(context, convention, native, None, None, assumptions=(sentence, DERIVED)),
            grade=Grade.DERIVED,
        )
    ]


def _native(text: str) -> Native:
    rows = [line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    numbers = strict.numbers(_PARTS.sub(" ", " ".join(rows)), count=(9, 16))
    side = 3 if len(numbers) == 9 else 4
    matrix = [numbers[start : start + side] for start in range(0, len(numbers), side)]
    (fx, skew, cx, *_), (below, fy, cy, *_), last = matrix[:3]
    filled = (
        [*(row[3] for row in matrix[:3]), *matrix[3]] if side == 4 else [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]
    )
    if below or last[:3] != (0, 0, 1) or filled != [0, 0, 0, 0, 0, 0, 1] or min(fx, fy) < SMALLEST:
        raise ParseError(
            "this is not an intrinsic matrix, expected fx s cx / 0 fy cy / 0 0 1 with fx and fy in px"
        )
    return Native(fx=fx, fy=fy, cx=cx, cy=cy, skew=skew)


FORMAT = Format(
    name="k_text",
    title="K as text (K.txt, K.csv, ScanNet's intrinsic_color.txt)",
    suffixes=(".txt", ".csv"),
    syntaxes=(Syntax.TEXT, Syntax.JSON),
    reference="https://numpy.org/doc/stable/reference/generated/numpy.savetxt.html",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    needs_image_size=True,
    options=(ORIGIN,),
)
