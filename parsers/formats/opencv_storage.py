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

The container has no schema: programs name things as they like, so the keys of OpenCV's samples and the usual variations
of them are known (``parsers.names``), below one other key as well (``_by_shape``), with "left", "right" or a number
for one of several cameras. The number of
coefficients determines the model, as far as OpenCV's documentation states it: 5 Brown–Conrady, 8 rational, 12 thin
prism, 14 tilted. Four are k1 k2 p1 p2 under the keys of OpenCV's calibration sample (unless it says ``fisheye_model:
1``); under other keys nothing distinguishes them from a fisheye's k1 k2 k3 k4. With ``xi`` beside them they are k1 k2
p1 p2 of ``cv2.omnidir``, Mei's model, whose focal lengths are (1 + xi) times those of the pinhole near the axis.

Sources: OpenCV, "Camera Calibration and 3D Reconstruction"; ``samples/cpp/calibration.cpp``,
``samples/cpp/stereo_calib.cpp`` and the camera-calibration tutorial's ``camera_calibration.cpp``; opencv_contrib,
``modules/ccalib/src/omnidir.cpp``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Sequence

from calibrary.calibration import Calibration, Grade, ImageSize, Intrinsics, Quality
from calibrary.distortion import (
    Distortion,
    KannalaBrandt,
    NoDistortion,
    Unified,
)
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.interop.opencv import OPENCV_LENSES, OPENCV_MODELS
from calibrary.parsers import names
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import (
    Capacity,
    Format,
    Option,
    ReadContext,
    Sniff,
    Sure,
    UnknownLens,
    WriteContext,
)
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._by_shape import AROUND, is_fisheye, shaped
from calibrary.parsers.names import MATRIX, MIRROR, VECTOR, simplified
from calibrary.records import Json
from calibrary.strictjson import parse_json

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y"),
    remarks=(
        "cv2.fisheye's four are k1, k2, k3, k4",
        "with xi of cv2.omnidir, K has the file's focal lengths, (1 + xi) times those of the pinhole near the axis",
    ),
)
DISTORTION = Option(
    name="distortion",
    values=("brown", "fisheye"),
    meaning="whether four coefficients are Brown's k1 k2 p1 p2 or cv2.fisheye's k1 k2 k3 k4",
)

OWN_KEYS = frozenset({("cameramatrix", "distortioncoefficients"), ("m", "d")})
"""Keys of OpenCV's calibration and stereo samples; their coefficients are Brown's unless stated otherwise."""
GRADE_KEY = "calibrary_grade"
"""Key added by calibrary, so that a derived K is not read back as a calibrated one."""
FOREIGN_KEYS = frozenset(
    {"calib_time", "camera_model", "distortion_model", "model_type", "projection_matrix", "sensor_type"}
)
"""Keys of programs that use OpenCV's container or its keys with another meaning."""
METASHAPE_SPELLING = frozenset({"Camera_Matrix", "image_Width"})

PREFIX = "opencv_storage/"
_KEY_BELOW = re.compile(r"^[ \t]{1,20}(?:- )?([A-Za-z][\w.\-]{0,40}):", re.MULTILINE)


