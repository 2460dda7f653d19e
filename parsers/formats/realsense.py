"""Intel RealSense: the calibration table of a depth camera, and intrinsics as librealsense names them.

In the formats' own words::

    {"baseline": -50.06,
     "intrinsic_left.x.x": 0.497071, …                                the raw left imager, normalised
     "rectified.0.width": 1920, "rectified.0.height": 1080,
     "rectified.0.fx": 957.2, "rectified.0.fy": 957.2, "rectified.0.ppx": 971.8, "rectified.0.ppy": 527.8, …}

    {"width": 1280, "height": 720, "fx": 638.1, "fy": 638.1, "ppx": 647.9, "ppy": 351.9,
     "model": "Brown Conrady", "coeffs": [0, 0, 0, 0, 0]}              k1 k2 p1 p2 k3

    Intrinsic of "Color" / 1280x720 / {YUYV/RGB8/…}
      Width: 1280   Height: 720   PPX: 641.5   PPY: 363.3   Fx: 911.3   Fy: 910.7                  a line each
      Distortion: Inverse Brown Conrady
      Coeffs: 0.1312  -0.2811  0.0007  -0.0004  0.1203

The first is what the D400 series' tools export. The camera rectifies its images before it hands them out, so
``rectified`` is the camera of those images at each resolution. The second is ``rs2_intrinsics``, alone, in a list, or
several by the names of their streams. The third is what ``rs-enumerate-devices -c`` prints, each stream at each of its
sizes. (0, 0) is the centre of the top-left pixel.

``Inverse Brown Conrady`` is documented to undistort; librealsense once did that in closed form and now inverts the
same polynomial as if it distorted, so files with coefficients other than zero leave it open which is meant.

Source: librealsense, ``rs_types.h``, ``rsutil.h`` and "Projection in RealSense SDK 2.0".
"""

from __future__ import annotations

import re
from codecs import BOM_UTF8
from collections.abc import Callable, Iterator, Sequence

from calibrary.calibration import Calibration, ImageSize
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    FieldOfView,
    InverseBrown,
    KannalaBrandt,
    NoDistortion,
)
from calibrary.errors import InputError, ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node, accounted
from calibrary.parsers.format import Format, Option, ReadContext, Sniff, Sure
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._json_text import loaded
from calibrary.parsers.formats._opencv_lens import lens
from calibrary.parsers.formats._text_rows import rows_of
from calibrary.records import Json

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "p1", "p2", "k3"),
    remarks=("the calibration table's rectified cameras are read, because the images are rectified",),
)
INVERSE = Option(
    name="inverse_brown",
    values=("distorted-to-undistorted", "undistorted-to-distorted"),
    meaning="which way Inverse Brown Conrady maps: as it is documented, or as newer versions of rsutil.h use it",
)
FULL = 5
UNNAMED = "the file names no model, so Brown Conrady was taken, with librealsense's order k1 k2 p1 p2 k3"
SHAPE = frozenset({"ppx", "ppy", "fx", "fy"})

KEYS = {
    "Width": "width", "Height": "height", "PPX": "ppx", "PPY": "ppy", "Fx": "fx", "Fy": "fy", "Distortion": "model",
    "Coeffs": "coeffs",
}  # fmt: skip
"""As they are printed, and the fields that they are of."""
MAX_BYTES = 1024 * 1024

_PRINTED = re.compile(r'Intrinsics? of "([^"]{1,60})" / (\d+x\d+)')
_RECTIFIED = re.compile(r"rectified\.(\d+)\.fx")


