"""ROS camera calibration, the YAML of ``camera_calibration_parsers`` and of ``rostopic echo``.

In the format's own words::

    image_width: 5472
    image_height: 3648
    camera_name: front
    camera_matrix:
      rows: 3
      cols: 3
      data: [3650.1, 0, 2736.2, 0, 3649.8, 1824.7, 0, 0, 1]
    distortion_model: plumb_bob                                  # rational_polynomial, equidistant
    distortion_coefficients:
      rows: 1
      cols: 5
      data: [-0.0125, 0.0231, -0.0004, 0.0008, -0.0172]          # k1 k2 p1 p2 k3
    rectification_matrix: …                                      # R, of the rectified camera
    projection_matrix: …                                         # P, of the rectified camera

The message itself, as ``rostopic echo`` prints it, has ``width``, ``height`` and K, D, R, P at the top (k, d,
r, p in ROS 2), and as many times as it was sent: equal messages are one camera. Some programs name the lens under
``camera_model``, or write OpenCV's first line above the file. K and D belong to the image as it was taken; P belongs to
the rectified one and is never K.
ROS's own parser refuses a file without R and P; for an unrectified camera they are the identity and [K | 0].

Sources: ``sensor_msgs/CameraInfo.msg``; ROS ``camera_calibration_parsers``, ``parse_yml.cpp``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence

from msgspec import Struct

from calibrary.calibration import Calibration, Intrinsics
from calibrary.distortion import BrownConrady, Distortion, KannalaBrandt, NoDistortion, Rational
from calibrary.errors import UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node, accounted, set_aside
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, WriteContext
from calibrary.parsers.formats._bound_extras import bound, unbound
from calibrary.parsers.formats._json_text import restored
from calibrary.parsers.formats._opencv_lens import COUNTS, lens
from calibrary.parsers.formats._text_rows import text_of
from calibrary.parsers.formats._tree import YAML_TAGS
from calibrary.parsers.formats._yaml_text import flow, scalar
from calibrary.records import Json
from calibrary.strictyaml import load_yaml

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    remarks=("equidistant's four are k1, k2, k3, k4", "K and D are read; R and P are of the rectified image"),
)
FISHEYES = frozenset({"equidistant", "fisheye"})
BY_COUNT = {"plumb_bob": (0, 4, 5), "rational_polynomial": COUNTS}
MODEL_KEYS = ("distortion_model", "camera_model", "lens_model", "lens_type")
"""Of the name of the lens; behind the first, which alone is ROS's, may also stand a word that is no lens."""
BROWNS = 5
MAX_MESSAGES = 1000
PREFIX = "ros_camera_info/"
MAX_BYTES = 256 * 1024


_DIRECTIVE = re.compile(r"\A%YAML[^\n]*\n")
_NEXT = re.compile(r"^---[ \t\r]*$", re.MULTILINE)
"""`rostopic echo` ends every message with the mark that begins the next."""


class Spelling(Struct, frozen=True):
    """What a file and the two generations of messages call the same things."""

    width: str
    height: str
    K: str
    D: str
    R: str
    P: str


SPELLINGS = (
    Spelling(
        "image_width", "image_height", "camera_matrix", "distortion_coefficients",
        "rectification_matrix", "projection_matrix",
    ),
    Spelling("width", "height", "K", "D", "R", "P"),
    Spelling("width", "height", "k", "d", "r", "p"),
)  # fmt: skip


