"""What is a camera in a tree of names: one K, at most one lens, and an image size, wherever they stand.

A table states what its own keys say (``fx``, ``camera_matrix``, ``dist``, ``resolution``) and what the tables below it
do. Two tables with different K are two cameras, named by their keys; what stands above both, such as a size, is of
both. Keys may tell cameras apart as well: ``K1`` and ``D1``, ``left_camera_matrix``, ``fx_left``. What is said about a
camera, or is of its rectified images, is none of its statements (:data:`ASIDE`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Final

from msgspec import Struct

from calibrary.errors import ParseError
from calibrary.parsers import names
from calibrary.parsers import text as strict
from calibrary.parsers.document import Node
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._tree import OBJECTS
from calibrary.parsers.names import MATRIX, MIRROR, VECTOR, simplified
from calibrary.records import Json, replace

LONGEST = 64
"""Most numbers of a statement; longer lists are of something else."""
MOST_TABLES = 4000
MOST_CAMERAS = 1000
MOST_DEEP = 24
SMALLEST_PX = 10.0
"""A shorter focal length in a matrix without a name is another matrix's number."""
COUNTS: Final = frozenset({4, 5, 8, 12, 14})
OF_K: Final = frozenset({9, 12, 16})
OF_PINHOLE: Final = 4
ASIDE = re.compile(
    "rect(?!ilin).*|new.*|optimal.*|undist.*|initial.*|guess.*|std.*|sigmas?|uncert.*|err|errors?|cov.*|extrin.*|poses?|rvecs?"
    "|tvecs?|rot.*|trans.*|homograph.*|essential.*|fundamental.*|board.*|patterns?|chess.*|corners?|roi|accurac.*|precision"
    "|varian.*|backup|prev.*|old|obj.*points|im.*points"
)
"""Words in keys of what is said about cameras, and of what is not of the images that the camera took."""
FACTS: Final = {
    "pitch": "pixelpitch pixelsize",
    "sensor": "sensor sensorsize sensorwidth",
    "origin": "origin principalpointorigin pixelorigin",
    "y_axis": "yaxis",
    "grade": "grade calibrarygrade",
    "rms": "rms reprojectionerror rmserror avgreprojectionerror ret rmsreprojectionerror",
    "views": "views numberofviews numberofimages nframes nrofframes",
    "points": "points",
    "date": "date calibrationdate calibratedon calibrationtime",
    "tool": "tool software",
    "operator": "operator calibratedby laboratory",
    "focus": "focus",
    "make": "make manufacturer",
    "lens": "lens",
    "firmware": "firmware",
    "sub_camera": "subcamera",
    "capture_mode": "capturemode",
    "name": "camera cameraname",
    "fisheye": "fisheyemodel isfisheye fisheye",
}
"""Other statements of a camera, by their words."""
KINDS: Final = {
    **{word: kind for kind, words in FACTS.items() for word in words.split()},
    **dict.fromkeys(names.ONE_FOCAL, "f"),
    **dict.fromkeys(names.ONE_CENTRE, "c"),
    **{word: kind for pair in names.FOCALS for word, kind in zip(pair, ("fx", "fy"), strict=True)},
    **{word: kind for pair in names.CENTRES for word, kind in zip(pair, ("cx", "cy"), strict=True)},
    **{word: kind for pair in names.SIZE_PAIRS for word, kind in zip(pair, ("width", "height"), strict=True)},
    **dict.fromkeys(names.SIZE_LISTS, "size"),
    **dict.fromkeys(names.SHAPES, "shape"),
    **dict.fromkeys(names.SKEWS, "skew"),
    **dict.fromkeys(names.RADIAL, "radial"),
    **dict.fromkeys(names.TANGENTIAL, "tangential"),
    **dict.fromkeys(names.MODELS, "model"),
    **dict.fromkeys(names.OF_DISTORTION, "distortion model"),
}
OF_TEXT: Final = frozenset({
    "origin", "y_axis", "grade", "date", "tool", "operator", "focus", "make", "lens", "firmware", "sub_camera",
    "capture_mode", "name", "model", "distortion model",
})  # fmt: skip
COUNT: Final = {
    "f": (1, 2),
    "c": (2,),
    "size": (2, 3),
    "shape": (2, 3),
    "sensor": (1, 2),
    "radial": (1, 2, 3, 4, 6),
    "tangential": (2,),
}
"""Numbers of a statement that is not one number."""
AROUND: Final = frozenset({
    "", "calibration", "calibrationdata", "calib", "camera", "cameraparameters", "cameraparams",
    "parameters", "params", "image", "intrinsic", "intrinsics", "cameraintrinsics", "intrinsicparameters",
    "intrinsicparams", "distortion", "cameras", "distortionparameters", "distortionparams", "dist",
    "result", "results", "data", "resolution", "imagesize", "size", "imageresolution", "row",
    "intrinsicscalibration", "calibrations", "lens", "projection", "value", "config", "cameracalibration",
    "calibrationresult", "calibrationresults", "document", "principalpoint", "focallength", "focal",
    "model",
})  # fmt: skip
"""Keys of tables that only put others together, and name no camera."""
OF_ALL: Final = frozenset({"calibration", "calib", "intrinsicparams", "cameraparams", "params"})
"""Of a list of fx fy cx cy, perhaps with the coefficients behind them."""
OF_DATA: Final = frozenset({"data", "values", "params", "parameters", "coefficients", "coeffs"})
OF_AXES: Final = {"f": ("fx", "fy"), "c": ("cx", "cy"), "size": ("width", "height")}
OF_SIZES: Final = frozenset({None, "px", "mm", "um"})
"""Units of an image's sides, or a sensor's; a height in m is the camera's above the ground."""
X, Y = frozenset({"x", "u", "width", "w"}), frozenset({"y", "v", "height", "h"})
SIDES: Final = re.compile(
    r"(left|right|rgb|colou?r|depth|ir|thermal|cam\d{1,2}|camera\d{1,2})?(.+?)(left|right|rgb|colou?r|depth|ir|thermal|cam\d{1,2})?"
)
NUMBER: Final = r"[+-]?(?:\d++\.?+\d*+|\.\d++)(?:[eE][+-]?\d++)?+"
UNITS: Final = {
    "pixel": "px",
    "pixels": "px",
    "px": "px",
    "um": "um",
    "µm": "um",
    "μm": "um",
    "micron": "um",
    "mm": "mm",
}

