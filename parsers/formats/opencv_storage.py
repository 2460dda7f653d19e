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
of them are known (``_opencv_keys``), below one other key as well (``_by_shape``), with "left", "right" or a number
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

import re
from collections.abc import Sequence

from calibrary.calibration import Calibration, Grade, ImageSize, Intrinsics, Quality
from calibrary.distortion import (
    Distortion,
    KannalaBrandt,
    NoDistortion,
    Unified,
)
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.interop.opencv import OPENCV_LENSES, OPENCV_MODELS
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
from calibrary.parsers.formats._by_shape import AROUND, shaped
from calibrary.parsers.formats._opencv_keys import (
    COEFFICIENTS,
    FOREIGN_KEYS,
    GRADE_KEY,
    MATRIX,
    METASHAPE_SPELLING,
    Keys,
    simplified,
)
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

PREFIX = "opencv_storage/"
_KEY_BELOW = re.compile(r"^[ \t]{1,20}(?:- )?([A-Za-z][\w.\-]{0,40}):", re.MULTILINE)


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
    coefficients = next((key for name, key in simple.items() if COEFFICIENTS.fullmatch(name)), None)
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
        for kind in (MATRIX, COEFFICIENTS)
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
