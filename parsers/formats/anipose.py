"""Anipose's ``calibration.toml``, which aniposelib, Pose2Sim, FreeMoCap and sleap-anipose share.

In the format's own words::

    [cam_0]
    name = "1"
    size = [ 1920, 1080,]
    matrix = [ [ 1361.8, 0.0, 959.5,], [ 0.0, 1361.8, 539.5,], [ 0.0, 0.0, 1.0,],]
    distortions = [ -0.0154, 0.0, 0.0, 0.0, 0.0,]
    rotation = [ … ]
    translation = [ … ]
    fisheye = true                     # absent or false: OpenCV's own model

    [metadata]
    adjusted = false
    error = 0.633

K and the coefficients are OpenCV's; those of a fisheye are cv2.fisheye's.

Source: aniposelib, ``aniposelib/cameras.py``, ``Camera.get_dict`` and ``FisheyeCamera``.
"""

from __future__ import annotations

import tomllib

from calibrary.calibration import Calibration
from calibrary.errors import ParseError
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._one_camera import camera, fisheye, native_of, opencv_lens, size_of
from calibrary.parsers.formats._text_rows import text_of
from calibrary.parsers.text import shown

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "p1", "p2", "k3"),
    remarks=("a fisheye's four are k1, k2, k3, k4",),
)
MAX_BYTES = 256 * 1024
MAX_CAMERAS = 1000


def sniff(content: Content) -> Sniff | None:
    """A section in brackets, and the keys of a camera under it."""
    if "distortions" not in (content.text or ""):
        return None
    keys = {line.partition("=")[0].strip() for line in content.lines}
    if (
        content.lines
        and {"matrix", "distortions", "size"} <= keys
        and any(line[0] == "[" for line in content.lines)
    ):
        return Sniff(Sure.MAGIC, "TOML with size, matrix and distortions")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera, in the file's order, by its name."""
    text = text_of(data, most=MAX_BYTES)
    try:
        tree = Node(tomllib.loads(text.replace("\r\n", "\n")), source=context.name)
    except (tomllib.TOMLDecodeError, RecursionError, ValueError) as error:
        raise ParseError(f"this is not TOML: {shown(str(error), 80)}") from None
    nodes = [node for _, node in tree.entries() if isinstance(node.value, dict) and "matrix" in node]
    if len(nodes) > MAX_CAMERAS:
        tree.fail(f"{len(nodes)} cameras, expected at most {MAX_CAMERAS}")
    several = len(nodes) > 1
    return [_camera(node, context, several=several) for node in nodes]


def _camera(node: Node, context: ReadContext, *, several: bool) -> Calibration:
    native = native_of(node["matrix"])
    mark = node.get("fisheye")
    lens = (
        fisheye(node["distortions"].numbers(4))
        if mark is not None and mark.value
        else opencv_lens(node["distortions"])
    )
    name = node["name"].text() if "name" in node else node.place or ""
    size = size_of(node["size"]) if "size" in node else None
    return camera(
        context,
        CONVENTION,
        native,
        size,
        lens,
        name=(name or node.place) if several else None,
        tag=node.place,
    )


FORMAT = Format(
    name="anipose",
    title="Anipose calibration (TOML)",
    suffixes=(".toml",),
    syntaxes=(Syntax.TEXT,),
    reference="https://anipose.readthedocs.io/en/latest/",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