_TERM = re.compile(
    r"(?:.*(?:dist|distortion|radial|tangential|coeffs?|coefficients?|cam|camera|lens))?(k[1-6]|p[12]|s[1-4]|tau[xy])"
)
_TERMS = re.compile(r"(?<![a-z0-9])(?:k[1-6]|p[12]|s[1-4])(?![a-z0-9])")
_KEY_UNIT = re.compile(
    r"(.*?)[\s_\-]*(?:[\[(]\s*([^\[\]()]{1,20}?)\s*[\])]|(?<=[\s_\-])(px|pixels?|mm|um|µm|μm))", re.IGNORECASE
)
_ALL_NUMBERS = re.compile(rf"[\s\[({{]*+{NUMBER}(?:[\s,;\[\](){{}}]+{NUMBER})*+[\s\])}},;]*+")
_NUMBERS = re.compile(NUMBER)
_LIKE_A_NUMBER = re.compile(r"[+-]?\.?(?:\d|nan\b|inf\b)", re.IGNORECASE)
_DOTTED = re.compile(r"[A-Za-z][\w \-]*(?:[./][A-Za-z][\w \-]*)+")
_WORD = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])")
_WITH_UNIT = re.compile(
    rf"({NUMBER})\s*([^\W\d_]{{1,12}})(?:\s*[x×*]\s*({NUMBER})\s*([^\W\d_]{{1,12}})?)?|({NUMBER})\s*[x×*]\s*({NUMBER})\s*([^\W\d_]{{1,12}})"
)


class Entry(Struct, frozen=True):
    """One statement.

    Attributes:
        kind: what it states: "matrix", "fx", "coefficients", "k1", "size", "model" …
        node: its value and place.
        numbers: its numbers.
        text: its text, or the order of its coefficients.
        unit: of a length.
        depth: tables around it.
        top: the first key of its path.
    """

    kind: str
    node: Node
    numbers: tuple[float, ...] = ()
    text: str = ""
    unit: str | None = None
    depth: int = 0
    top: str = ""


