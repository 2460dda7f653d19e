"""ORB-SLAM's settings, versions 2 and 3: a camera among the program's own numbers.

In the format's own words::

    %YAML:1.0
    File.version: "1.0"
    Camera.type: "PinHole"           # KannalaBrandt8, Rectified
    Camera1.fx: 458.6                # version 2 and older files of 3: Camera.fx, …
    Camera1.fy: 457.3
    Camera1.cx: 367.2
    Camera1.cy: 248.4
    Camera1.k1: -0.28                # k1, k2, p1, p2 and perhaps k3; KannalaBrandt8: k1, k2, k3, k4
    …
    Camera.width: 752
    Camera.height: 480
    Camera.newWidth: 600             # the program resizes; the numbers above are of the size before

A second fisheye is ``Camera2.``. In older stereo settings ``Camera.`` is the rectified camera, and the two as they
were taken follow as matrices, ``LEFT.K``, ``LEFT.D``, ``RIGHT.K``, ``RIGHT.D``. Older files lack the image size.
The text is OpenCV's YAML, which takes ``Viewer.PointSize:2`` without a space for a key and its value.

Source: ORB_SLAM3, ``Examples/*/*.yaml``, ``src/Settings.cc`` and "Calibration_Tutorial.pdf".
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from calibrary.calibration import Calibration, ImageSize
from calibrary.distortion import Distortion, KannalaBrandt, NoDistortion
from calibrary.errors import UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._opencv_lens import COUNTS, lens
from calibrary.parsers.formats._text_rows import text_of

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    remarks=("coefficients are named; KannalaBrandt8's four are k1, k2, k3, k4",),
)
TYPES = ("PinHole", "KannalaBrandt8", "Rectified")
CAMERAS = ("Camera", "Camera1", "Camera2")
MAX_BYTES = 1024 * 1024
SIDES = ("LEFT", "RIGHT")

_TIGHT = re.compile(r"^([ \t]*+[A-Za-z_][\w.]*+):(?=[^\s:])", re.MULTILINE)
_SETTING = re.compile(r"^([A-Za-z_][\w.]*+):[ \t]++([^\s#][^#\n]*+).*$", re.MULTILINE)


def sniff(content: Content) -> Sniff | None:
    """The key Camera.fx or Camera1.fx; OpenVSLAM, which has Camera.model as well, is another format."""
    if "Camera.model" in content.yaml_keys:
        return None
    found = next((key for key in content.yaml_keys if key in {"Camera.fx", "Camera1.fx"}), None)
    return Sniff(Sure.MAGIC, f"the key {found}") if found else None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera of the settings, in the file's order of generations: Camera, Camera1, Camera2, LEFT, RIGHT."""
    text = text_of(data, most=MAX_BYTES)
    # OpenCV needs no space after the colon; the directive's own colon stays.
    tree = storage.load(_said_once(_TIGHT.sub(r"\1: ", text)).encode(), source=context.name)
    named = [name for name in CAMERAS if f"{name}.fx" in tree]
    sides = [name for name in SIDES if f"{name}.K" in tree]
    if not named:
        tree.fail("there is neither a Camera.fx nor a Camera1.fx")
    several = len(named) + len(sides) > 1
    cameras = [_camera(name, tree, context, several=several) for name in named]
    return cameras + [_side(name, tree, context) for name in sides]


def _said_once(text: str) -> str:
    """Without keys that occur again with the same value, as settings put together by hand have them."""
    said: set[tuple[str, str]] = set()

    def kept(line: re.Match[str]) -> str:
        pair = line[1], line[2].strip()
        if pair in said:
            return ""
        said.add(pair)
        return line[0]

    return _SETTING.sub(kept, text)


def _camera(name: str, tree: Node, context: ReadContext, *, several: bool) -> Calibration:
    distortion = _distortion(name, tree)
    size = context.size(_size(tree, "Camera"))
    fx, fy, cx, cy = (tree[f"{name}.{key}"].number() for key in ("fx", "fy", "cx", "cy"))
    return context.calibration(
        CONVENTION.intrinsics(Native(fx=fx, fy=fy, cx=cx, cy=cy), size),
        distortion,
        name=name if several else None,
        tag=f"{name}.fx",
        notes=tuple(_notes(name, tree)),
    )


def _side(name: str, tree: Node, context: ReadContext) -> Calibration:
    """One of the two cameras of older stereo settings, before rectification."""
    size = context.size(_size(tree, name) or _size(tree, "Camera"))
    matrix = tree[f"{name}.K"]
    native = Native.of_matrix(storage.matrix(matrix, 3, 3), place=matrix.place, source=matrix.source)
    values = storage.numbers(tree[f"{name}.D"])
    if len(values) not in COUNTS:
        tree[f"{name}.D"].fail(f"{len(values)} coefficients, expected {', '.join(map(str, COUNTS))}")
    return context.calibration(CONVENTION.intrinsics(native, size), lens(values), name=name, tag=f"{name}.K")


def _size(tree: Node, name: str) -> ImageSize | None:
    if f"{name}.width" not in tree and f"{name}.height" not in tree:
        return None
    return tree.image_size(f"{name}.width", f"{name}.height")


def _distortion(name: str, tree: Node) -> Distortion:
    kind = tree["Camera.type"].text() if "Camera.type" in tree else TYPES[0]
    if kind not in TYPES:
        raise UnsupportedModelError(
            f"the camera type is {strict.shown(kind)}, which has no counterpart here; expected {', '.join(TYPES)}",
            source=tree.source,
            place="Camera.type",
        )
    if kind == "Rectified":
        return NoDistortion()
    if kind == "KannalaBrandt8":
        return KannalaBrandt(**{key: tree[f"{name}.{key}"].number() for key in KannalaBrandt.names()})
    keys = [f"{name}.{key}" for key in ("k1", "k2", "p1", "p2")]
    if not any(key in tree for key in keys):
        return NoDistortion()
    k3 = tree.get(f"{name}.k3")
    return lens([*(tree[key].number() for key in keys), *([k3.number()] if k3 is not None else [])])


def _notes(name: str, tree: Node) -> Iterator[str]:
    if "Camera.newWidth" in tree or "Camera.newHeight" in tree:
        yield "ORB-SLAM resizes the images before it uses them; K is of the size before"
    if name == "Camera" and "LEFT.K" in tree:
        yield "Camera is the rectified camera of the stereo pair; LEFT and RIGHT are the images as they were taken"


FORMAT = Format(
    name="orb_slam",
    title="ORB-SLAM2/3 settings",
    suffixes=(".yaml",),
    syntaxes=(Syntax.TEXT,),
    reference="https://github.com/UZ-SLAMLab/ORB_SLAM3",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    idle=("Camera.k1", "Camera.k2", "Camera.k3", "Camera.k4", "Camera.p1", "Camera.p2"),
)
