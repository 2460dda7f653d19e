"""blue-c's ``.rad`` (also ``.cal``): CalTech's camera parameters for MultiCamSelfCal, one to a line.

In the format's own words::

    K11 = 422.3
    K12 = 0.0
    …
    K33 = 1.0

    kc1 = -0.28      % k1
    kc2 = 0.07       % k2
    kc3 = 0.0004     % p1
    kc4 = -0.0001    % p2

The programs read the lines by their position: nine of K, an empty line, and four coefficients of Bouguet's Camera
Calibration Toolbox; there is no line for a fifth. Some files end with ``alpha_c = …``, the skew as a fraction of fx.
The image size is not in the file.

Source: MultiCamSelfCal, ``RadialDistortions/readradfile.m`` and ``undoradial.m``; J.-Y. Bouguet, "Description
of the calibration parameters".
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from calibrary.calibration import Calibration
from calibrary.distortion import BrownConrady, Distortion, NoDistortion, required
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, WriteContext
from calibrary.parsers.formats._opencv_lens import BrownWithoutK3
from calibrary.parsers.formats._text_rows import text_of

MATRIX = tuple(f"K{row}{column}" for row in "123" for column in "123")
COEFFICIENTS = ("kc1", "kc2", "kc3", "kc4")
SKEW = "alpha_c"
MAX_BYTES = 64 * 1024
"""A hundred times what such a file contains."""
CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "p1", "p2"),
    remarks=("lines are read by their position", "alpha_c, if stated, is the skew as a fraction of fx"),
)
SKEW_NOTE = (
    "the skew was taken as K has it; MultiCamSelfCal passes it over when it corrects points for the lens"
)

_LINE = re.compile(r"(K[1-3][1-3]|kc[1-9]|alpha_c)\s*=\s*(\S+)")
_FIRST = re.compile(r"K11\s*=")


def sniff(content: Content) -> Sniff | None:
    """K by its elements and kc by its own, one to a line."""
    if _FIRST.match(content.first_line) and any(line.startswith("kc1") for line in content.lines):
        return Sniff(Sure.MAGIC, "the lines K11 = … and kc1 = … are those of MultiCamSelfCal")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera of the file; its size comes from the caller."""
    values = _values(text_of(data, most=MAX_BYTES))
    _check_matrix(values)
    skew = values["K12"]
    if SKEW in values:
        if skew and abs(values[SKEW] * values["K11"] - skew) > 1e-6 * values["K11"]:
            raise ParseError(
                f"K12 is {skew:g} and alpha_c·K11 is {values[SKEW] * values['K11']:g}; expected the same skew",
                place=SKEW,
            )
        skew = skew or values[SKEW] * values["K11"]
    size = context.size(None)
    native = Native(fx=values["K11"], fy=values["K22"], cx=values["K13"], cy=values["K23"], skew=skew)
    return [
        context.calibration(
            CONVENTION.intrinsics(native, size), _lens(values), notes=(SKEW_NOTE,) if skew else ()
        )
    ]


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """The lines in the places where the programs look for them."""
    [calibration] = calibrations
    native = CONVENTION.native(calibration.intrinsics)
    lens = required(calibration.distortion, BrownWithoutK3)
    K = (native.fx, 0.0, native.cx, 0.0, native.fy, native.cy, 0.0, 0.0, 1.0)
    rows = [f"{name} = {value!r}" for name, value in zip(MATRIX, K, strict=True)]
    rows += ["", *(f"{n} = {v!r}" for n, v in zip(COEFFICIENTS, lens.coefficients.values(), strict=True)), ""]
    return "".join(f"{row}\n" for row in rows).encode()


def _values(text: str) -> dict[str, float]:
    """The numbers by name, all of K and at least four coefficients."""
    values: dict[str, float] = {}
    for index, row in enumerate(strict.lines(text), start=1):
        line = row.partition("%")[0].strip()
        if not line:
            continue
        found = _LINE.fullmatch(line)
        if found is None:
            raise ParseError(
                f"{strict.shown(line)} is not a line such as K11 = 1104.7", place=f"line {index}"
            )
        name = found[1]
        if name in values:
            raise ParseError(f"{name} is a duplicate key", place=f"line {index}")
        values[name] = strict.number(found[2], place=name)
    missing = [name for name in (*MATRIX, *COEFFICIENTS) if name not in values]
    if missing:
        raise ParseError(f"there is no {', '.join(missing)}")
    return values


def _check_matrix(values: dict[str, float]) -> None:
    if values["K21"] or values["K31"] or values["K32"] or values["K33"] != 1:
        raise ParseError(
            "the nine elements are not an intrinsic matrix, expected K21, K31, K32 = 0 and K33 = 1"
        )


def _lens(values: dict[str, float]) -> Distortion:
    kc = [values.get(f"kc{index}", 0.0) for index in range(1, 10)]
    if any(kc[5:]):
        raise UnsupportedModelError(
            "it contains more than five coefficients, of which only k1 k2 p1 p2 k3 are known"
        )
    k1, k2, p1, p2, k3 = kc[:5]
    return BrownConrady(k1=k1, k2=k2, p1=p1, p2=p2, k3=k3) if any(kc) else NoDistortion()


FORMAT = Format(
    name="bluec_rad",
    title="blue-c (CalTech, MultiCamSelfCal) camera parameters",
    suffixes=(".rad", ".cal"),
    syntaxes=(Syntax.TEXT,),
    reference="https://github.com/strawlab/MultiCamSelfCal",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(models=(NoDistortion, BrownWithoutK3)),
    needs_image_size=True,
)