class Part(Struct, frozen=True):
    """What a table states of one camera.

    Attributes:
        path: keys of the table.
        label: what tells the camera from others in the table; empty if nothing does.
        entries: the statements.
    """

    path: tuple[str, ...]
    label: str
    entries: tuple[Entry, ...]

    def all(self, *kinds: str) -> list[Entry]:
        """The statements of these kinds."""
        return [entry for entry in self.entries if entry.kind in kinds]

    @property
    def is_camera(self) -> bool:
        """Whether it states a focal length and a principal point."""
        kinds = {entry.kind for entry in self.entries}
        return "matrix" in kinds or bool(kinds & {"fx", "f"} and (kinds >= {"cx", "cy"} or "c" in kinds))

    @property
    def has_lens(self) -> bool:
        """Whether it states coefficients."""
        return any(entry.kind in OF_LENS for entry in self.entries)

    def numbers_of_k(self) -> tuple[tuple[float, ...], ...]:
        """The numbers of its K, to tell cameras apart."""
        return tuple(
            dict.fromkeys(entry.numbers for entry in self.all("matrix", "fx", "fy", "cx", "cy", "f", "c"))
        )

    def plus(self, other: Part) -> Part:
        """Both together, under this name."""
        return replace(self, entries=(*self.entries, *other.entries))


TERMS: Final = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "taux", "tauy")
"""Coefficients in OpenCV's order."""
OF_LENS: Final = frozenset({*TERMS, "coefficients", "radial", "tangential", "xi"})


def cameras_in(tree: Node) -> list[Part]:
    """The cameras of a tree; by their names, or if no K has a name, by their shape.

    Raises:
        ParseError: there are more tables or cameras than are looked at, or coefficients beside several cameras.
    """
    for by_shape in (False, True):
        found = [part for part in statements_in(tree, by_shape=by_shape) if part.is_camera]
        if found:
            return found
    return []


def statements_in(tree: Node, *, by_shape: bool = False) -> list[Part]:
    """What a tree states of cameras, whether it has their K or not."""
    return _Walk(by_shape=by_shape).parts(tree, (), "")


class _Walk:
    """One walk through a tree."""

    def __init__(self, *, by_shape: bool) -> None:
        self.by_shape = by_shape
        self.tables = 0

    def parts(self, node: Node, path: tuple[str, ...], around: str) -> list[Part]:
        """What a table and those below it state, of one camera or of several."""
        self.tables += 1
        if self.tables > MOST_TABLES:
            raise ParseError(
                f"there are more than {MOST_TABLES} tables; save the cameras to a file of their own",
                source=node.source,
            )
        own: dict[str, list[Entry]] = {}
        inner: list[Part] = []
        for key, child in _nested(node).entries():
            depth, top = len(path), path[0] if path else key
            if _is_aside(key):
                continue
            if (found := _entry(key, child, around, by_shape=self.by_shape)) is not None:
                label, entry = found
                own.setdefault(label, []).append(replace(entry, depth=depth, top=top))
            elif len(path) < MOST_DEEP:
                for name, table in _tables(key, child):
                    inner += self.parts(table, (*path, name), _around(key))
        parts = [Part(path, label, tuple(entries)) for label, entries in own.items()]
        return _joined(path, [*parts, *inner], node)


def _nested(node: Node) -> Node:
    """The table with keys such as ``left.fx`` and ``left/fx`` as keys of tables."""
    table = node.value if isinstance(node.value, dict) else {}
    if not any(_DOTTED.fullmatch(key) for key in table):
        return node
    found: dict[str, Json] = {key: value for key, value in table.items() if not _DOTTED.fullmatch(key)}
    for key in [key for key in table if key not in found]:
        *above, last = key.replace("/", ".").split(".")
        outer = found
        for step in above:
            deeper = outer.get(step, {})
            # A table of the document itself stays as it is.
            outer[step] = inner = dict(deeper) if isinstance(deeper, dict) else {}
            outer = inner
        outer[last] = table[key]
    return replace(node, value=found)


def _tables(key: str, node: Node) -> Iterator[tuple[str, Node]]:
    """The table of a key, or those of a list, by their names there."""
    if isinstance(node.value, dict):
        if "data" not in node.value or not node.value.keys() & {"rows", "sizes", "dt"}:
            yield key, node
    elif isinstance(node.value, list) and node.value and isinstance(node.value[0], dict):
        if len(node.value) > MOST_TABLES:
            node.fail(f"{len(node.value)} items; at most {MOST_TABLES} are looked at")
        for number, item in enumerate(node.items()):
            if isinstance(item.value, dict):
                said = (
                    item.value.get(word)
                    for word in ("name", "camera_name", "label", "camera", "id", "serial")
                )
                name = next((one for one in said if isinstance(one, str) and one), f"{key}[{number}]")
                yield name, item


