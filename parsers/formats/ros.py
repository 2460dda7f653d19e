"""ROS camera calibrations, of ``camera_calibration_parsers``: YAML and INI."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence

from msgspec import Struct, field

from calibrary.calibration import Calibration, ImageSize, Intrinsics
from calibrary.distortion import BrownConrady, Distortion, KannalaBrandt, NoDistortion, Rational
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node, accounted, set_aside
from calibrary.parsers.format import Capacity, Format, Option, ReadContext, Sniff, Sure, WriteContext
from calibrary.parsers.formats._bound_extras import bound, unbound
from calibrary.parsers.formats._json_text import restored
from calibrary.parsers.formats._lenses import COUNTS, lens
from calibrary.parsers.formats._table import rest_of
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
IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
BROWNS = 5
MAX_MESSAGES = 1000
YAML_PREFIX = "ros_camera_info/"
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


def sniff_yaml(content: Content) -> Sniff | None:
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


def read_yaml(data: bytes, context: ReadContext) -> list[Calibration]:
    """The camera of the file, or of every message that differs from the others."""
    tree = _tree(data, context.name)
    if isinstance(tree.value, dict):
        return [_camera_yaml(tree, context, None)]
    first: dict[str, Node] = {}
    for message in tree.items():
        told = {key: value for key, value in message.entries() if key != "header"}
        if first.setdefault(repr({key: node.value for key, node in told.items()}), message) is not message:
            set_aside(message.value)
    several = len(first) > 1
    return [_camera_yaml(node, context, _frame(node) if several else None) for node in first.values()]


def _frame(message: Node) -> str:
    """The name of the camera of a message among others."""
    header = message.get("header")
    frame = header.get("frame_id") if header is not None else None
    return frame.text() if frame is not None else str(message.place)


def _camera_yaml(tree: Node, context: ReadContext, name: str | None) -> Calibration:
    spelled = next((item for item in SPELLINGS if item.K in tree), SPELLINGS[0])
    size = context.size(tree.image_size(spelled.width, spelled.height))
    assumptions: list[str] = []
    notes: list[str] = []
    distortion = _distortion_yaml(tree, spelled, notes=notes, assumptions=assumptions)
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


def write_yaml(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """The layout and the order of ``camera_calibration_parsers``; R and P are the file's own, else trivial."""
    [item] = calibrations
    extras = rest_of(item, YAML_PREFIX)
    K, D, R, P = _vectors(item, extras.pop("rectification_matrix", ""), extras.pop("projection_matrix", ""))
    called = json.dumps(item.camera.sub_camera or item.camera.model or "camera")
    rows = [
        f"image_width: {item.intrinsics.image_size[0]}",
        f"image_height: {item.intrinsics.image_size[1]}",
        f"camera_name: {scalar(restored(extras.pop('camera_name', called)))}",
        *_matrix("camera_matrix", 3, K),
        f"distortion_model: {_model(item.distortion)}",
        *_matrix("distortion_coefficients", 1, D),
        *_matrix("rectification_matrix", 3, R),
        *_matrix("projection_matrix", 3, P),
    ]
    rows += [f"{scalar(key)}: {scalar(restored(text))}" for key, text in extras.items()]
    return "".join(f"{row}\n" for row in rows).encode()


def _model(lens: Distortion | None) -> str:
    if isinstance(lens, KannalaBrandt):
        return "equidistant"
    return "rational_polynomial" if isinstance(lens, Rational) else "plumb_bob"


def _vectors(item: Calibration, R: str, P: str) -> tuple[Sequence[float], ...]:
    """K, D, R and P; R and P are the file's own if K is still the same, else those of an unrectified camera."""
    K, lens = CONVENTION.native(item.intrinsics), item.distortion or NoDistortion()
    rows = ((K.fx, K.skew, K.cx), (0.0, K.fy, K.cy), (0.0, 0.0, 1.0))
    trivial = (IDENTITY, tuple(number for row in rows for number in (*row, 0.0)))
    kept = (unbound(text, item.intrinsics, item.distortion) for text in (R, P))
    own = (
        usual if text is None else strict.numbers(text.strip("[]").replace(",", " "))
        for text, usual in zip(kept, trivial, strict=True)
    )
    return sum(rows, ()), tuple(lens.coefficients.values()) or (0.0,) * 5, *own


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


def _distortion_yaml(
    tree: Node, spelled: Spelling, *, notes: list[str], assumptions: list[str]
) -> Distortion:
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
            yield YAML_PREFIX + name, bound(text, intrinsics, distortion)
        elif key not in used:
            yield YAML_PREFIX + key, json.dumps(node.value, ensure_ascii=False)


