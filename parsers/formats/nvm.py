"""VisualSFM's ``.nvm`` (N-View Match): a focal length and one radial coefficient for each image.

In the format's own words::

    NVM_V3 [FixedK fx cx fy cy [r]]

    <number of cameras>
    <file name> <focal length> <quaternion WXYZ> <camera centre> <radial distortion> 0
    …

    (1 + r·(mx² + my²)) · (mx, my) = (X/Z, Y/Z)

(mx, my) is the *measured* point from the principal point, in units of the focal length: the polynomial corrects, so a
barrel has r > 0. COLMAP, which cannot hold that, writes its own k with the sign turned, which is right to first order
only. The principal point is in the middle of the image, except with FixedK, which gives one K to all images. Neither
states the images' size or the origin of FixedK: SiftGPU, which finds VisualSFM's features, counts from the corner.
``NVM_V3_R9T`` has a rotation matrix in place of the quaternion. A quotation mark in a name means a space. The points
and further models after the cameras are not read.

Sources: C. Wu, "VisualSFM: A Visual Structure from Motion System", documentation; Multicore Bundle Adjustment,
``util.h``.
"""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence

from msgspec import Struct

from calibrary.arrays import BoolArray, np
from calibrary.calibration import Calibration, Grade, ImageSize, Quality
from calibrary.distortion import Distortion, InverseBrown, NoDistortion
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Direction, Native, Origin, Tangential
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.on_demand import make_a_camera, on_demand

ROTATIONS = {"NVM_V3": 4, "NVM_V3_R9T": 9}
"""How many numbers a rotation has, by the first word."""
LONGEST_LINE = 10_000
MAX_IMAGES = 1_000_000
CONVENTION = Convention(
    origin=Origin.IMAGE_CENTRE,
    direction=Direction.DISTORTED_TO_UNDISTORTED,
    tangential=Tangential.NONE,
    coefficients=("r",),
    remarks=(
        "one focal length and no principal point, except with FixedK",
        "images with the same numbers are one camera",
    ),
)
FIXED = Convention(origin=Origin.CORNER)
FIXED_NOTE = (
    "VisualSFM does not say from where FixedK counts: it was read as from the corner, as SiftGPU counts"
)


class _Heading(Struct, frozen=True):
    """What the first line says of all images."""

    rotation: int
    fixed: Native | None = None


def sniff(content: Content) -> Sniff | None:
    """The word it begins with."""
    if content.first_line.split(" ")[0] in ROTATIONS:
        return Sniff(Sure.MAGIC, f"the first word is {content.first_line.split(' ')[0]}")
    return None


def read(data: bytes, context: ReadContext) -> Sequence[Calibration]:
    """Every camera that differs, in the order of the images; its name is that of its first image."""
    rows = _rows(data)
    heading = _heading(*next(rows, ("", 1)))
    images: dict[tuple[float, float], list[str]] = {}
    for name, focal, radial in _images(rows, heading):
        # With FixedK the image's own focal length is only a copy of it.
        images.setdefault((0.0 if heading.fixed else focal, radial), []).append(name)
    size = context.size(None)
    found = list(images.items())

    def make(place: int) -> Calibration:
        lens, names = found[place]
        return _calibration(lens, names, heading, size, context, several=len(found) > 1)

    def sure() -> BoolArray:
        lenses = np.array(list(images))
        return make_a_camera(lenses[:, :1], max(size) / 2, lenses, max(size))

    return on_demand(len(found), make, sure)


def _calibration(
    lens: tuple[float, float],
    names: list[str],
    heading: _Heading,
    size: ImageSize,
    context: ReadContext,
    *,
    several: bool,
) -> Calibration:
    f, r = lens
    convention = FIXED if heading.fixed else CONVENTION
    distortion: Distortion = InverseBrown(k1=r, k2=0.0, p1=0.0, p2=0.0) if r else NoDistortion()
    assumptions = () if heading.fixed else ("the principal point is in the middle of the image",)
    return context.calibration(
        convention.intrinsics(heading.fixed or Native(fx=f, fy=f, cx=0.0, cy=0.0), size),
        distortion,
        name=names[0] if several else None,
        tag=names[0],
        assumptions=assumptions,
        grade=Grade.ADJUSTED,
        quality=Quality(views=len(names)),
        notes=(FIXED_NOTE,) if heading.fixed else (),
    )


def _heading(text: str, _index: int) -> _Heading:
    words = text.split()
    rotation = ROTATIONS.get(words[0]) if words else None
    if rotation is None or (len(words) > 1 and words[1] != "FixedK"):
        raise ParseError(
            f"the first line is {strict.shown(text)}, expected {' or '.join(ROTATIONS)}, and FixedK or nothing"
        )
    if len(words) == 1:
        return _Heading(rotation)
    numbers = strict.numbers(" ".join(words[2:]), count=(4, 5), place="FixedK")
    fx, cx, fy, cy = numbers[:4]
    return _Heading(rotation, Native(fx=fx, fy=fy, cx=cx, cy=cy))


def _images(rows: Iterator[tuple[str, int]], heading: _Heading) -> Iterator[tuple[str, float, float]]:
    """Name, focal length and radial coefficient of every image of the first model."""
    text, index = next(rows, ("", 0))
    count = strict.whole(text, place=f"line {index}")
    if not 0 < count <= MAX_IMAGES:
        raise ParseError(f"{count} cameras, expected 1 to {MAX_IMAGES}", place=f"line {index}")
    numbers_each = heading.rotation + 6
    for done in range(count):
        text, index = next(rows, ("", 0))
        parts = text.rsplit(maxsplit=numbers_each)
        if len(parts) != numbers_each + 1:
            raise ParseError(
                f"camera {done + 1} of {count} has {max(len(parts) - 1, 0)} numbers, expected a name and "
                f"{numbers_each}",
                place=f"line {index}",
            )
        numbers = strict.numbers(" ".join(parts[1:]), place=f"line {index}")
        if not numbers[0] > 0:
            raise ParseError(f"the focal length is {numbers[0]:g}, expected more", place=f"line {index}")
        yield parts[0].replace('"', " "), numbers[0], numbers[-2]


def _rows(data: bytes) -> Iterator[tuple[str, int]]:
    """The lines that are not empty, with their numbers."""
    for index, row in enumerate(io.BytesIO(data), start=1):
        if not row.strip():
            continue
        if len(row) > LONGEST_LINE:
            raise ParseError(f"a line of {len(row)} bytes", place=f"line {index}")
        yield strict.decode(row).strip(), index


FORMAT = Format(
    name="nvm",
    title="VisualSFM .nvm",
    suffixes=(".nvm",),
    syntaxes=(Syntax.TEXT,),
    reference="https://ccwu.me/vsfm/doc.html",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    needs_image_size=True,
)
