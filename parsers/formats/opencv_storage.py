"""OpenCV calibrations, as ``cv2.FileStorage`` and OpenCV's samples write them: XML, YAML and JSON.

In the format's own words::

    %YAML:1.0
    ---
    calibration_time: "Tue Oct  8 10:53:15 2024"
    image_width: 5472
    image_height: 3648
    camera_matrix: !!opencv-matrix
       rows: 3
       cols: 3
       dt: d
       data: [ 3650.1, 0., 2736.2, 0., 3649.8, 1824.7, 0., 0., 1. ]
    distortion_coefficients: !!opencv-matrix
       rows: 1
       cols: 5
       dt: d
       data: [ -0.0125, 0.0231, -0.0004, 0.0008, -0.0172 ]      # k1 k2 p1 p2 k3
    avg_reprojection_error: 0.31

The container has no schema, so its names are read as all hand-made ones are (``hand_made``). Four coefficients are
k1 k2 p1 p2 under the keys of OpenCV's calibration and stereo samples, unless it says ``fisheye_model: 1``. Up to
OpenCV 4 the first line of YAML is ``%YAML:1.0``. Numbers are plain; text is quoted if the syntax requires.

Sources: OpenCV, ``modules/core/src/persistence_{xml,yml,json}.cpp``; ``samples/cpp/calibration.cpp``,
``samples/cpp/stereo_calib.cpp`` and the camera-calibration tutorial's ``camera_calibration.cpp``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from html import escape

from calibrary.calibration import Calibration, Grade, Intrinsics, Quality
from calibrary.distortion import Distortion, KannalaBrandt, NoDistortion, Unified
from calibrary.errors import UnsupportedModelError
from calibrary.interop.opencv import OPENCV_LENSES
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Origin
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, UnknownLens, WriteContext
from calibrary.parsers.formats import hand_made
from calibrary.parsers.formats._tree import ROOTLESS, tree_of
from calibrary.parsers.formats.hand_made import CONVENTION
from calibrary.parsers.names import MATRIX, simplified
from calibrary.records import Json
from calibrary.strictjson import parse_json

GRADE_KEY = "calibrary_grade"
"""Key added by calibrary, so that a derived K is not read back as a calibrated one."""
FOREIGN_KEYS = frozenset(
    {"calib_time", "camera_model", "distortion_model", "model_type", "projection_matrix", "sensor_type"}
)
"""Keys of programs that use OpenCV's container or its keys with another meaning."""
PREFIX = "opencv_storage/"
METASHAPE = (
    "the spelling of the keys is also that of Metashape's export, which does not document its pixel origin; OpenCV's "
    "was taken"
)
OPENCV, ND_MATRIX = "opencv-matrix", "opencv-nd-matrix"
"""Type marks of matrices; the second of a vector in OpenCV 5, with ``sizes`` in place of rows and cols."""
IN_QUOTES = str.maketrans({'"': "&quot;", "\n": "&#x0a;", "\t": "&#x09;"})
_KEY = re.compile(r"[A-Za-z]|[A-Za-z_][\w.-]+", re.ASCII)


def sniff(content: Content) -> Sniff | None:
    """The container with a camera matrix in it; a program with keys of its own may claim it more strongly."""
    text = content.text or ""
    if content.xml_root is not None:
        is_storage, keys = content.xml_root == "opencv_storage" or ROOTLESS in text, content.xml_tags
    else:
        is_storage, keys = "opencv-matrix" in text, content.json_keys or content.yaml_keys
    if not is_storage or FOREIGN_KEYS.intersection(keys):
        return None
    matrix = next((key for key in keys if MATRIX.fullmatch(simplified(key))), None)
    return Sniff(Sure.SHAPE, f"a matrix is marked opencv-matrix and it contains {matrix}") if matrix else None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera of the file, in the order of their matrices."""
    tree = tree_of(data, source=context.name)
    why = METASHAPE if {"Camera_Matrix", "image_Width"} <= set(tree.keys()) else None
    return hand_made.cameras(tree, context, prefix=PREFIX, origin=Origin.PIXEL_CENTRE, why=why)


def write(calibrations: Sequence[Calibration], context: WriteContext) -> bytes:
    """The tree in the syntax that the name's suffix asks for."""
    return dump(arranged(calibrations, context), context.name)