def _around(key: str) -> str:
    """What the values of a table are of, by its key."""
    simple = simplified(key)
    if VECTOR.fullmatch(simple) or simple in names.OF_DISTORTION:
        return "coefficients"
    if MATRIX.fullmatch(simple):
        return "matrix"
    return {"f": "f", "c": "c", "size": "size"}.get(KINDS.get(simple, ""), "")


def _joined(path: tuple[str, ...], parts: Sequence[Part], node: Node) -> list[Part]:
    """The cameras among what a table states, with what stands beside them; without any, all of it."""
    here = _label(path)
    every = _by_label(parts)
    cameras, rest = [part for part in every if part.is_camera], [part for part in every if not part.is_camera]
    if len(cameras) > MOST_CAMERAS:
        node.fail(f"{len(cameras)} cameras; at most {MOST_CAMERAS} are read")
    if not cameras:
        return [replace(part, label=part.label or here) for part in _together(path, rest)]
    for part in rest:
        for index in _whose(part, cameras):
            cameras[index] = cameras[index].plus(part)
    if len(cameras) == 1:
        return [replace(cameras[0], label=cameras[0].label or here)]
    return cameras


def _by_label(parts: Sequence[Part]) -> list[Part]:
    """The parts of each label as one, unless their K differ."""
    grouped: dict[str, list[Part]] = {}
    for part in parts:
        same = grouped.setdefault(part.label, [])
        first = next((one for one in same if one.is_camera), None)
        is_another = part.is_camera and first is not None and part.path != first.path
        if not same or (is_another and first is not None and part.numbers_of_k() != first.numbers_of_k()):
            same.append(part)
        else:
            same[0] = part.plus(same[0]) if part.is_camera and not same[0].is_camera else same[0].plus(part)
    return [part for group in grouped.values() for part in group]


def _together(path: tuple[str, ...], rest: list[Part]) -> list[Part]:
    """Parts of one camera as one, where none is a camera by itself: fx below one key, cx below another."""
    labels = {part.label for part in rest} - {""}
    whole = Part(path, min(labels, default=""), tuple(entry for part in rest for entry in part.entries))
    if len(rest) > 1 and (len(labels) < 2 or (whole.is_camera and len(whole.numbers_of_k()) <= OF_PINHOLE)):
        return [replace(whole, label=whole.label if len(labels) < 2 else "")]
    return rest


def _whose(part: Part, cameras: Sequence[Part]) -> Sequence[int]:
    """Of which cameras a part is that is none by itself: of those of its label, else of all.

    Raises:
        ParseError: they are coefficients, and nothing says of which camera.
    """
    beside = [index for index, one in enumerate(cameras) if one.label == part.label]
    if not beside and (side := _side(part.label)):
        beside = [index for index, one in enumerate(cameras) if _side(one.label) == side]
    is_of_another = part.has_lens and part.label and part.path == cameras[0].path and not beside
    if len(cameras) == 1 and not is_of_another:
        return [0]
    if part.has_lens and (not part.label or not beside):
        what = "this xi" if part.entries[0].kind == "xi" else "these coefficients"
        part.entries[0].node.fail(f"there is no camera matrix beside {what}")
    return beside if part.label and beside else range(len(cameras))


def _side(label: str) -> str:
    """Which of several cameras a table is of, by its key: color of color_distortion."""
    found = SIDES.fullmatch(simplified(label))
    return (found[1] or found[3] or "") if found and found[2] in AROUND else ""


def _label(path: tuple[str, ...]) -> str:
    """What a table's key says of which camera it is of; nothing where it only puts others together."""
    simple = re.sub(r"\[?\d+\]?$|\d+$", "", simplified(path[-1])) if path else ""
    return "" if simple in AROUND and path and simplified(path[-1]) == simple else path[-1] if path else ""