def sniff(content: Content) -> Sniff | None:
    """The key rectified.0.fx, an object with fx, fy, ppx, ppy, or a printed stream."""
    if content.syntax is Syntax.TEXT:
        is_printed = "PPX:" in (content.text or "") and any(_PRINTED.match(line) for line in content.lines)
        return Sniff(Sure.MAGIC, "a line Intrinsic of, and PPX") if is_printed else None
    table = next((key for key in content.json_keys if _RECTIFIED.fullmatch(key)), None)
    if table:
        return Sniff(Sure.MAGIC, f"the key {table}")
    if next(_streams(content.json), None) is not None:
        return Sniff(Sure.MAGIC, "an object with the keys fx, fy, ppx and ppy")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The rectified camera at every resolution, or every stream."""
    if not data.removeprefix(BOM_UTF8).lstrip().startswith((b"{", b"[")):
        document = Node(_printed(data, context.name), source=context.name)
    else:
        document = loaded(data, context)
    if isinstance(document.value, dict):
        numbers = [match[1] for key, _ in document.entries() if (match := _RECTIFIED.fullmatch(key))]
        if numbers:
            return _table(document, numbers, context)
    streams = list(_streams(document.value))
    if not streams:
        document.fail("there is neither a rectified.0.fx nor an object with fx, fy, ppx and ppy")
    several = len(streams) > 1
    nodes = [(name, Node(value, source=context.name, place=name or None)) for name, value in streams]
    return [_stream(name if several else None, node, context) for name, node in nodes]


def _streams(value: Json) -> Iterator[tuple[str, Json]]:
    """The objects that are intrinsics, by name: the document itself, its items, or what its keys hold."""
    if isinstance(value, dict) and value.keys() >= SHAPE:
        yield "", value
    elif isinstance(value, dict):
        yield from (
            (key, item) for key, item in value.items() if isinstance(item, dict) and item.keys() >= SHAPE
        )
    elif isinstance(value, list):
        yield from (
            (f"[{index}]", item)
            for index, item in enumerate(value)
            if isinstance(item, dict) and item.keys() >= SHAPE
        )


@accounted
def _printed(data: bytes, source: str) -> dict[str, Json]:
    """The streams that rs-enumerate-devices prints, by name and size, under the keys of rs2_intrinsics."""
    streams: dict[str, Json] = {}
    table: dict[str, Json] = {}
    for row in rows_of(data, source=source, most=MAX_BYTES):
        if heading := _PRINTED.match(row.strip()):
            table = {}
            size = heading[2]
            streams[heading[1] + f" {size}"] = table
        key, mark, value = (part.strip() for part in row.partition(":"))
        if mark and key in KEYS:
            table[KEYS[key]] = [*map(strict.number, value.split())] if key == "Coeffs" else value
        elif not row.strip():
            table = {}
    return {
        name: found for name, found in streams.items() if isinstance(found, dict) and found.keys() >= SHAPE
    }


def _table(document: Node, numbers: Sequence[str], context: ReadContext) -> list[Calibration]:
    """Each resolution that is filled in; with ``image_size`` only that one."""
    found = {number: _rectified_size(document, number) for number in numbers}
    filled = {number: size for number, size in found.items() if size is not None}
    wanted = {number: size for number, size in filled.items() if context.image_size in {None, size}}
    if not wanted:
        sizes = ", ".join(f"{w}×{h}" for w, h in dict.fromkeys(filled.values())) or "none"
        raise InputError(
            f"the table has no rectified camera of the size asked for; its sizes are {sizes}",
            source=context.name,
        )
    notes: tuple[str, ...] = ()
    if "intrinsic_left.x.x" in document:
        notes = (
            "this is the camera of the rectified images; the raw imagers (intrinsic_left, intrinsic_right) are "
            "given in fractions of a size that the table does not state, and are left out",
        )
    return [
        _camera(
            f"rectified {size[0]}x{size[1]}" if len(wanted) > 1 else None,
            _focal(document, f"rectified.{number}."),
            size,
            NoDistortion(),
            context,
            tag=f"rectified.{number}",
            notes=notes,
        )
        for number, size in wanted.items()
    ]


def _rectified_size(document: Node, number: str) -> ImageSize | None:
    width, height = (document[f"rectified.{number}.{side}"].number() for side in ("width", "height"))
    if width == 0 or height == 0:
        return None
    return strict.image_size(width, height, source=document.source, place=f"rectified.{number}")


def _stream(name: str | None, node: Node, context: ReadContext) -> Calibration:
    stated = node.image_size("width", "height") if "width" in node or "height" in node else None
    size = context.size(stated)
    coefficients = node.get("coeffs") or node.get("coefficients")
    values = storage.numbers(coefficients) if coefficients is not None else ()
    model = node.get("model")
    distortion: Distortion | None = None
    notes: tuple[str, ...] = ()
    if model is not None:
        distortion = _distortion(model, values, context)
    elif len(values) == FULL:
        distortion, notes = lens(values), (UNNAMED,)
    return _camera(name, _focal(node, ""), size, distortion, context, tag=node.place, notes=notes)


def _focal(node: Node, prefix: str) -> Native:
    fx, fy, cx, cy = (node[prefix + key].number() for key in ("fx", "fy", "ppx", "ppy"))
    return Native(fx=fx, fy=fy, cx=cx, cy=cy)


def _camera(
    name: str | None,
    native: Native,
    size: ImageSize,
    distortion: Distortion | None,
    context: ReadContext,
    *,
    tag: str | None,
    notes: tuple[str, ...],
) -> Calibration:
    return context.calibration(
        CONVENTION.intrinsics(native, size), distortion, name=name, tag=tag, notes=notes
    )


def _distortion(model: Node, values: tuple[float, ...], context: ReadContext) -> Distortion:
    name = re.sub(r"rs2_distortion_|distortion\.|[^a-z0-9]", "", model.text().lower())
    if name not in LENSES:
        raise UnsupportedModelError(
            f"the model is {strict.shown(model.text())}, which has no counterpart here; "
            f"expected {', '.join(LENSES)}",
            source=model.source,
            place=model.place,
        )
    if not any(values):
        return NoDistortion()
    if len(values) not in {4, 5}:
        raise ParseError(f"{len(values)} coefficients, expected 5", source=model.source, place="coeffs")
    return LENSES[name](values, model, context)


def _none(_values: Sequence[float], model: Node, _context: ReadContext) -> Distortion:
    model.fail("there are coefficients of a model that has none")


def _brown(values: Sequence[float], _model: Node, _context: ReadContext) -> Distortion:
    return lens(values)


def _modified_brown(values: Sequence[float], model: Node, _context: ReadContext) -> Distortion:
    """Tangential terms of the point that is radially distorted already: without them, Brown's model."""
    if values[2] or values[3]:
        raise UnsupportedModelError(
            "Modified Brown Conrady with tangential terms has no counterpart here; ask the camera for rectified "
            "images, or calibrate it from photographs of a board",
            source=model.source,
            place=model.place,
        )
    return lens(values)