def _matrix(key: str, rows: int, values: Sequence[float]) -> list[str]:
    return [f"{key}:", f"  rows: {rows}", f"  cols: {len(values) // rows}", f"  data: {flow(values)}"]


CAMERA_INFO = Format(
    name="ros_camera_info",
    title="ROS camera_info YAML",
    words="""\
ROS camera calibration, the YAML of ``camera_calibration_parsers`` and of ``rostopic echo``.

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
""",
    suffixes=(".yaml", ".yml"),
    syntaxes=(Syntax.TEXT,),
    reference="https://wiki.ros.org/camera_calibration_parsers",
    convention=CONVENTION,
    sniff=sniff_yaml,
    read=read_yaml,
    write=write_yaml,
    capacity=Capacity(models=(NoDistortion, BrownConrady, Rational, KannalaBrandt)),
)


DISTORTION = Option(
    name="distortion",
    values=("brown", "fisheye"),
    meaning="whether four coefficients are plumb_bob's k1 k2 p1 p2 or equidistant's k1 k2 k3 k4",
)
INI_PREFIX = "ros_ini/"
LABELS = {
    "width": (1,), "height": (1,), "translation": (3,), "rotation": (3,), "camera matrix": (9,),
    "distortion": COUNTS[1:], "rectification": (9,), "projection": (12,),
}  # fmt: skip

HEADING = "# oST version"
_PRINTED = re.compile(r"\s*(?:\(?['\"]?(?:self\.)?[DKRPT] ?=|None\s*$|(?:Left|Right):\s*$|\*{4})")
_SECTION = re.compile(r"\[\s*([^\[\]]*?)\s*\]")


class Section(Struct, frozen=True):
    """One camera's blocks of numbers by their labels, and its name."""

    name: str
    blocks: dict[str, tuple[float, ...]] = field(default_factory=dict)


def sniff_ini(content: Content) -> Sniff | None:
    """The section [image] and the line "camera matrix"."""
    if "[image]" in content.lines and "camera matrix" in content.lines:
        return Sniff(Sure.MAGIC, "the section [image] and the line 'camera matrix'")
    return None


