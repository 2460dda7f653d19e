"""ARToolKitPlus camera calibration, Rev02: a heading and one line of numbers.

In the format's own words::

    ARToolKitPlus_CamCal_Rev02
    xsize ysize cc_x cc_y fc_x fc_y kc1 kc2 kc3 kc4 kc5 kc6 undist_iterations

The principal point comes before the focal lengths. The numbers are those of Bouguet's Camera Calibration Toolbox, from
which the files are filled in by hand or by a script: kc1 … kc5 are k1, k2, p1, p2, k3, and kc6 is not used. The program
does not read what follows the line of numbers.

Sources: ARToolKitPlus, ``Camera.cpp`` and ``Camera.h``; J.-Y. Bouguet, "Description of the calibration
parameters".
"""

from __future__ import annotations

from collections.abc import Sequence

from calibrary.calibration import Calibration
from calibrary.distortion import BrownConrady, Distortion, NoDistortion, required
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, WriteContext
from calibrary.parsers.formats._text_rows import text_of

FAMILY = "ARToolKitPlus_CamCal_"
HEADING = "ARToolKitPlus_CamCal_Rev02"
CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "p1", "p2", "k3"),
    remarks=("the principal point comes before the focal lengths", "a sixth coefficient is not used"),
)
COUNT = 13
MAX_BYTES = 64 * 1024
"""A hundred times what such a file contains."""
ITERATIONS = "artoolkitplus_cal/undist_iterations"
MOST_ITERATIONS = 20
"""What the program allows itself at most."""
ORIGIN_NOTE = (
    "the format does not say where cx and cy count from; they were read as counted from the centre of the "
    "top-left pixel, as in the toolbox that its files are filled in from"
)


def sniff(content: Content) -> Sniff | None:
    """The first line says what it is."""
    if content.first_line.startswith(FAMILY):
        return Sniff(Sure.MAGIC, f"the first line is {strict.shown(content.first_line)}")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera of the file."""
    values = _numbers(text_of(data, most=MAX_BYTES))
    width, height, cx, cy, fx, fy, k1, k2, p1, p2, k3, sixth, iterations = values
    size = context.size(strict.image_size(width, height))
    K = CONVENTION.intrinsics(Native(fx=fx, fy=fy, cx=cx, cy=cy), size)
    ignored = (f"the sixth coefficient, {sixth:g}, is read by no program",) if sixth else ()
    return [
        context.calibration(
            K,
            _lens(k1, k2, p1, p2, k3),
            notes=(ORIGIN_NOTE, *ignored),
            extras=((ITERATIONS, f"{iterations:.0f}"),),
        )
    ]


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """Two lines; the count of iterations that stands last is not a part of the camera."""
    [calibration] = calibrations
    native = CONVENTION.native(calibration.intrinsics)
    lens = required(calibration.distortion, BrownConrady)
    coefficients = (lens.k1, lens.k2, lens.p1, lens.p2, lens.k3, 0.0)
    iterations = dict(calibration.extras).get(ITERATIONS, str(MOST_ITERATIONS if any(coefficients) else 0))
    numbers = (native.cx, native.cy, native.fx, native.fy, *coefficients)
    row = [*map(str, calibration.intrinsics.image_size), *map(repr, numbers), iterations]
    return f"{HEADING}\n{' '.join(row)}\n".encode()


def _numbers(text: str) -> tuple[float, ...]:
    """The thirteen numbers of the line after the heading."""
    rows = [line for raw in text.splitlines() if (line := raw.strip())]
    if not rows or not rows[0].startswith(FAMILY):
        raise ParseError(f"the first line is not {HEADING}")
    if rows[0] != HEADING:
        raise ParseError(f"its revision is {strict.shown(rows[0])}, expected {HEADING}")
    if len(rows) == 1:
        raise ParseError("there is no line of numbers after the heading")
    return strict.numbers(rows[1], count=COUNT, place="second line")


def _lens(k1: float, k2: float, p1: float, p2: float, k3: float) -> Distortion:
    if not any((k1, k2, p1, p2, k3)):
        return NoDistortion()
    return BrownConrady(k1=k1, k2=k2, p1=p1, p2=p2, k3=k3)


FORMAT = Format(
    name="artoolkitplus_cal",
    title="ARToolKitPlus camera calibration",
    suffixes=(".cal",),
    syntaxes=(Syntax.TEXT,),
    reference="https://github.com/paroj/artoolkitplus",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(models=(NoDistortion, BrownConrady)),
)
