"""Pix4D's ``*_calibrated_camera_parameters.txt``: the camera of every image of a project.

In the format's own words, a heading, an empty line, and then ten lines for each image::

    fileName imageWidth imageHeight
    camera matrix K [3x3]
    radial distortion [3x1]
    tangential distortion [2x1]
    camera position t [3x1]
    camera rotation R [3x3]
    camera model m = K [R|-Rt] X

K is in pixels from the outer corner of the top-left one. The radial and tangential coefficients are OpenCV's
k1 k2 k3 and p1 p2. Images of one camera share their K: it is given once, and where the project calibrated
several, each by the name of the first image that has it. Positions and rotations are left out.

Source: Pix4D support, "How are the internal and external camera parameters defined?".
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice

from msgspec import Struct

from calibrary.calibration import Calibration, Grade, ImageSize, Quality
from calibrary.distortion import BrownConrady, Distortion, NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._text_rows import rows_of

MAX_BYTES = 16 * 1024 * 1024
"""Some thirty thousand images."""

HEADING = (
    "fileName imageWidth imageHeight",
    "camera matrix K [3x3]",
    "radial distortion [3x1]",
    "tangential distortion [2x1]",
    "camera position t [3x1]",
    "camera rotation R [3x3]",
    "camera model m = K [R|-Rt] X",
)
CAMERA_ROWS = (3, 3, 3, 3, 2)
"""How many numbers stand on the lines after an image's name: K, radial, tangential."""
IMAGE_ROWS = 10
"""Of an image: its name, its camera, its position and its rotation."""

CONVENTION = Convention(
    origin=Origin.CORNER,
    coefficients=("k1", "k2", "k3", "p1", "p2"),
    remarks=("images that share a camera give it once",),
)


class _Camera(Struct, frozen=True):
    """What an image's ten lines say of its camera."""

    size: ImageSize
    native: Native
    distortion: Distortion


def sniff(content: Content) -> Sniff | None:
    """The heading's first line is in no other format."""
    if content.first_line == HEADING[0]:
        return Sniff(Sure.MAGIC, f"the first line is '{HEADING[0]}'")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every different camera, in the order of the images."""
    images: dict[_Camera, list[str]] = {}
    for name, camera in _images(data):
        images.setdefault(camera, []).append(name)
    if not images:
        raise ParseError("there is no image after the heading")
    several = len(images) > 1
    return [
        context.calibration(
            CONVENTION.intrinsics(camera.native, context.size(camera.size)),
            camera.distortion,
            name=names[0] if several else None,
            tag=names[0],
            grade=Grade.ADJUSTED,
            quality=Quality(views=len(names)),
        )
        for camera, names in images.items()
    ]


def _images(data: bytes) -> Iterator[tuple[str, _Camera]]:
    """Every image's name and camera; what is written alike is looked at once."""
    rows = rows_of(data, most=MAX_BYTES)
    heading = tuple(row.strip() for row in rows[: len(HEADING)])
    if heading != HEADING:
        odd = next((row for row in heading if row not in HEADING), "nothing")
        raise UnsupportedModelError(
            f"its heading has {strict.shown(odd)} where a perspective camera's has {', '.join(HEADING)}; "
            "export the project as OPF instead"
        )
    numbered = ((index, row) for index, row in enumerate(rows, start=1) if row.strip())
    filled = islice(numbered, len(HEADING), None)
    known: dict[tuple[str, ...], _Camera] = {}
    while block := list(islice(filled, IMAGE_ROWS)):
        index = block[0][0]
        if len(block) < IMAGE_ROWS:
            raise ParseError(
                f"{len(block)} lines of an image, expected {IMAGE_ROWS}; the file is cut short",
                place=f"line {index}",
            )
        name, *size = block[0][1].rsplit(maxsplit=2)
        if len(size) != 2:
            raise ParseError(
                f"{strict.shown(name)} is not a file name with a width and a height", place=f"line {index}"
            )
        own = (*size, *(row for _, row in block[1 : 1 + len(CAMERA_ROWS)]))
        if own not in known:
            known[own] = _camera(own, first_line=index)
        yield name.strip(), known[own]


def _camera(own: tuple[str, ...], *, first_line: int) -> _Camera:
    """The camera of an image: its width, its height, and the lines of K and of the lens."""
    place = f"line {first_line}"
    width, height = (strict.number(side, place=place) for side in own[:2])
    numbers = [
        strict.numbers(row, count=count, place=f"line {first_line + offset}")
        for offset, (row, count) in enumerate(zip(own[2:], CAMERA_ROWS, strict=True), start=1)
    ]
    *matrix, (k1, k2, k3), (p1, p2) = numbers
    straight = not any((k1, k2, k3, p1, p2))
    return _Camera(
        size=strict.image_size(width, height, place=place),
        native=Native.of_matrix(matrix, place=place),
        distortion=NoDistortion() if straight else BrownConrady(k1=k1, k2=k2, p1=p1, p2=p2, k3=k3),
    )


FORMAT = Format(
    name="pix4d_camera_parameters",
    title="Pix4D calibrated camera parameters",
    suffixes=(".txt",),
    syntaxes=(Syntax.TEXT,),
    reference="https://support.pix4d.com/hc/en-us/articles/202559089",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