def sniff(content: Content) -> Sniff | None:
    """The key distortion_model beside a K as a file or a message calls it."""
    keys = set(content.yaml_keys)
    for spelled in SPELLINGS:
        if spelled.K not in keys or not {spelled.width, spelled.height} <= keys:
            continue
        present = [key for key in ("distortion_model", spelled.P) if key in keys]
        if present:
            sure = Sure.MAGIC if len(present) == 2 else Sure.SHAPE
            return Sniff(sure, f"the keys {', '.join([spelled.K, *present])}")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The camera of the file, or of every message that differs from the others."""
    tree = _tree(data, context.name)
    if isinstance(tree.value, dict):
        return [_camera(tree, context, None)]
    first: dict[str, Node] = {}
    for message in tree.items():
        told = {key: value for key, value in message.entries() if key != "header"}
        if first.setdefault(repr({key: node.value for key, node in told.items()}), message) is not message:
            set_aside(message.value)
    several = len(first) > 1
    return [_camera(node, context, _frame(node) if several else None) for node in first.values()]


def _frame(message: Node) -> str:
    """The name of the camera of a message among others."""
    header = message.get("header")
    frame = header.get("frame_id") if header is not None else None
    return frame.text() if frame is not None else str(message.place)


def _camera(tree: Node, context: ReadContext, name: str | None) -> Calibration:
    spelled = next((item for item in SPELLINGS if item.K in tree), SPELLINGS[0])
    size = context.size(tree.image_size(spelled.width, spelled.height))
    assumptions: list[str] = []
    notes: list[str] = []
    distortion = _distortion(tree, spelled, notes=notes, assumptions=assumptions)
    intrinsics = CONVENTION.intrinsics(_native(tree[spelled.K]), size)
    if intrinsics.skew:
        notes.append(f"skew of {intrinsics.skew:g} px was kept; ROS's image_geometry does not look at it")
    notes += _partial_frame(tree)
    return context.calibration(
        intrinsics,
        distortion,
        name=name,
        tag=tree.place,
        assumptions=tuple(assumptions),
        notes=tuple(notes),
        extras=tuple(_extras(tree, spelled, intrinsics, distortion)),
    )


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """The layout and the order of ``camera_calibration_parsers``; R and P are the file's own, else trivial."""
    [calibration] = calibrations
    K, distortion = calibration.intrinsics, calibration.distortion or NoDistortion()
    extras = {key.removeprefix(PREFIX): text for key, text in calibration.extras if key.startswith(PREFIX)}
    native = CONVENTION.native(K)
    camera = [native.fx, native.skew, native.cx, 0.0, native.fy, native.cy, 0.0, 0.0, 1.0]
    projection = [native.fx, native.skew, native.cx, 0.0, 0.0, native.fy, native.cy, 0.0, 0.0, 0.0, 1.0, 0.0]
    model, coefficients = _model(distortion)
    called = json.dumps(calibration.camera.sub_camera or calibration.camera.model or "camera")
    name = restored(extras.pop("camera_name", called))
    rows = [
        f"image_width: {K.image_size[0]}",
        f"image_height: {K.image_size[1]}",
        f"camera_name: {scalar(name)}",
        *_matrix("camera_matrix", 3, camera),
        f"distortion_model: {model}",
        *_matrix("distortion_coefficients", 1, coefficients),
    ]
    identity = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    for key, trivial in (("rectification_matrix", identity), ("projection_matrix", projection)):
        kept = unbound(extras.pop(key, ""), K, calibration.distortion)
        rows += _matrix(key, 3, trivial if kept is None else _numbers(kept))
    rows += [f"{scalar(key)}: {scalar(restored(text))}" for key, text in extras.items()]
    return "".join(f"{row}\n" for row in rows).encode()


@accounted
def _tree(data: bytes, source: str) -> Node:
    """The file, or the list of the messages if there are several."""
    text = _DIRECTIVE.sub("\n", text_of(data, source=source, most=MAX_BYTES))
    found: list[Json] = []
    lines = 0
    for part in _NEXT.split(text, MAX_MESSAGES):
        if part.strip():
            found.append(load_yaml("\n" * lines + part, source=source, ignored_tags=YAML_TAGS))
            if not isinstance(found[-1], dict):
                Node(found[-1], source=source).fail("this is not a mapping, as a camera_info is")
        lines += part.count("\n")
    return Node(found[0] if len(found) == 1 else found, source=source)


def _values(node: Node) -> Node:
    """The list itself: messages give it bare, files with rows and cols around it."""
    return node["data"] if isinstance(node.value, dict) else node


def _native(node: Node) -> Native:
    rows = _values(node).matrix(3, 3)
    if rows[0][0] == 0:
        node.fail("K[0] is 0, which is how ROS marks a camera that is not calibrated")
    return Native.of_matrix(rows, place=node.place, source=node.source)