def arranged(calibrations: Sequence[Calibration], context: WriteContext) -> dict[str, Json]:
    """OpenCV's own keys; matrices come last, so that a file cut short has none."""
    sizes = {item.intrinsics.image_size for item in calibrations}
    if len(sizes) > 1:
        raise UnsupportedModelError(
            "an OpenCV file has one image size, so cameras of several sizes cannot share it"
        )
    fisheyes = {isinstance(item.distortion, KannalaBrandt) for item in calibrations}
    if len(fisheyes) > 1:
        raise UnsupportedModelError(
            "an OpenCV file does not hold fisheyes beside other cameras; write one for each"
        )
    width, height = sizes.pop()
    tree: dict[str, Json] = {"image_width": width, "image_height": height, **_quality(calibrations)}
    worst = max((item.grade for item in calibrations), key=lambda grade: grade.rank)
    if worst is not Grade.CALIBRATED:
        tree[GRADE_KEY] = worst.value
    if fisheyes == {True}:
        tree["fisheye_model"] = 1
    # As in OpenCV's samples the date comes first; theirs is strftime's %c, which differs from place to place.
    dates = {item.provenance.date for item in calibrations}
    made: dict[str, Json] = {"calibration_time": date} if len(dates) == 1 and (date := dates.pop()) else {}
    tree = made | _extras(calibrations, context.name) | tree
    named = list(zip(_labels(calibrations), calibrations, strict=True))
    for label, item in named:
        if item.distortion is not None:
            tree[_key("distortion_coefficients", "D", label)] = _row(_coefficients(item.distortion))
        if isinstance(item.distortion, Unified):
            tree[_key("xi", "xi", label)] = item.distortion.xi
    for label, item in named:
        tree[_key("camera_matrix", "M", label)] = _matrix(item.intrinsics)
    return tree


def _quality(calibrations: Sequence[Calibration]) -> dict[str, Json]:
    """What is known of all cameras alike; the file has room for one error and one number of views."""
    known = {(q.views, q.rms_px) for q in (item.quality or Quality() for item in calibrations)}
    if len(known) != 1:
        return {}
    [(views, rms_px)] = known
    named: dict[str, Json] = {"nframes": views, "avg_reprojection_error": rms_px}
    return {key: value for key, value in named.items() if value is not None}


def _extras(calibrations: Sequence[Calibration], source: str) -> dict[str, Json]:
    """What the files that the cameras came from said besides, as far as OpenCV can read it."""
    extras: dict[str, Json] = {}
    for key, text in (extra for item in calibrations for extra in item.extras):
        if key.startswith(PREFIX):
            value = parse_json(text.encode(), source=source)
            if holds(key.removeprefix(PREFIX), value):
                extras.setdefault(key.removeprefix(PREFIX), value)
    return extras


def _labels(calibrations: Sequence[Calibration]) -> list[str]:
    """What distinguishes the cameras of one file: their names where keys can hold them, else a number."""
    if len(calibrations) == 1:
        return [""]
    names = [item.camera.sub_camera or "" for item in calibrations]
    if len(set(names)) == len(names) and all(re.fullmatch(r"left|right|\d{1,4}", name) for name in names):
        return names
    return [str(number) for number in range(1, len(calibrations) + 1)]


def _key(word: str, letter: str, label: str) -> str:
    """OpenCV's calibration sample spells keys out; its stereo sample numbers M1 D1 M2 D2."""
    if not label:
        return word
    return f"{letter}{label}" if label.isdigit() else f"{word}_{label}"


def _matrix(K: Intrinsics) -> Json:
    native = CONVENTION.native(K)
    data = [native.fx, native.skew, native.cx, 0.0, native.fy, native.cy, 0.0, 0.0, 1.0]
    return {"rows": 3, "cols": 3, "dt": "d", "data": list[Json](data)}


def _coefficients(distortion: Distortion) -> list[float]:
    if isinstance(distortion, NoDistortion):
        return [0.0] * 5
    return [value for name, value in distortion.coefficients.items() if name != "xi"]


def _row(values: list[float]) -> Json:
    return {"rows": 1, "cols": len(values), "dt": "d", "data": list[Json](values)}


def holds(name: str, value: Json) -> bool:
    """Whether all three syntaxes, and OpenCV's parsers of them, accept key and value unchanged."""
    if not _KEY.fullmatch(name) or value is None:
        return False
    if isinstance(value, dict):
        return all(holds(key, item) for key, item in value.items())
    if isinstance(value, list):
        return all(holds(name, item) for item in value)
    return not isinstance(value, str) or value.replace("\n", "").replace("\t", "").isprintable()


def dump(tree: Mapping[str, Json], name: str) -> bytes:
    """Write the tree in the syntax that belongs to the file's suffix, as OpenCV does.

    Raises:
        UnsupportedModelError: the suffix belongs to no syntax.
    """
    suffix = name[name.rfind(".") :].lower() if "." in name else ""
    if suffix not in _WRITERS:
        raise UnsupportedModelError(
            f"the name ends in {strict.shown(suffix)}, which chooses none of OpenCV's syntaxes; "
            f"expected {', '.join(_WRITERS)}",
            source=name,
        )
    return _WRITERS[suffix](tree).encode()