def _entry(key: str, node: Node, around: str, *, by_shape: bool) -> tuple[str, Entry] | None:
    """The statement of a key, and what it says of which camera it is of; None if it is none that is known."""
    base, key_unit = _without_unit(key)
    simple = simplified(base)
    if MATRIX.fullmatch(simple) or VECTOR.fullmatch(simple):
        _refuse_damaged(node)
    found = _numbers(node.value)
    numbers, unit = found if found is not None else ((), None)
    if found is not None and unit is not None and key_unit not in (None, unit):
        node.fail(f"it is stated in {key_unit} and in {unit}")
    entry = Entry("", node, numbers, unit=unit or key_unit)
    is_word = KINDS.get(simple) in OF_TEXT and isinstance(node.value, str)
    if isinstance(node.value, bool) or is_word or (found is None and isinstance(node.value, str)):
        return _of_text(simple, entry, around)
    if found is None:
        return _empty(simple, entry)
    kind, label = _of_numbers(simple, numbers, around, node)
    if kind == "coefficients":
        entry = replace(entry, text=" ".join(_TERMS.findall(key.lower())))
    if not kind and isinstance(node.value, str) and KINDS.get(simple) in {"fx", "fy", "cx", "cy"}:
        strict.number(node.value, source=node.source, place=node.place)
    if not kind and by_shape:
        kind = _by_shape(simple, numbers, node.value)
    if kind in OF_AXES["size"] and entry.unit not in OF_SIZES:
        return None
    return (label, replace(entry, kind=kind)) if kind else None


def _refuse_damaged(node: Node) -> None:
    """Refuse a matrix or coefficients whose header contradicts its data, or that are Python's objects.

    Raises:
        ParseError: it is one.
    """
    if not isinstance(node.value, dict):
        return
    if OBJECTS in node.value:
        node.fail(
            "it is an array of Python objects, which is not opened because that runs whatever program is in it; "
            "where you trust the file, save the array again as numbers: numpy.array(…, dtype=float)"
        )
    if len(node.value.keys() & {"rows", "cols", "sizes", "dt", "data"}) > 1:
        storage.numbers(node)


def _empty(simple: str, entry: Entry) -> tuple[str, Entry] | None:
    """An empty list of coefficients, which says that there is no distortion."""
    if entry.node.value is None and KINDS.get(simple) in {"fx", "fy", "cx", "cy"}:
        entry.node.number()
    if entry.node.value == [] and (found := VECTOR.fullmatch(simple)):
        return found[1] or found[3] or "", replace(entry, kind="coefficients")
    return None


def _of_text(simple: str, entry: Entry, around: str) -> tuple[str, Entry] | None:
    """A statement in words."""
    value = entry.node.value
    kind = KINDS.get(simple, "")
    if kind == "fisheye":
        return "", replace(entry, kind=kind, text=str(value))
    if kind in {"fx", "fy", "cx", "cy"} and isinstance(value, str) and _LIKE_A_NUMBER.match(value):
        strict.number(value, source=entry.node.source, place=entry.node.place)
    if not isinstance(value, str) or not value:
        return None
    if around == "coefficients" and simple in {"model", "type", "name", "kind"}:
        kind = "distortion model"
    if VECTOR.fullmatch(simple) and (names.family(value) or simple.startswith("dist")):
        kind = "distortion model"
    if kind in OF_TEXT:
        return "", replace(entry, kind=kind, text=value.strip())
    return None


def _of_numbers(simple: str, numbers: tuple[float, ...], around: str, node: Node) -> tuple[str, str]:
    """Kind and label of numbers, by their key."""
    if found := MIRROR.fullmatch(simple):
        return "xi", found[1] or found[3] or ""
    if len(numbers) > 1 or isinstance(node.value, dict | list):
        kind, label = _of_array(simple, numbers, around)
        if kind:
            return kind, label
    elif found := _TERM.fullmatch(simple):
        return found[1], ""
    elif around in OF_AXES and simple in X | Y:
        return OF_AXES[around][simple in Y], ""
    sides = SIDES.fullmatch(simple)
    label = ""
    if simple not in KINDS and sides and (sides[1] or sides[3]) and sides[2] in KINDS:
        simple, label = sides[2], sides[1] or sides[3] or ""
    kind = KINDS.get(simple, "")
    is_known = kind and kind not in OF_TEXT and len(numbers) in COUNT.get(kind, (1,))
    return (kind, label) if is_known else ("", "")


def _of_array(simple: str, numbers: tuple[float, ...], around: str) -> tuple[str, str]:
    """Kind and label of a matrix or a vector, by its key or that of the table around it."""
    count = len(numbers)
    if (found := MATRIX.fullmatch(simple)) and (count in OF_K or (count in {4, 8} and simple != "k")):
        return "matrix", found[1] or found[3] or ""
    if simple in OF_ALL and count in {4, 8, 9} and is_pinhole(numbers):
        return "matrix", ""
    if found := VECTOR.fullmatch(simple):
        return "coefficients", found[1] or found[3] or ""
    if around == "coefficients" and simple in OF_DATA:
        return "coefficients", ""
    is_named_by_table = around in {"matrix", "coefficients"} and count >= OF_PINHOLE and simple not in KINDS
    return (around, simple) if is_named_by_table else ("", "")


