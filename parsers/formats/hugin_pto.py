"""Hugin's panorama project (``.pto``), in PanoTools' script language: a lens for every image.

In the format's own words::

    # hugin project file
    p f2 w3000 h1500 v360 …
    i w4000 h3000 f0 v65.47 Ra0 … a0 b-0.0121 c0 d12.3 e-4.5 … n"IMG_0001.jpg"
    i w4000 h3000 f0 v=0 … a=0 b=0 c=0 d=0 e=0 … n"IMG_0002.jpg"

v is the horizontal field of view in degrees, d and e the offset of the lens's axis from the middle of the image, px,
y down; ``=0`` takes image 0's value. f0 is a pinhole, f3 an equidistant fisheye. The polynomial takes the radius ρ of
the undistorted image, in halves of the shorter side, to ρ(1 − a − b − c + c·ρ + b·ρ² + a·ρ³), and K has 1 − a − b − c
times the focal length. With a = c = 0, which is Hugin's default, that is Brown's with one coefficient. In a fisheye
the radius is the angle's and the formula the same. Images whose numbers are the same are one camera.

Sources: Hugin, ``doc/nona.txt``; libpano13, ``math.c`` (``radial``, ``horiz``, ``vert``) and ``adjust.c``.
"""

from __future__ import annotations

import math
import re

from calibrary.calibration import Calibration, Grade
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, Tangential
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._lenses import of_radius
from calibrary.parsers.formats._one_camera import camera
from calibrary.parsers.formats._text_rows import rows_of
from calibrary.records import replace

CONVENTION = Convention(
    origin=Origin.IMAGE_CENTRE,
    tangential=Tangential.NONE,
    coefficients=("a", "b", "c"),
    remarks=(
        "the focal length is a horizontal field of view in degrees",
        "the polynomial is in halves of the shorter side, and 1 − a − b − c multiplies the focal length",
    ),
)
NUMBERS = ("v", "a", "b", "c", "d", "e")
RECTILINEAR, FISHEYE = 0, 3
UNUSED = ("g", "t", "TrX", "TrY", "TrZ")
"""A sheared image, or a camera that moved: not the lens's."""
MAX_BYTES = 8 * 1024 * 1024
MAX_IMAGES = 10_000
MIDDLE = "d and e are read as offsets from W/2, H/2 in px of the image, y down, as libpano's source has them"
# A letter or a name, then a number or "=" and an image; what stands in quotes is a name.
_FIELD = re.compile(r'(?:^|\s)([A-Za-z]{1,3})(?:=(\d{1,6})|([-+.\d][-+.\deE]*))?(?:"([^"]*)")?(?=\s|$)')


def sniff(content: Content) -> Sniff | None:
    """A line of the panorama, and one of an image with a field of view and a lens."""
    if "i w" not in (content.text or ""):
        return None
    panorama = any(line.startswith("p f") for line in content.lines)
    image = next((line for line in content.lines if line.startswith("i w")), None)
    if panorama and image and re.search(r"\sv[=\d]", image) and re.search(r"\sb[-=\d]", image):
        return Sniff(Sure.MAGIC, f"a panorama's line, and that of an image, '{image[:30]}…'")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera that differs, in the order of the images, by the name of its first image."""
    rows = rows_of(data, most=context.at_most(MAX_BYTES))
    images = [_fields(row[1:]) for row in rows if re.match(r"i\s", row)]
    if len(images) > MAX_IMAGES:
        raise ParseError(f"there are over {MAX_IMAGES} images")
    cameras: dict[tuple[float, ...], list[str]] = {}
    for index, fields in enumerate(images):
        numbers = [_number(images, index, key) for key in ("w", "h", "f", *NUMBERS)]
        odd = next((key for key in UNUSED[:2] if _number(images, index, key, 0.0)), None)
        if odd:
            raise UnsupportedModelError(
                f"image {index} is sheared ({odd} is not 0), which no camera is; optimise without it",
            )
        cameras.setdefault(tuple(numbers), []).append(fields.get("n", ("", ""))[1])
    several = len(cameras) > 1
    return [
        _camera(numbers, names, context, f"image {index}" if several else None)
        for index, (numbers, names) in enumerate(cameras.items())
    ]


def _fields(row: str) -> dict[str, tuple[str, str]]:
    """Each field's reference to another image, and its number or name; the first of two counts, as in nona."""
    found: dict[str, tuple[str, str]] = {}
    for name, reference, number, quoted in _FIELD.findall(row):
        found.setdefault(name, (reference, quoted or number))
    return found


def _number(
    images: list[dict[str, tuple[str, str]]], index: int, key: str, default: float | None = None
) -> float:
    place = f"image {index}, {key}"
    reference, text = images[index].get(key, ("", ""))
    if reference:
        if int(reference) >= len(images) or images[int(reference)].get(key, ("", ""))[0]:
            raise ParseError(f"it refers to image {reference}, which has no number of its own", place=place)
        return _number(images, int(reference), key, default)
    if not text and default is not None:
        return default
    return strict.number(text, place=place)


def _camera(
    numbers: tuple[float, ...], names: list[str], context: ReadContext, name: str | None
) -> Calibration:
    width, height, projection, v, a, b, c, d, e = numbers
    size = strict.image_size(width, height, place=name)
    if projection not in (RECTILINEAR, FISHEYE):
        raise UnsupportedModelError(
            f"projection f{projection:g} has no counterpart here, expected f0 (rectilinear) or f3 (fisheye)",
            place=name,
        )
    limit = 180.0 if projection == RECTILINEAR else 360.0
    if not 0 < v < limit:
        raise ParseError(f"the field of view is {v:g}°, expected 0 to {limit:g}", place=name)
    constant = 1 - a - b - c
    if not constant > 0:
        raise ParseError(f"a + b + c is {1 - constant:g}, expected below 1", place=name)
    half = math.radians(v) / 2
    focal = width / 2 / (math.tan(half) if projection == RECTILINEAR else half)
    made = of_radius(
        constant, (c, b, a), focal / (min(size) / 2), is_fisheye=projection == FISHEYE, place=name
    )
    first = names[0].rpartition("/")[2].rpartition("\\")[2]
    item = camera(
        context,
        CONVENTION,
        Native(fx=focal * constant, fy=focal * constant, cx=d, cy=e),
        size,
        made,
        name=f"{name}, {first}" if name else None,
        tag=first or None,
        assumptions=(MIDDLE,),
    )
    return replace(item, grade=Grade.ADJUSTED)


FORMAT = Format(
    name="hugin_pto",
    title="Hugin panorama project (.pto)",
    suffixes=(".pto",),
    syntaxes=(Syntax.TEXT,),
    reference="https://hugin.sourceforge.io/docs/nona/nona.txt",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