def _mark(value: Json) -> str | None:
    """The type mark that OpenCV writes with a matrix; None for any other value."""
    if not isinstance(value, dict) or "data" not in value:
        return None
    return OPENCV if {"rows", "cols"} <= value.keys() else ND_MATRIX if "sizes" in value else None


def _xml(tree: Mapping[str, Json]) -> str:
    body = "\n".join(_xml_element(key, value) for key, value in tree.items())
    return f'<?xml version="1.0"?>\n<opencv_storage>\n{body}\n</opencv_storage>\n'


def _xml_element(key: str, value: Json, *, of_matrix: bool = False) -> str:
    if isinstance(value, dict):
        mark = _mark(value)
        inner = "".join(
            f"\n  {_xml_element(name, item, of_matrix=bool(mark))}" for name, item in value.items()
        )
        return f'<{key} type_id="{mark}">{inner}</{key}>' if mark else f"<{key}>{inner}</{key}>"
    if isinstance(value, list):
        if of_matrix or (len(value) > 1 and all(isinstance(item, int | float) for item in value)):
            return f"<{key}>\n    {' '.join(_token(item) for item in value)}</{key}>"
        return f"<{key}>{''.join(_xml_element('_', item) for item in value)}</{key}>"
    if isinstance(value, str):
        quoted = escape(value, quote=False).translate(IN_QUOTES)
        return f"<{key}>{quoted}</{key}>" if of_matrix and value.isalpha() else f'<{key}>"{quoted}"</{key}>'
    return f"<{key}>{_token(value)}</{key}>"


def _yaml(tree: Mapping[str, Json]) -> str:
    body = "".join(line for key, value in tree.items() for line in _yaml_lines(key, value, ""))
    return f"%YAML:1.0\n---\n{body}"


def _yaml_lines(key: str, value: Json, indent: str) -> Iterator[str]:
    deeper = indent + "   "
    if isinstance(value, dict):
        mark = _mark(value)
        yield f"{indent}{key}: !!{mark}\n" if mark else f"{indent}{key}:\n"
        for name, item in value.items():
            yield from _yaml_lines(name, item, deeper)
    elif isinstance(value, list) and any(isinstance(item, dict | list) for item in value):
        yield f"{indent}{key}:\n"
        for item in value:
            yield f"{deeper}- {_flow(item)}\n"
    else:
        # OpenCV writes 2f in quotes, and takes it without them for a damaged number.
        is_plain = key == "dt" and str(value).isalpha()
        yield f"{indent}{key}: {value if is_plain else _flow(value, deeper)}\n"


def _flow(value: Json, indent: str = "   ") -> str:
    if isinstance(value, list):
        if not value:
            return "[ ]"
        rows = [
            ", ".join(_flow(item) for item in value[start : start + 4]) for start in range(0, len(value), 4)
        ]
        line_break = f",\n{indent}    "
        return f"[ {line_break.join(rows)} ]"
    if isinstance(value, dict):
        return "{ " + ", ".join(f"{name}: {_flow(item)}" for name, item in value.items()) + " }"
    return _token(value)


def _token(value: Json) -> str:
    """A number with all digits, or text in quotes."""
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, int | float):
        return repr(value)
    return json.dumps(value, ensure_ascii=False)


def _json(tree: Mapping[str, Json]) -> str:
    return (
        json.dumps({key: _typed(value) for key, value in tree.items()}, indent=4, ensure_ascii=False) + "\n"
    )


def _typed(value: Json) -> Json:
    """The tree with OpenCV's type mark on every matrix."""
    if isinstance(value, list):
        return [_typed(item) for item in value]
    if not isinstance(value, dict):
        return value
    mark = _mark(value)
    typed: dict[str, Json] = {"type_id": mark} if mark else {}
    return typed | {key: _typed(item) for key, item in value.items()}


_WRITERS: dict[str, Callable[[Mapping[str, Json]], str]] = {
    ".yml": _yaml,
    ".yaml": _yaml,
    ".xml": _xml,
    ".json": _json,
}

FORMAT = Format(
    name="opencv_storage",
    title="OpenCV calibration (FileStorage XML, YAML, JSON)",
    suffixes=tuple(_WRITERS),
    syntaxes=(Syntax.XML, Syntax.TEXT, Syntax.JSON),
    reference="https://docs.opencv.org/4.x/d9/d0c/group__calib3d.html",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(
        models=(*OPENCV_LENSES, Unified), several_cameras=True, unknown_lens=UnknownLens.STATED
    ),
    states=("date",),
    options=hand_made.FORMAT.options,
)