def _by_shape(simple: str, numbers: tuple[float, ...], value: Json) -> str:
    """What numbers without a known name are by their shape: a K, or coefficients beside it."""
    if len(numbers) in OF_K and _is_camera_matrix(numbers):
        return "matrix"
    # Names in another script are not known here: a vector of as many numbers beside K is its lens.
    is_unnamed = re.fullmatch(r"(?:arr|array)?\d*", simple.replace("_", "")) or not simple.isascii()
    return "coefficients" if is_unnamed and len(numbers) in COUNTS and isinstance(value, list) else ""


def _is_camera_matrix(numbers: tuple[float, ...]) -> bool:
    """Whether a matrix is a K, or one that is transposed."""
    side = 4 if len(numbers) > 9 else 3
    rows = [numbers[at : at + side] for at in range(0, len(numbers), side)]
    (fx, skew, cx, *_), (below, fy, cy, *_), last = rows[:3]
    if min(fx, fy) < SMALLEST_PX or below or last[2] != 1:
        return False
    return last[:2] == (0, 0) or (skew, cx, cy) == (0, 0, 0)


def is_pinhole(numbers: tuple[float, ...]) -> bool:
    """Whether a list begins with fx fy cx cy."""
    return min(numbers[:4]) > SMALLEST_PX and all(abs(value) < SMALLEST_PX for value in numbers[4:])


@lru_cache(maxsize=4096)
def _without_unit(key: str) -> tuple[str, str | None]:
    """A key and the unit in it; an unknown unit in brackets is kept and refused where it matters."""
    found = _KEY_UNIT.fullmatch(key)
    if not found:
        return key, None
    unit = (found[2] or found[3]).lower()
    if found[2] and unit not in UNITS and (_TERMS.search(unit) or "," in unit):
        return found[1], None
    return found[1], UNITS.get(unit, unit)


@lru_cache(maxsize=4096)
def _is_aside(key: str) -> bool:
    if simplified(key) in KINDS:
        return False
    return any(ASIDE.fullmatch(word.lower()) for word in _WORD.findall(key)) or simplified(key) in {
        "projectionmatrix",
        "imagepoints",
    }


def _numbers(value: Json) -> tuple[tuple[float, ...], str | None] | None:
    """The numbers of a short value of any shape, and the unit behind them; None if it is none."""
    if isinstance(value, bool) or value is None:
        return None
    if isinstance(value, int | float):
        return ((float(value),), None) if abs(value) < 1e300 else None
    if isinstance(value, str):
        return _of_words(value)
    if isinstance(value, dict):
        inner = value.get("data", value.get("value")) if len(value.keys() - OF_ARRAY) == 0 else None
        unit = value.get("unit")
        found = _numbers(inner)
        return found if found is None or not isinstance(unit, str) else (found[0], UNITS.get(unit, unit))
    if not value or len(value) > LONGEST:
        return None
    flat: list[float] = []
    for item in value:
        found = _numbers(item)
        if found is None or isinstance(item, dict):
            return None
        flat += found[0]
    return (tuple(flat), None) if len(flat) <= LONGEST else None


OF_ARRAY: Final = frozenset(
    {"rows", "cols", "dt", "data", "sizes", "type_id", "value", "unit", "layout", "shape", "dtype"}
)


def _of_words(text: str) -> tuple[tuple[float, ...], str | None] | None:
    if len(text) > 2000 or text[:1] not in "0123456789+-.[({ \t\n":
        return None
    if _ALL_NUMBERS.fullmatch(text):
        return tuple(float(number) for number in _NUMBERS.findall(text)), None
    if found := _WITH_UNIT.fullmatch(text.strip()):
        first, second = found[1] or found[5], found[3] or found[6]
        unit = (found[4] or found[2] or found[7] or "").lower()
        if unit in {"x", "by"}:
            return None
        return tuple(float(number) for number in (first, second) if number), UNITS.get(unit, unit)
    if sides := names.sides(text):
        return sides, None
    return None
