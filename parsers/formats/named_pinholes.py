"""ScanNet's ``sceneXXXX_XX.txt`` and Middlebury's ``calib.txt``: pinholes among a scene's numbers, name by name.

In the formats' own words::

    colorHeight = 968                                   ScanNet
    colorWidth = 1296
    fx_color = 1170.187988                              and fx_depth …, depthWidth …
    fy_color = 1170.187988
    mx_color = 647.750000
    my_color = 483.750000

    cam0=[3997.684 0 1176.728; 0 3997.684 1011.728; 0 0 1]      Middlebury 2014 and 2021
    cam1=[3997.684 0 1307.839; 0 3997.684 1011.728; 0 0 1]
    doffs=131.111
    width=2964
    height=1988

Middlebury's images are rectified; ``doffs`` is cx1 − cx0, so that a depth is baseline · f / (disparity + doffs),
wherever cx counts from. ScanNet's colour images have a distortion that this file does not state. Where the principal
points count from is stated by neither.

Sources: ScanNet, ``SensReader`` and README; D. Scharstein et al., "High-resolution stereo datasets", 2014, "Calibration
file format".
"""

from __future__ import annotations

from calibrary.calibration import Calibration, ImageSize
from calibrary.distortion import NoDistortion
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, Tangential
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._one_camera import ORIGIN, camera, chosen_origin, native_of
from calibrary.parsers.formats._text_rows import rows_of
from calibrary.records import replace

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    tangential=Tangential.NONE,
    remarks=("Middlebury's images are rectified", "the origin is not stated"),
)
SCANNET = ("color", "depth")
MIDDLEBURY = ("cam0", "cam1")
MOST = 64 * 1024


def sniff(content: Content) -> Sniff | None:
    """The names of either."""
    if not any(name in (content.text or "") for name in ("fx_color", "doffs")):
        return None
    names = {line.partition("=")[0].strip() for line in content.lines}
    if {"fx_color", "mx_color", "colorWidth"} <= names:
        return Sniff(Sure.MAGIC, "the names fx_color, mx_color and colorWidth of ScanNet")
    if {"cam0", "width", "height"} <= names and "doffs" in names:
        return Sniff(Sure.MAGIC, "the names cam0, doffs, width and height of Middlebury")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """ScanNet's colour and depth camera, or Middlebury's left and right one."""
    values: dict[str, str] = {}
    for row in rows_of(data, most=MOST):
        name, mark, value = (part.strip() for part in row.partition("="))
        if mark and name in values:
            raise ParseError("it is a duplicate key", place=name)
        if mark:
            values[name] = value
    found: list[tuple[str, Native, ImageSize]] = []
    for name in MIDDLEBURY if "cam0" in values else SCANNET:
        if name in values:
            numbers = strict.numbers(values[name].strip("[]").replace(";", " "), count=9, place=name)
            native = native_of(Node(list(numbers), source=context.name, place=name))
            found.append((name, native, _size(values, "width", "height")))
        elif f"fx_{name}" in values:
            fx, fy, cx, cy = (_number(values, f"{key}_{name}") for key in ("fx", "fy", "mx", "my"))
            found.append(
                (name, Native(fx=fx, fy=fy, cx=cx, cy=cy), _size(values, f"{name}Width", f"{name}Height"))
            )
    origin, sentence = chosen_origin(context, CONVENTION.origin)
    convention = replace(CONVENTION, origin=origin)
    lens = NoDistortion() if "cam0" in values else None
    return [
        camera(context, convention, native, size, lens, name=name, assumptions=(sentence,))
        for name, native, size in found
    ]


def _number(values: dict[str, str], name: str) -> float:
    if name not in values:
        raise ParseError(f"there is no {name}")
    return strict.number(values[name], place=name)


def _size(values: dict[str, str], width: str, height: str) -> ImageSize:
    return strict.image_size(_number(values, width), _number(values, height), place=width)


FORMAT = Format(
    name="named_pinholes",
    title="ScanNet scene and Middlebury stereo calibration (.txt)",
    suffixes=(".txt",),
    syntaxes=(Syntax.TEXT,),
    reference="https://vision.middlebury.edu/stereo/data/scenes2014/",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    options=(ORIGIN,),
)
