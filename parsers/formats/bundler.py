"""Bundler's ``bundle.out``: a focal length and two radial coefficients for each image.

In the format's own words::

    # Bundle file v0.3
    <num_cameras> <num_points>
    <f> <k1> <k2>
    <R>    (three lines of three numbers)
    <t>    (one line)
    …

    P = R·X + t        p = −P / P.z        p' = f·(1 + k1·|p|² + k2·|p|⁴)·p

p' counts in pixels from the middle of the image with y up, and the camera looks along −z. The minus sign cancels both,
so neither affects the lens. An image that could not be placed has f = 0. Neither the size of the images nor their names
are in the file; a ``list.txt`` beside it has the names.

Source: N. Snavely, "Bundler v0.4 User's Manual".
"""

from __future__ import annotations

import codecs
import io
from collections.abc import Iterable, Sequence
from itertools import islice

from calibrary.arrays import BoolArray, FloatArray, np
from calibrary.calibration import Calibration, Grade, ImageSize, Quality
from calibrary.distortion import BrownConrady, Distortion, NoDistortion
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, Tangential, YAxis
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.on_demand import make_a_camera, on_demand

MARK = b"# Bundle file v"
VERSIONS = ("0.3", "0.4")
LIST = "list.txt"
LINES = 5
"""Of each camera: its lens, three of rotation and one of translation, with three numbers each."""
LONGEST_LINE = 10_000
MAX_IMAGES = 1_000_000
CONVENTION = Convention(
    origin=Origin.IMAGE_CENTRE,
    y_axis=YAxis.UP,
    tangential=Tangential.NONE,
    coefficients=("k1", "k2"),
    remarks=("one focal length and no principal point", "images with the same numbers are one camera"),
)


def sniff(content: Content) -> Sniff | None:
    """The comment it begins with."""
    if content.first_line.startswith(MARK.decode()):
        return Sniff(Sure.MAGIC, "the first line is '# Bundle file v…'")
    return None


def read(data: bytes, context: ReadContext) -> Sequence[Calibration]:
    """Every camera that differs, in the order of the images; its name is that of its first image."""
    numbers = _images(data, context.name)
    images: dict[tuple[float, float, float], list[int]] = {}
    for index, (f, k1, k2) in enumerate(numbers.tolist()):
        if f:
            images.setdefault((f, k1, k2), []).append(index)
    if not images:
        raise ParseError("no image of it was placed, so it contains no camera", source=context.name)
    names = _names(context, len(numbers))
    size = context.size(None)
    found = list(images.items())

    def make(place: int) -> Calibration:
        lens, members = found[place]
        return _calibration(lens, [names[index] for index in members], size, context, several=len(found) > 1)

    def sure() -> BoolArray:
        lenses = np.array(list(images))
        return make_a_camera(lenses[:, :1], max(size) / 2, lenses, max(size))

    return on_demand(len(found), make, sure)


def _calibration(
    numbers: tuple[float, float, float],
    names: list[str],
    size: ImageSize,
    context: ReadContext,
    *,
    several: bool,
) -> Calibration:
    f, k1, k2 = numbers
    distortion: Distortion = NoDistortion()
    if k1 or k2:
        distortion = BrownConrady(k1=k1, k2=k2, p1=0.0, p2=0.0)
    return context.calibration(
        CONVENTION.intrinsics(Native(fx=f, fy=f, cx=0.0, cy=0.0), size, source=context.name),
        distortion,
        name=names[0] if several else None,
        tag=names[0],
        assumptions=("the principal point is in the middle of the image",),
        grade=Grade.ADJUSTED,
        quality=Quality(views=len(names)),
    )


def _images(data: bytes, source: str) -> FloatArray:
    """f, k1 and k2 of every image, (N, 3); what follows them, the points, is not looked at."""
    rows = io.BytesIO(data.removeprefix(codecs.BOM_UTF8))
    first = rows.readline()
    version = first.removeprefix(MARK).strip().decode("ascii", "replace")
    if not first.startswith(MARK) or version not in VERSIONS:
        raise ParseError(
            f"it begins with {strict.shown(first[:60].decode('latin-1').strip())}, expected "
            f"'{MARK.decode()}' and one of {', '.join(VERSIONS)}",
            source=source,
        )
    [[cameras, _points]] = _table(rows, 1, 2, first_line=2, source=source).tolist()
    if not (cameras == int(cameras) and 0 < cameras <= MAX_IMAGES):
        raise ParseError(f"{cameras:g} cameras, expected 1 to {MAX_IMAGES}", source=source, place="line 2")
    numbers = _table(rows, LINES * int(cameras), 3, first_line=3, source=source)[::LINES]
    if (shortest := numbers[:, 0].min()) < 0:
        raise ParseError(f"a focal length is {shortest:g}, expected at least 0", source=source)
    return numbers


def _table(rows: Iterable[bytes], count: int, columns: int, *, first_line: int, source: str) -> FloatArray:
    """The next lines, with so many numbers each."""
    taken = list(islice(rows, count))
    if len(taken) < count or not taken[-1].endswith(b"\n"):
        raise ParseError("the file ends before its last camera does", source=source)
    for index, row in enumerate(taken, start=first_line):
        if len(row) > LONGEST_LINE:
            raise ParseError(f"a line of {len(row)} bytes", source=source, place=f"line {index}")
    text = strict.decode(b"".join(taken), source=source)
    return strict.table(strict.lines(text), columns, first_line=first_line, source=source)


def _names(context: ReadContext, count: int) -> list[str]:
    """The images' names out of the list beside the file, where it has as many; else their numbers."""
    numbered = [f"image {index}" for index in range(count)]
    listed = context.companion(LIST)
    if listed is None:
        return numbered
    rows = [row.split() for row in strict.decode(listed, source=LIST).splitlines()]
    names = [row[0] for row in rows if row]
    return names if len(names) == count else numbered


FORMAT = Format(
    name="bundler",
    title="Bundler bundle.out",
    suffixes=(".out",),
    syntaxes=(Syntax.TEXT,),
    reference="https://www.cs.cornell.edu/~snavely/bundler/bundler-v0.4-manual.html",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    needs_image_size=True,
)