class Keys:
    """The keys of a file with their meanings; each key is used only once."""

    def __init__(self, tree: Node) -> None:
        self.tree = tree
        self.matrices: dict[str, str] = {}
        self.coefficients: dict[str, str] = {}
        self.mirrors: dict[str, str] = {}
        self.simple: dict[str, str] = {}
        for key, node in tree.entries():
            self.simple.setdefault(simplified(key), key)
            for pattern, found in self._kinds(node):
                match = pattern.fullmatch(simplified(key))
                if match:
                    label = match[1] or match[3] or ""
                    if label in found:
                        node.fail(
                            f"it means the same as {strict.shown(found[label])}, which is stated as well"
                        )
                    found[label] = key
        self.used = {*self.matrices.values(), *self.coefficients.values(), *self.mirrors.values()}

    def _kinds(self, node: Node) -> Iterator[tuple[re.Pattern[str], dict[str, str]]]:
        """Possible meanings of an entry according to its value; omnidir's xi is a number, or a 1×1 matrix."""
        yield MIRROR, self.mirrors
        if isinstance(node.value, dict | list):
            yield MATRIX, self.matrices
            yield VECTOR, self.coefficients

    def take(self, simple: str) -> Node | None:
        """The value of a key that has a single meaning in the whole file."""
        key = self.simple.get(simple)
        if key is None:
            return None
        self.used.add(key)
        return self.tree[key]

    def size(self) -> ImageSize | None:
        """The image size of the file."""
        for width, height in names.SIZE_PAIRS:
            if width in self.simple and height in self.simple:
                sides = [self.take(name) for name in (width, height)]
                w, h = (side.number() for side in sides if side is not None)
                return strict.image_size(w, h, source=self.tree.source)
        both = next((node for name in names.SIZE_LISTS if (node := self._pair(name)) is not None), None)
        if both is not None:
            return strict.image_size(*storage.numbers(both), source=both.source, place=both.place)
        shape = next((node for name in names.SHAPES if (node := self._pair(name, (2, 3))) is not None), None)
        return None if shape is None else self._of_shape(shape)

    def _pair(self, name: str, lengths: tuple[int, ...] = (2,)) -> Node | None:
        """The value of a key if it is a list of so many numbers; that of an image size must be two."""
        value = self.tree[self.simple[name]] if name in self.simple else None
        if value is None or not isinstance(value.value, dict | list):
            return None
        numbers = storage.numbers(value)
        if len(numbers) in lengths:
            return self.take(name)
        if name in names.SIZE_LISTS[:2]:
            value.fail(f"{len(numbers)} numbers, expected width and height")
        return None

    def _of_shape(self, node: Node) -> ImageSize:
        """Width and height out of numpy's rows and columns, or the other way round where K says so.

        Raises:
            ParseError: the principal point does not tell which is the width.
        """
        rows, columns = storage.numbers(node)[:2]
        centres = [storage.numbers(self.tree[key]) for key in self.matrices.values()]
        near = [
            sum(abs(K[2] - w / 2) + abs(K[5] - h / 2) for K in centres if len(K) == 9)
            for w, h in ((columns, rows), (rows, columns))
        ]
        if rows != columns and not near[0] * 2 < near[1]:
            if not near[1] * 2 < near[0]:
                node.fail(
                    "rows and columns, or width and height: K does not tell which; give --image-size WxH"
                )
            rows, columns = columns, rows
        return strict.image_size(columns, rows, source=node.source, place=node.place)

    def quality(self) -> Quality | None:
        """The RMS reprojection error and the number of views, as OpenCV's samples write them."""
        rms = self.take("avgreprojectionerror") or self._root_mean_square()
        views = self.take("nframes") or self.take("nrofframes")
        if rms is None and views is None:
            return None
        for node in (rms, views):
            if node is not None and node.number() < 0:
                node.fail(f"{node.number():g} is less than nothing, expected a number from 0")
        return Quality(
            rms_px=rms.number() if rms is not None else None,
            views=views.whole() if views is not None else None,
        )

    def _root_mean_square(self) -> Node | None:
        """The return value of cv2.calibrateCamera, under the names from OpenCV's Python tutorial."""
        for simple in ("rms", "ret"):
            value = self.tree[self.simple[simple]].value if simple in self.simple else None
            if isinstance(value, int | float) and not isinstance(value, bool):
                return self.take(simple)
        return None

    def date(self) -> str | None:
        """Date of the calibration, as written in the file."""
        node = self.take("calibrationtime")
        return None if node is None else str(node.value).strip()

    def grade(self) -> Grade:
        """The grade: calibrated, unless a file written by calibrary states another."""
        node = self.take(simplified(GRADE_KEY))
        if node is None:
            return Grade.CALIBRATED
        if node.text() not in list(Grade):
            node.fail(f"{strict.shown(node.text())} is not a grade, expected one of {', '.join(Grade)}")
        return Grade(node.text())

    def fisheye_mark(self) -> bool | None:
        """Whether the file states a fisheye; None if it states nothing."""
        node = self.take("fisheyemodel")
        if node is None:
            return is_fisheye(self.simple, self.tree)
        return bool(node.value if isinstance(node.value, bool) else node.whole())

    def are_own(self, label: str) -> bool:
        """Whether a matrix and its coefficients have the keys of OpenCV's own samples."""
        names = [
            match[2]
            for pattern, key in ((MATRIX, self.matrices[label]), (VECTOR, self.coefficients[label]))
            if (match := pattern.fullmatch(simplified(key)))
        ]
        return tuple(names) in OWN_KEYS

    def extras(self, prefix: str) -> tuple[tuple[str, str], ...]:
        """All other keys, as JSON."""
        self.fisheye_mark()
        return tuple(
            (prefix + key, json.dumps(node.value, ensure_ascii=False))
            for key, node in self.tree.entries()
            if key not in self.used
        )


