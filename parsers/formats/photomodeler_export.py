"""PhotoModeler's text export of a project ("Bundle Soln").

In the format's own words, by lines::

    Bundle Soln PhotoModeler Calibration Project
     0.000500 20 5472 3648                      …, iterations, image width and height
     1.00000  0.10000 10.00000 …                …
     8.7602  6.5791  4.3582 13.13280 8.75520 0.00498 -0.00010 0.00000 -0.00006 -0.00004
     0.00000  0.00725 …                         deviations
       0 photos/P8250021.JPG                    then six lines for each photo: its name, its place, the
       0 0.455 1.794 …                          deviations of that, an empty line, its own camera, and the
                                                deviations of that

A camera is F Xp Yp Fw Fh K1 K2 K3 P1 P2. The lens terms have five decimals, which is too few for most K2 and K3: the
status report of the same project has all their digits. A photo's own camera has three decimals less and is used only
where it contradicts the project's.

Sources: the DBAT toolbox' ``loadpm.m``; PhotoModeler help, "Lens distortion formulation".
"""

from __future__ import annotations

from calibrary.calibration import Calibration, ImageSize
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats import _photomodeler
from calibrary.parsers.formats._photomodeler import PARAMETERS
from calibrary.parsers.formats._text_rows import rows_of

MAX_BYTES = 16 * 1024 * 1024
"""Some thirty thousand images."""

TITLE = "Bundle Soln PhotoModeler"
HEAD = 5
PHOTO = 6
"""Lines of the head, and of each photo, its empty one counted."""

ROUNDED = 0.00051
"""How far a photo's own camera, with three decimals, may lie from the same one with four."""

NOTE = (
    "an export contains the lens terms with five decimals only, which is too few for K2 and K3; the status report "
    "of the same project has them all"
)

Camera = tuple[float, ...]
"""The ten parameters, in the file's order."""


def sniff(content: Content) -> Sniff | None:
    """The first line says what it is."""
    if content.first_line.startswith(TITLE):
        return Sniff(Sure.MAGIC, f"the first line begins with '{TITLE}'")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The project's camera, or its photos' cameras where they are not all that one."""
    rows = rows_of(data, most=context.at_most(MAX_BYTES))
    if not rows or not rows[0].strip().startswith(TITLE) or len(rows) < HEAD:
        raise ParseError(f"this is not a head of {HEAD} lines that begins with '{TITLE}'")
    fields = strict.numbers(rows[1], count=4, place="line 2")
    size = context.size(strict.image_size(fields[2], fields[3], place="line 2"))
    project = _camera(rows[3], "line 4")
    photos = _photos(rows)
    if all(_agree(camera, project) for camera in photos):
        return [_calibration(project, size, context, name=None)]
    return [_calibration(camera, size, context, name=name) for camera, name in photos.items()]


def _photos(rows: tuple[str, ...]) -> dict[Camera, str]:
    """Every different camera of the photos, with the name of the first photo that has it."""
    found: dict[Camera, str] = {}
    for start in range(HEAD, len(rows) - PHOTO + 1, PHOTO):
        number, _, name = rows[start].strip().partition(" ")
        # The points follow the photos; theirs is not a line of a number and a name.
        if not number.isdigit() or not name or rows[start + 3].strip():
            break
        camera = _camera(rows[start + 4], f"line {start + 5}", numbered=True)
        found.setdefault(camera, name.strip())
    return found


def _camera(row: str, place: str, *, numbered: bool = False) -> Camera:
    """The ten parameters of a line, behind a photo's number where it has one."""
    values = strict.numbers(row, count=len(PARAMETERS) + numbered, place=place)
    return values[1:] if numbered else values


def _agree(photo: Camera, project: Camera) -> bool:
    return all(abs(a - b) <= ROUNDED for a, b in zip(photo[:3], project[:3], strict=True)) and (
        photo[3:] == project[3:]
    )


def _calibration(camera: Camera, size: ImageSize, context: ReadContext, *, name: str | None) -> Calibration:
    values = dict(zip(PARAMETERS, camera, strict=True))
    intrinsics, distortion = _photomodeler.optics(values, size, source=context.name)
    return context.calibration(intrinsics, distortion, name=name, tag=name, notes=(NOTE,))


FORMAT = Format(
    name="photomodeler_export",
    title="PhotoModeler text export",
    suffixes=(".txt",),
    syntaxes=(Syntax.TEXT,),
    reference="https://github.com/niclasborlin/dbat",
    convention=_photomodeler.CONVENTION,
    sniff=sniff,
    read=read,
)
