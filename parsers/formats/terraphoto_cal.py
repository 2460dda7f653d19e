"""TerraPhoto camera calibration (Terrasolid): intrinsics and mounting of a camera in one ``.cal``.

In the format's own words::

    [TerraPhoto calibration]
    Version=20050513
    Description= left camera
    LeverArm= 0.011 -0.016 0.972
    AttitudeCorrections(HRP)= 36.3 0.4 0.0
    PlateSize= 4000 3000
    ImageSize= 4000 3000
    Orientation= TOP
    PrincipalPoint(XoYoZo)= 12.4 -7.1 3650.0
    LensModel= Function
    LensA3= …   LensA5= …   LensA7= …   LensR0= …

in any order of lines. The principal point is where the focal point lies against the middle of the image, in the unit of
PlateSize, for which pixels are recommended: |Zo| is the focal length. The documentation states neither the direction of
y nor the meaning of the lens terms. The terms are kept unchanged, and the distortion is unknown.

Source: Terrasolid, "TerraPhoto User Guide", Camera calibration file format.
"""

from __future__ import annotations

from calibrary.calibration import Calibration, ImageSize, Origin
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Tangential, YAxis
from calibrary.parsers.format import Format, Option, ReadContext, Sniff, Sure
from calibrary.parsers.formats._text_rows import text_of
from calibrary.records import replace

HEADING = "[TerraPhoto calibration]"
CONVENTION = Convention(
    origin=Origin.IMAGE_CENTRE,
    tangential=Tangential.NONE,
    remarks=(
        "the focal length is |Zo|",
        "the lens terms are kept unconverted: their formula is not published",
    ),
)
Y_AXIS = Option(
    name="y_axis", values=("down", "up"), meaning="which way Yo of the principal point grows in the image"
)
PRINCIPAL_POINT = "PrincipalPoint(XoYoZo)"
PREFIX = "terraphoto_cal/"
MAX_BYTES = 64 * 1024
UNCONVERTED = (
    "the lens terms ({}) are kept as written and marked unconverted: Terrasolid does not publish their "
    "formula, so the distortion is unknown"
)


def sniff(content: Content) -> Sniff | None:
    """The first line is the same in every file."""
    if content.first_line == HEADING:
        return Sniff(Sure.MAGIC, f"the first line is {HEADING}")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """K of the one camera; its lens terms go to ``extras``."""
    values = _values(data)
    _refuse_panoramas(values)
    size = context.size(_image_size(values))
    _check_plate(values, size)
    if PRINCIPAL_POINT not in values:
        raise ParseError(f"there is no {PRINCIPAL_POINT}, which contains the focal length")
    x, y, z = strict.numbers(values[PRINCIPAL_POINT], count=3, place=PRINCIPAL_POINT)
    native = Native(fx=abs(z), fy=abs(z), cx=x, cy=y)
    convention = replace(CONVENTION, y_axis=_y_axis(y, context))
    lens = [
        key for key, text in values.items() if key.startswith("LensA") and any(c in text for c in "123456789")
    ]
    return [
        context.calibration(
            convention.intrinsics(native, size),
            None,
            assumptions=("the size of the plate is in pixels, so the principal point is too",),
            notes=(UNCONVERTED.format(", ".join(lens)),) if lens else (),
            extras=tuple(
                (PREFIX + ("unconverted/" if key.startswith("Lens") else "") + key, text)
                for key, text in values.items()
                if key not in {"ImageSize", "PlateSize", PRINCIPAL_POINT}
            ),
        )
    ]


def _values(data: bytes) -> dict[str, str]:
    text = text_of(data, most=MAX_BYTES)
    rows = [row.strip() for row in strict.lines(text)]
    if not rows or rows[0] != HEADING:
        raise ParseError(f"the first line is not {HEADING}")
    values: dict[str, str] = {}
    for index, row in enumerate(rows[1:], start=2):
        if not row:
            continue
        key, mark, value = row.partition("=")
        key = key.replace(" ", "")
        if not mark or not key:
            raise ParseError(f"{strict.shown(row)} is not Key= value", place=f"line {index}")
        if key in values:
            raise ParseError(f"{strict.shown(key)} is a duplicate key", place=f"line {index}")
        values[key] = value.strip()
    return values


def _refuse_panoramas(values: dict[str, str]) -> None:
    text = values.get("Panoramic", "0")
    if strict.number(text, place="Panoramic"):
        raise UnsupportedModelError(
            "the images are panoramas, each pixel an angle, and no K describes them; use the images of the "
            "single cameras and their own calibrations",
            place="Panoramic",
        )


def _image_size(values: dict[str, str]) -> ImageSize | None:
    if "ImageSize" not in values:
        return None
    width, height = strict.numbers(values["ImageSize"], count=2, place="ImageSize")
    return strict.image_size(width, height, place="ImageSize")


def _check_plate(values: dict[str, str], size: ImageSize) -> None:
    """Another unit than pixels may be meant where the plate is not the image."""
    if "PlateSize" not in values:
        raise ParseError(
            "there is no PlateSize, which says the unit of the principal point; add PlateSize= with the image "
            "size if that is in pixels"
        )
    plate = strict.numbers(values["PlateSize"], count=2, place="PlateSize")
    if plate != size:
        raise UnsupportedModelError(
            f"the plate is {plate[0]:g}×{plate[1]:g} and the image {size[0]}×{size[1]}, so the principal point is "
            "not in pixels of the image; save the calibration in TerraPhoto with a plate of the image's size",
            place="PlateSize",
        )


def _y_axis(y: float, context: ReadContext) -> YAxis:
    asked = context.option(Y_AXIS.name)
    if y and asked is None:
        raise ParseError(
            f"Yo is {y:g}, and the format does not say whether y grows up or down; say it with "
            "--set y_axis=up or y_axis=down",
            place=PRINCIPAL_POINT,
        )
    return YAxis.UP if asked == "up" else YAxis.DOWN


FORMAT = Format(
    name="terraphoto_cal",
    title="TerraPhoto camera calibration",
    suffixes=(".cal",),
    syntaxes=(Syntax.TEXT,),
    reference="https://terrasolid.com/guides/tphoto/devcameracalibrationfileformat.html",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    options=(Y_AXIS,),
)