def sniff(content: Content) -> Sniff | None:
    """The container with a camera matrix in it; a program with keys of its own may claim it more strongly."""
    if content.xml_root is not None:
        rootless = storage.ROOTLESS in (content.text or "")
        if content.xml_root != "opencv_storage" and not rootless:
            return None
        keys = content.xml_tags
        storage_mark = "an element is an opencv-matrix" if rootless else "the XML root is <opencv_storage>"
    else:
        keys = content.json_keys or content.yaml_keys
        text = content.text or ""
        storage_mark = "a matrix is marked opencv-matrix" if "opencv-matrix" in text else ""
    if FOREIGN_KEYS.intersection(keys):
        return None
    simple = {simplified(key): key for key in keys}
    matrix = next((key for name, key in simple.items() if MATRIX.fullmatch(name)), None)
    if storage_mark:
        return Sniff(Sure.SHAPE, f"{storage_mark} and it contains {matrix}") if matrix else None
    coefficients = next((key for name, key in simple.items() if VECTOR.fullmatch(name)), None)
    if not (matrix and coefficients) and content.xml_root is None and AROUND & simple.keys():
        matrix, coefficients = _nested(content)
    if matrix and coefficients:
        return Sniff(Sure.WEAK, f"the keys {matrix} and {coefficients} are those of OpenCV's functions")
    return None


def _nested(content: Content) -> tuple[str | None, str | None]:
    """Keys of a camera matrix and of coefficients below others."""
    document = content.json
    below = (
        [key for value in document.values() if isinstance(value, dict) for key in value]
        if isinstance(document, dict)
        else _KEY_BELOW.findall(content.text or "")
    )
    found = [
        next((key for key in below if len(key) > 1 and kind.fullmatch(simplified(key))), None)
        for kind in (MATRIX, VECTOR)
    ]
    return found[0], found[1]


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera of the file, in the order of their matrices."""
    return cameras(storage.load(data, source=context.name), context)


def cameras(tree: Node, context: ReadContext) -> list[Calibration]:
    """The cameras of a tree with OpenCV's keys, whatever container it came in."""
    tree = shaped(tree)
    keys = Keys(tree)
    if not keys.matrices:
        listed = ", ".join(strict.shown(key) for key in tree.keys()[:12])
        tree.fail(f"there is no camera matrix; the keys are {listed or 'none'}")
    for found, what in ((keys.coefficients, "these coefficients"), (keys.mirrors, "this xi")):
        for label, key in found.items():
            if label not in keys.matrices:
                tree[key].fail(f"there is no camera matrix beside {what}")
    size = context.size(keys.size())
    grade, quality, date = keys.grade(), keys.quality(), keys.date()
    extras = keys.extras(PREFIX)
    return [
        _camera(keys, label, size, context, grade=grade, quality=quality, date=date, extras=extras)
        for label in keys.matrices
    ]


def write(calibrations: Sequence[Calibration], context: WriteContext) -> bytes:
    """The tree in the syntax that the name's suffix asks for."""
    return storage.dump(tree_of(calibrations, context), context.name)


def tree_of(calibrations: Sequence[Calibration], context: WriteContext) -> dict[str, Json]:
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
            if storage.holds(key.removeprefix(PREFIX), value):
                extras.setdefault(key.removeprefix(PREFIX), value)
    return extras


