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
from dataclasses import dataclass

from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize, Quality
from calibrary.distortion import BrownConrady, Distortion, NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure

__all__ = ["FORMAT"]

HEADING = (
    "fileName imageWidth imageHeight",
    "camera matrix K [3x3]",
    "radial distortion [3x1]",
    "tangential distortion [2x1]",
    "camera position t [3x1]",
    "camera rotation R [3x3]",
    "camera model m = K [R|-Rt] X",
)
ROWS = (3, 3, 3, 3, 2, 3, 3, 3, 3)
"""How many numbers stand on the lines after an image's name: K, radial, tangential, t, R."""

CONVENTION = Convention(
    origin=Origin.CORNER,
    coefficients=("k1", "k2", "k3", "p1", "p2"),
    remarks=("images that share a camera give it once",),
)


@dataclass(frozen=True, slots=True)
class _Camera:
    """What an image's ten lines say of its camera."""

    size: ImageSize
    native: Native
    distortion: Distortion


def sniff(content: Content) -> Sniff | None:
    """The heading's first line is nobody else's."""
    if content.first_line == HEADING[0]:
        return Sniff(Sure.MAGIC, f"the first line is '{HEADING[0]}'")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every different camera, in the order of the images."""
    images: dict[_Camera, list[str]] = {}
    for name, camera in _images(data, context.name):
        images.setdefault(camera, []).append(name)
    if not images:
        raise ParseError("there is no image after the heading", source=context.name)
    several = len(images) > 1
    return [
        Calibration(
            camera=CameraKey(image_size=camera.size, sub_camera=names[0] if several else None),
            intrinsics=CONVENTION.intrinsics(camera.native, context.size(camera.size), source=context.name),
            distortion=camera.distortion,
            grade=Grade.ADJUSTED,
            quality=Quality(views=len(names)),
            provenance=context.provenance(tag=names[0]),
        )
        for camera, names in images.items()
    ]


def _images(data: bytes, source: str) -> Iterator[tuple[str, _Camera]]:
    """Every image's name and camera."""
    rows = strict.lines(strict.decode(data, source=source), source=source)
    heading = tuple(row.strip() for row in rows[: len(HEADING)])
    if heading != HEADING:
        odd = next(row for row in (*heading, "an end") if row not in HEADING)
        raise UnsupportedModelError(
            f"its heading has {strict.shown(odd)} where a perspective camera's has {', '.join(HEADING)}; "
            "export the project as OPF instead",
            source=source,
        )
    filled = [(index, row) for index, row in enumerate(rows, start=1) if row.strip()][len(HEADING) :]
    for start in range(0, len(filled), 1 + len(ROWS)):
        block = filled[start : start + 1 + len(ROWS)]
        index, title = block[0]
        if len(block) <= len(ROWS):
            raise ParseError(
                f"{len(block)} lines of an image, wanted {1 + len(ROWS)}; the file is cut short",
                source=source,
                place=f"line {index}",
            )
        numbers = [
            strict.numbers(row, count=count, source=source, place=f"line {at}")
            for (at, row), count in zip(block[1:], ROWS, strict=True)
        ]
        yield _image(title, numbers, source=source, place=f"line {index}")


def _image(title: str, numbers: list[tuple[float, ...]], *, source: str, place: str) -> tuple[str, _Camera]:
    """An image's name, which may hold spaces, and its camera."""
    parts = title.rsplit(maxsplit=2)
    if len(parts) != 3:
        raise ParseError(
            f"{strict.shown(title)} is no file name with a width and a height", source=source, place=place
        )
    width, height = (strict.number(side, source=source, place=place) for side in parts[1:])
    (fx, skew, cx), (zero, fy, cy), bottom = numbers[:3]
    if zero or bottom != (0.0, 0.0, 1.0):
        raise ParseError("the three lines after it are no camera matrix", source=source, place=place)
    (k1, k2, k3), (p1, p2) = numbers[3:5]
    straight = not any((k1, k2, k3, p1, p2))
    return parts[0].strip(), _Camera(
        size=strict.image_size(width, height, source=source, place=place),
        native=Native(fx=fx, fy=fy, cx=cx, cy=cy, skew=skew),
        distortion=NoDistortion() if straight else BrownConrady(k1=k1, k2=k2, p1=p1, p2=p2, k3=k3),
    )


FORMAT = Format(
    name="pix4d_camera_parameters",
    title="Pix4D calibrated camera parameters",
    suffixes=(".txt",),
    reference="https://support.pix4d.com/hc/en-us/articles/202559089",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