def _inverse_brown(values: Sequence[float], model: Node, context: ReadContext) -> Distortion:
    asked = context.option(INVERSE.name)
    if asked is None:
        model.fail(
            "Inverse Brown Conrady is documented to map distorted to undistorted points, newer librealsense inverts "
            "the same polynomial; say which with --set inverse_brown=distorted-to-undistorted or "
            "inverse_brown=undistorted-to-distorted"
        )
    if asked == "undistorted-to-distorted":
        return lens(values)
    brown = BrownConrady(**dict(zip(BrownConrady.names(), values, strict=False)))
    return InverseBrown(k1=brown.k1, k2=brown.k2, p1=brown.p1, p2=brown.p2, k3=brown.k3)


def _fisheye(values: Sequence[float], _model: Node, _context: ReadContext) -> Distortion:
    k1, k2, k3, k4, *_ = values
    return KannalaBrandt(k1=k1, k2=k2, k3=k3, k4=k4)


def _f_theta(values: Sequence[float], _model: Node, _context: ReadContext) -> Distortion:
    return FieldOfView(omega=values[0])


LENSES: dict[str, Callable[[Sequence[float], Node, ReadContext], Distortion]] = {
    "none": _none,
    "brownconrady": _brown,
    "modifiedbrownconrady": _modified_brown,
    "inversebrownconrady": _inverse_brown,
    "kannalabrandt4": _fisheye,
    "ftheta": _f_theta,
}
"""By librealsense's names in lower case without anything between the words."""

FORMAT = Format(
    name="realsense",
    title="Intel RealSense intrinsics",
    suffixes=(".json", ".txt"),
    syntaxes=(Syntax.TEXT, Syntax.JSON),
    reference="https://dev.intelrealsense.com/docs/projection-in-intel-realsense-sdk-20",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    options=(INVERSE,),
)