def _distortion(tree: Node, spelled: Spelling, *, notes: list[str], assumptions: list[str]) -> Distortion:
    node = tree[spelled.D]
    values = _values(node).numbers()
    model = _named(tree)
    if not model:
        model = "plumb_bob"
        assumptions.append("the file names no distortion model, so plumb_bob was taken, as ROS does")
    if isinstance(node.value, dict) and (declared := _declared(node)) != len(values):
        notes.append(
            f"the coefficients' header says {declared}, there are {len(values)}, and all were read; "
            "ROS itself would take the first only"
        )
    if model in FISHEYES:
        k1, k2, k3, k4 = _counted(values, (4,), node, model)
        return KannalaBrandt(k1=k1, k2=k2, k3=k3, k4=k4)
    if model not in BY_COUNT:
        raise UnsupportedModelError(
            f"the distortion model is {strict.shown(model)}, which has no counterpart here; "
            f"expected {', '.join((*BY_COUNT, *sorted(FISHEYES)))}",
            source=tree.source,
            place="distortion_model",
        )
    if model == "plumb_bob" and len(values) in COUNTS and not any(values[BROWNS:]):
        values = values[:BROWNS]
    return lens(_counted(values, BY_COUNT[model], node, model))


def _named(tree: Node) -> str:
    """The name of the lens; empty if there is none."""
    for key in MODEL_KEYS:
        word = tree.get(key)
        if word is not None and (key == MODEL_KEYS[0] or word.value in (*FISHEYES, *BY_COUNT)):
            return word.text()
    return ""


def _declared(node: Node) -> int:
    return node["rows"].whole() * node["cols"].whole() if {"rows", "cols"} <= set(node.keys()) else 0


def _counted(values: tuple[float, ...], counts: tuple[int, ...], node: Node, model: str) -> tuple[float, ...]:
    if len(values) not in counts:
        wanted = " or ".join(map(str, counts))
        node.fail(f"{len(values)} coefficients for {model}, expected {wanted}")
    return values


def _partial_frame(tree: Node) -> Iterator[str]:
    """Messages count K in the whole sensor's frame, whatever part of it or binning their images show."""
    bins = [node.whole() for key in ("binning_x", "binning_y") if (node := tree.get(key)) is not None]
    roi = tree.get("roi")
    box = [
        node.whole()
        for key in ("x_offset", "y_offset", "width", "height")
        if roi is not None and (node := roi.get(key)) is not None
    ]
    if any(item > 1 for item in bins) or any(box):
        yield "the camera bins or crops its images; K counts in the whole frame, before that"


def _extras(
    tree: Node, spelled: Spelling, intrinsics: Intrinsics, distortion: Distortion
) -> Iterator[tuple[str, str]]:
    """All other keys, as JSON; R and P under the names that files have."""
    used = {spelled.width, spelled.height, spelled.K, spelled.D, "distortion_model"}
    for key, node in tree.entries():
        if key in (spelled.R, spelled.P):
            name = SPELLINGS[0].R if key == spelled.R else SPELLINGS[0].P
            text = json.dumps(list(_values(node).numbers((9, 12))))
            yield PREFIX + name, bound(text, intrinsics, distortion)
        elif key not in used:
            yield PREFIX + key, json.dumps(node.value, ensure_ascii=False)


def _model(distortion: Distortion) -> tuple[str, list[float]]:
    values = list(distortion.coefficients.values())
    if isinstance(distortion, KannalaBrandt):
        return "equidistant", values
    if isinstance(distortion, Rational):
        return "rational_polynomial", values
    return "plumb_bob", values or [0.0] * 5


def _numbers(text: str) -> list[float]:
    return list(Node(restored(text), source="extras").numbers())


def _matrix(key: str, rows: int, values: Sequence[float]) -> list[str]:
    return [f"{key}:", f"  rows: {rows}", f"  cols: {len(values) // rows}", f"  data: {flow(values)}"]


FORMAT = Format(
    name="ros_camera_info",
    title="ROS camera_info YAML",
    suffixes=(".yaml", ".yml"),
    syntaxes=(Syntax.TEXT,),
    reference="https://wiki.ros.org/camera_calibration_parsers",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(models=(NoDistortion, BrownConrady, Rational, KannalaBrandt)),
)
