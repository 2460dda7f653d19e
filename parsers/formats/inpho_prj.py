"""The cameras in a project of Inpho (Trimble), as Phase One and others deliver it (``.prj``).

In the format's own words, a block for each camera, among much else::

    $CAMERA                                     or $CAMERA_DEFINITION, with $ID, $ACTIVE_CALIBRATION and
      $TYPE : iXU-RS1000_(50mm)                 several $CALIBRATION_SET … $END
      $DATE : 19:07:49 17/08/2018
      $KIND : CCDFrame
      $CCD_INTERIOR_ORIENTATION :
         217.39     0.00    5798.57             column = a11·x + a12·y + a13, x and y in mm, y up
           0.00  -217.39    4358.13             row    = a21·x + a22·y + a23
      $CCD_COLUMNS : 11608
      $CCD_ROWS : 8708
      $PIXEL_REFERENCE : CenterTopLeft          (0, 0) is the centre of the top-left pixel
      $FOCAL_LENGTH : 51.68                     mm
      $PRINCIPAL_POINT_PPA : 0.0 0.0            mm
      $DISTORTION_TYPE : Polynomial
      $RADIAL_COEFFS : a0 … a7                  per mm; a0 is linear
      $DECENTRE_COEFFS : …
    $END

K follows exactly. The direction and the sign of the polynomial are not published. The possible readings differ by whole
pixels, so the terms are kept unchanged and the distortion is unknown.

Sources: projects that Phase One's and other cameras came with.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from msgspec import Struct, field

from calibrary.calibration import Calibration
from calibrary.distortion import NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._text_rows import rows_of

MAX_BYTES = 12 * 1024 * 1024
"""A project of some ten thousand photos, each of which has its own block."""

BLOCKS = ("$CAMERA", "$CAMERA_DEFINITION")
SET = "$CALIBRATION_SET"
END = "$END"
LENS = ("DISTORTION_TYPE", "RADIAL_COEFFS", "DECENTRE_COEFFS")
PREFIX = "inpho_prj/"

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    remarks=(
        "CCD_INTERIOR_ORIENTATION takes mm, y up, to columns and rows",
        "which way the distortion polynomial maps is not published, so it is kept but not used",
    ),
)
STRAIGHT = 1e-6
"""px over the whole sensor: a rotation this small is rounding."""

NOTE = (
    "the lens terms were kept as written but not used, because Inpho does not publish their direction and sign; "
    "have the images undistorted, or the calibration exported in another format"
)

_ROW = re.compile(r"\$(\w{1,60})\s*:\s*(.*)")


class _Rows(Struct):
    """What stands under each key of a block, lines joined."""

    place: str
    values: dict[str, list[str]] = field(default_factory=dict)

    def text(self, key: str, default: str | None = None) -> str:
        if key not in self.values:
            if default is not None:
                return default
            raise ParseError(f"there is no ${key}", place=self.place)
        return " ".join(self.values[key]).strip()

    def numbers(self, key: str, count: int) -> tuple[float, ...]:
        place = f"{self.place}, ${key}"
        return strict.numbers(self.text(key), count=count, place=place)


def sniff(content: Content) -> Sniff | None:
    """A camera's block, or the project's own first line."""
    if re.match(r"\$PROJECT\b", content.first_line):
        return Sniff(Sure.MAGIC, "the first line is $PROJECT")
    if any(line in BLOCKS for line in content.lines):
        return Sniff(Sure.MAGIC, "there is a $CAMERA")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera, in order."""
    rows = rows_of(data, most=context.at_most(MAX_BYTES))
    cameras = list(_cameras(rows))
    if not cameras:
        raise ParseError(f"there is no {' or '.join(BLOCKS)}")
    several = len(cameras) > 1
    return [_calibration(camera, context, several=several) for camera in cameras]


def _cameras(rows: tuple[str, ...]) -> Iterator[_Rows]:
    """Every camera's keys, those of its active calibration set among them."""
    index = 0
    while index < len(rows):
        if rows[index].strip() in BLOCKS:
            camera, sets, index = _block(rows, index + 1)
            yield _with_active_set(camera, sets)
        else:
            index += 1