def read_ini(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera of the file, in order, each in the size that the [image] before it says."""
    sections = list(_sections(text_of(data, most=MAX_BYTES)))
    cameras = list(_cameras(sections))
    several = len(cameras) > 1
    return [_camera_ini(section, size, context, several=several) for section, size in cameras]


def write_ini(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """The layout and the order that ROS's parsers take, with all digits."""
    [item] = calibrations
    extras = rest_of(item, INI_PREFIX)
    K, D, R, P = _vectors(item, extras.get("rectification", ""), extras.get("projection", ""))
    externals = [
        row
        for label in ("translation", "rotation")
        if label in extras
        for row in _block(label, strict.numbers(extras[label]), 1)
    ]
    name = extras.get("camera_name") or item.camera.sub_camera or "camera"
    width, height = item.intrinsics.image_size
    rows = ["# oST version 5.0 parameters", "", "[image]", "", "width", str(width), ""]
    rows += ["height", str(height), "", *(["[externals]", "", *externals] if externals else [])]
    rows += [f"[{re.sub(r'[^!-~]|[][#;]', '_', name)}]", "", *_block("camera matrix", K, 3)]
    rows += [*_block("distortion", D, 1), *_block("rectification", R, 3), *_block("projection", P, 3)]
    return ("\n".join(rows) + "\n").encode()


def _sections(text: str) -> Iterator[Section]:
    section: Section | None = None
    label, numbers = "", list[float]()
    for number, line in enumerate([*_lines(text), "[end]"], start=1):
        place = f"line {number}"
        found = _SECTION.search(line)
        if found or line in LABELS:
            if section is not None and label:
                _keep(section, label, tuple(numbers))
            label, numbers = ("", []) if found else (line, [])
            if found:
                if section is not None:
                    yield section
                section = Section(found[1])
            elif section is None:
                raise ParseError("it is in no section", place=place)
        elif line:
            if not label:
                raise ParseError(f"{strict.shown(line)}, expected one of {', '.join(LABELS)}", place=place)
            numbers += strict.numbers(line, place=place)


def _lines(text: str) -> Iterator[str]:
    """Without comments.

    The calibrator prints D, K, R and P as Python lists before each camera, and people paste that along.
    """
    heading, mark, rest = text.partition(HEADING)
    if mark and "[image]" not in heading:
        text = mark + rest
    for line in strict.lines(text):
        yield "" if _PRINTED.match(line) else re.split("[#;]", line, maxsplit=1)[0].strip()


def _keep(section: Section, label: str, numbers: tuple[float, ...]) -> None:
    if label in section.blocks:
        raise ParseError("it is a duplicate key in one section", place=label)
    if len(numbers) not in LABELS[label]:
        wanted = " or ".join(map(str, LABELS[label]))
        raise ParseError(f"{len(numbers)} numbers, expected {wanted}", place=label)
    section.blocks[label] = numbers


def _cameras(sections: Sequence[Section]) -> Iterator[tuple[Section, ImageSize]]:
    """The sections that are cameras, each with the image size and the externals that come before it."""
    size: ImageSize | None = None
    externals: dict[str, tuple[float, ...]] = {}
    for section in sections:
        if section.name == "image":
            width, height = (_needed(section, label)[0] for label in ("width", "height"))
            size, externals = strict.image_size(width, height, place="image"), {}
        elif section.name == "externals":
            externals = section.blocks
        else:
            if size is None:
                raise ParseError("there is no [image] before it", place=section.name)
            yield Section(section.name, externals | section.blocks), size


def _needed(section: Section, label: str) -> tuple[float, ...]:
    if label not in section.blocks:
        raise ParseError(f"there is no {label!r}", place=section.name)
    return section.blocks[label]


def _camera_ini(section: Section, size: ImageSize, context: ReadContext, *, several: bool) -> Calibration:
    matrix = _needed(section, "camera matrix")
    native = Native.of_matrix((matrix[:3], matrix[3:6], matrix[6:]), place="camera matrix")
    intrinsics = CONVENTION.intrinsics(native, context.size(size))
    distortion = _distortion_ini(_needed(section, "distortion"), context)
    extras = [(INI_PREFIX + "camera_name", section.name)]
    for label in ("translation", "rotation", "rectification", "projection"):
        if label in section.blocks:
            text = " ".join(map(repr, section.blocks[label]))
            is_bound = label in {"rectification", "projection"}
            extras.append((INI_PREFIX + label, bound(text, intrinsics, distortion) if is_bound else text))
    note = f"skew of {native.skew:g} px was kept; ROS's image_geometry does not look at it"
    return context.calibration(
        intrinsics,
        distortion,
        name=section.name if several else None,
        tag=section.name,
        notes=(note,) if native.skew else (),
        extras=tuple(extras),
    )


def _distortion_ini(values: tuple[float, ...], context: ReadContext) -> Distortion:
    asked = context.option(DISTORTION.name)
    if asked == "fisheye":
        if len(values) != 4:
            raise ParseError(f"{len(values)} coefficients of a fisheye, expected 4", place="distortion")
        return KannalaBrandt(**dict(zip(KannalaBrandt.names(), values, strict=True)))
    if len(values) == 4 and any(values) and asked is None:
        raise ParseError(
            "four coefficients are plumb_bob's k1 k2 p1 p2 or equidistant's k1 k2 k3 k4, and the file does "
            "not state which; say so with --set distortion=brown or distortion=fisheye",
            place="distortion",
        )
    return lens(values)


def _block(label: str, values: Sequence[float], rows: int) -> Iterator[str]:
    yield label
    columns = len(values) // rows
    for start in range(0, len(values), columns):
        yield " ".join(map(repr, values[start : start + columns]))
    yield ""


INI = Format(
    name="ros_ini",
    title="ROS camera calibration INI (ost.txt)",
    words="""\
ROS camera calibration, the INI of ``camera_calibration_parsers``: Videre's, and the calibrator's ``ost.txt``.

In the format's own words::

    # oST version 5.0 parameters
    [image]

    width
    5472

    height
    3648

    [front]

    camera matrix
    3650.1 0 2736.2
    0 3649.8 1824.7
    0 0 1

    distortion
    -0.0125 0.0231 -0.0004 0.0008 -0.0172          k1 k2 p1 p2 k3, in rational_polynomial k4 k5 k6 as well

    rectification
    …
    projection
    …

No key names the distortion model; the count of coefficients does, and four leave it open. A calibrator of two
cameras writes one such text after the other. ROS 2 writes plumb_bob alone in this syntax and five decimals
of it.

Source: ROS ``camera_calibration_parsers``, ``parse_ini.cpp``; ``camera_calibration``, ``calibrator.py``.
""",
    suffixes=(".ini", ".txt"),
    syntaxes=(Syntax.TEXT,),
    reference="https://wiki.ros.org/camera_calibration_parsers",
    convention=CONVENTION,
    sniff=sniff_ini,
    read=read_ini,
    write=write_ini,
    capacity=Capacity(models=(NoDistortion, BrownConrady, Rational)),
    options=(DISTORTION,),
)

FORMATS = (
    CAMERA_INFO,
    INI,
)