def _camera(
    keys: Keys,
    label: str,
    size: ImageSize,
    context: ReadContext,
    *,
    grade: Grade,
    quality: Quality | None,
    date: str | None,
    extras: tuple[tuple[str, str], ...],
) -> Calibration:
    matrix_key, coefficient_key = keys.matrices[label], keys.coefficients.get(label)
    intrinsics = _intrinsics(keys.tree[matrix_key], size)
    notes = []
    distortion = _distortion(keys, label, context)
    if isinstance(distortion, Unified):
        near = intrinsics.fx / (1 + distortion.xi)
        notes.append(
            f"K's fx is the file's; near the axis the camera is a pinhole of {near:.6g} px, fx/(1 + xi)"
        )
    elif intrinsics.skew:
        notes.append(
            f"skew of {intrinsics.skew:g} px was kept; OpenCV's own projectPoints does not look at it"
        )
    if all(key in keys.tree for key in METASHAPE_SPELLING):
        notes.append(
            "the spelling of the keys is also that of Metashape's export, which does not document its pixel "
            "origin; OpenCV's was taken"
        )
    tags = [key for key in (matrix_key, coefficient_key) if key is not None]
    several = len(keys.matrices) > 1
    return context.calibration(
        intrinsics,
        distortion,
        name=label if several else None,
        tag=", ".join(tags),
        date=date,
        grade=grade,
        quality=quality,
        notes=tuple(notes),
        extras=extras,
    )


def _intrinsics(node: Node, size: ImageSize) -> Intrinsics:
    native = Native.of_matrix(storage.matrix(node, 3, 3), place=node.place, source=node.source)
    try:
        return CONVENTION.intrinsics(native, size, source=node.source)
    except ParseError as error:
        node.fail(error.message)


def _distortion(keys: Keys, label: str, context: ReadContext) -> Distortion | None:
    if label in keys.mirrors:
        return _mirror(keys, label)
    if label not in keys.coefficients:
        return None
    node = keys.tree[keys.coefficients[label]]
    values = storage.numbers(node)
    if not values:
        return NoDistortion()
    if len(values) not in OPENCV_MODELS:
        node.fail(f"{len(values)} distortion coefficients, expected {', '.join(map(str, OPENCV_MODELS))}")
    if len(values) == 4:
        asked = context.option(DISTORTION.name)
        marked = keys.fisheye_mark()
        if asked == "fisheye" or (asked is None and marked):
            return KannalaBrandt(**dict(zip(KannalaBrandt.names(), values, strict=True)))
        if asked is None and marked is None and not keys.are_own(label):
            node.fail(
                "four coefficients are Brown's k1 k2 p1 p2 or a fisheye's k1 k2 k3 k4, and the file does "
                "not state which; say so with --set distortion=brown or distortion=fisheye"
            )
    elif context.option(DISTORTION.name) == "fisheye" or (
        keys.fisheye_mark() and context.option(DISTORTION.name) is None
    ):
        node.fail(f"{len(values)} coefficients of a fisheye, expected 4")
    if not any(values):
        return NoDistortion()
    kind = OPENCV_MODELS[len(values)]
    return kind(**dict(zip(kind.names(), values, strict=False)))


def _mirror(keys: Keys, label: str) -> Unified:
    """cv2.omnidir's camera: a mirror, or a lens like one, of eccentricity xi."""
    node = keys.tree[keys.mirrors[label]]
    values = storage.numbers(node) if isinstance(node.value, dict | list) else (node.number(),)
    if len(values) != 1 or values[0] <= -1:
        node.fail(f"xi is {', '.join(f'{value:g}' for value in values)}, expected one number above −1")
    if label not in keys.coefficients:
        node.fail("there are no distortion coefficients beside this xi, expected four")
    terms = storage.numbers(beside := keys.tree[keys.coefficients[label]])
    if len(terms) != 4:
        beside.fail(
            f"{len(terms)} distortion coefficients beside xi, expected cv2.omnidir's four, k1 k2 p1 p2"
        )
    return Unified(xi=values[0], **dict(zip(("k1", "k2", "p1", "p2"), terms, strict=True)))


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


FORMAT = Format(
    name="opencv_storage",
    title="OpenCV calibration (FileStorage XML, YAML, JSON)",
    suffixes=storage.SUFFIXES,
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
    options=(DISTORTION,),
)