def _block(rows: tuple[str, ...], start: int) -> tuple[_Rows, list[_Rows], int]:
    """A camera's own keys, its calibration sets, and the line after its end."""
    camera = current = _Rows(f"line {start}")
    sets: list[_Rows] = []
    key = ""
    for index in range(start, len(rows)):
        line = rows[index].strip()
        if not line:
            continue
        if line == END and current is camera:
            return camera, sets, index + 1
        if line == END:
            current, key = camera, ""
        elif line.startswith(SET):
            current, key = _Rows(f"line {index + 1}"), ""
            sets.append(current)
        elif found := _ROW.fullmatch(line):
            key = found.group(1)
            if key in current.values:
                raise ParseError(f"${key} is a duplicate key", place=f"line {index + 1}")
            current.values[key] = [found.group(2)]
        elif key and not line.startswith("$"):
            current.values[key].append(line)
    raise ParseError(f"there is no {END}", place=camera.place)


def _with_active_set(camera: _Rows, sets: list[_Rows]) -> _Rows:
    if not sets:
        return camera
    active = camera.text("ACTIVE_CALIBRATION", "")
    chosen = [item for item in sets if item.text("ID", "") == active]
    if len(sets) > 1 and len(chosen) != 1:
        raise ParseError(
            f"$ACTIVE_CALIBRATION is {strict.shown(active)}, which is not one of its {len(sets)} calibration sets",
            place=camera.place,
        )
    [used] = chosen or sets
    own = {key: value for key, value in used.values.items() if key != "ID"}
    return _Rows(camera.place, camera.values | own)


def _calibration(camera: _Rows, context: ReadContext, *, several: bool) -> Calibration:
    kind = camera.text("KIND", "CCDFrame")
    if kind != "CCDFrame":
        raise UnsupportedModelError(
            f"the camera's $KIND is {strict.shown(kind)}, expected CCDFrame: a film or line camera has no K of its "
            "own",
            place=camera.place,
        )
    reference = camera.text("PIXEL_REFERENCE")
    if reference != "CenterTopLeft":
        raise UnsupportedModelError(
            f"$PIXEL_REFERENCE is {strict.shown(reference)}; only CenterTopLeft is known", place=camera.place
        )
    columns, rows = camera.numbers("CCD_COLUMNS", 1) + camera.numbers("CCD_ROWS", 1)
    size = context.size(strict.image_size(columns, rows, place=camera.place))
    native = _native(camera, columns)
    name = camera.text("ID", "") or camera.text("TYPE", "") or camera.place
    known = _has_lens(camera)
    return context.calibration(
        CONVENTION.intrinsics(native, size),
        NoDistortion() if known is False else None,
        name=name if several else None,
        tag=name,
        date=camera.text("DATE", ""),
        notes=(NOTE,) if known else (),
        extras=tuple(
            (PREFIX + key, " ".join(camera.text(key).split())) for key in LENS if key in camera.values
        ),
    )


def _native(camera: _Rows, columns: float) -> Native:
    """K's numbers from the affine map of mm to columns and rows."""
    a11, a12, a13, a21, a22, a23 = camera.numbers("CCD_INTERIOR_ORIENTATION", 6)
    [focal] = camera.numbers("FOCAL_LENGTH", 1)
    x, y = camera.numbers("PRINCIPAL_POINT_PPA", 2)
    if not (a11 > 0 and a22 < 0 and abs(a21) * columns <= STRAIGHT * a11):
        raise UnsupportedModelError(
            "$CCD_INTERIOR_ORIENTATION turns or mirrors the image against the camera "
            f"({a11:g} {a12:g} / {a21:g} {a22:g}), which K has no place for; export the project for upright images",
            place=camera.place,
        )
    return Native(
        fx=a11 * focal,
        fy=-a22 * focal,
        cx=a11 * x + a12 * y + a13,
        cy=a21 * x + a22 * y + a23,
        skew=-a12 * focal,
    )


def _has_lens(camera: _Rows) -> bool | None:
    """Whether it has lens terms; None where it says nothing of a lens."""
    terms = [
        strict.numbers(camera.text(key), place=f"{camera.place}, ${key}")
        for key in LENS[1:]
        if key in camera.values
    ]
    if not terms:
        return True if camera.text("DISTORTION_TYPE", "") else None
    return any(any(numbers) for numbers in terms)


FORMAT = Format(
    name="inpho_prj",
    title="Inpho project (.prj)",
    suffixes=(".prj",),
    syntaxes=(Syntax.TEXT,),
    reference="https://geospatial.trimble.com",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    states=("date",),
)
