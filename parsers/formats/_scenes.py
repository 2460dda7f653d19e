"""Rows of the table of programs' formats: the cameras of scenes, of data sets and of their readers.

To add one, add its row, and its sample with the formula computed independently to the tests of the formats.
"""

from __future__ import annotations

import math
import re
import struct
from collections import Counter
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

from calibrary.calibration import Calibration, Grade, ImageSize
from calibrary.distortion import Distortion, NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Origin, Tangential, Unit
from calibrary.parsers.document import Node
from calibrary.parsers.format import ReadContext, Sniff, Sure
from calibrary.parsers.formats._one_camera import ORIGIN_UNKNOWN, fisheye, refuse_model
from calibrary.parsers.formats._opencv_lens import COUNTS, OPENCV_ORDER, lens
from calibrary.parsers.formats._table import (
    Mark,
    Model,
    Named,
    Program,
    field_of_view,
    find,
    noted,
    numbers_at,
    under,
    with_more,
)
from calibrary.parsers.formats._text_rows import rows_of, text_of
from calibrary.parsers.formats._tree import NPY, arrays, names_of_arrays
from calibrary.quality import Quality
from calibrary.records import Json, replace

if TYPE_CHECKING:
    from numpy.typing import NDArray

JSON, TEXT, BINARY = (Syntax.JSON,), (Syntax.TEXT,), (Syntax.BINARY,)
MOST_BYTES = 64 * 1024
K4 = ("fx", "fy", "cx", "cy")
UNKNOWN_LENS = {"": Model(lambda _: None)}
IN_FRACTIONS = Convention(unit=Unit.EACH_SIDE, origin=Origin.CORNER)
THEIA_RADIAL = "radial_distortion_coeffs"
MOST_IMAGES = 100_000
ARGOVERSE: Final[dict[str, ImageSize]] = {"image_raw_ring_": (1920, 1200), "image_raw_stereo_": (2464, 2056)}
"""Image sizes by the beginning of a camera's name."""
ARGOVERSE_K = (
    "focal_length_x_px_",
    "focal_length_y_px_",
    "focal_center_x_px_",
    "focal_center_y_px_",
    "skew_",
)
DSO: Final = {"pinhole": (4, 5, 8), "fov": (5,), "radtan": (8,), "equidistant": (8,), "kannalabrandt": (8,)}
"""How many numbers a model has; 4Seasons writes Equidistant, and eight numbers after Pinhole."""
DSO_MODES = ("crop", "full", "none")
DROID_LENGTHS = tuple(4 + count for count in COUNTS)
NSVF_SHAPES = ((4, 3, 1, 1, 2), (4, 3, 1, 2), (4, 3, 1, 1, 2, 1), (4, 3, 1, 2, 1))
"""How many numbers each line has; the last may say which way the poses go."""
SMALLEST_PX = 32.0
"""A shorter focal length, or a principal point nearer the corner, is of no photograph."""
EQUAL_PX = 0.01
"""K of single-precision matrices differ by less from image to image."""
_WHOLE = re.compile(r"\d{1,7}(?:\.0*)?", re.ASCII)
_WORLD = re.compile(r"world_mat_\d{1,7}")
_SHAPE_OF_17 = re.compile(rb"'shape':\s*\(\d{1,9},\s*17\)")


PARAM = ">2i12d"
PARAM_FACTORS = {4: (1, 2), 6: (3,), 9: (4,), 17: (5,)}
"""ARToolKit's versions by the count of dist_factor."""
PARAM_LENGTHS = {struct.calcsize(f"{PARAM}{count}d"): count for count in PARAM_FACTORS}
PARAM_AGREEMENT = 1e-3


def _numbers_of(lines: Sequence[str]) -> list[tuple[float, ...]] | None:
    """The numbers of each line; None if there is anything else."""
    try:
        return [strict.numbers(line) for line in lines]
    except ParseError:
        return None


def _document(context: ReadContext, /, **values: Json) -> Node:
    return Node(values, source=context.name)


def _without_k4(values: Sequence[float]) -> Distortion:
    k1, k2, k3 = values
    return lens((k1, k2, 0.0, 0.0, k3))


def _is_eight(content: Content) -> Sniff | None:
    parts = (content.text or "").split(maxsplit=9)
    if len(parts) != 8 or not all(_WHOLE.fullmatch(part) for part in parts[:2]) or not _numbers_of(parts):
        return None
    return Sniff(Sure.WEAK, "it is eight numbers, of which the first two could be an image size")


def _eight(data: bytes, context: ReadContext) -> Node:
    rows = rows_of(data, most=MOST_BYTES)
    width, height, f, cx, cy, *k = strict.numbers(" ".join(rows), count=8)
    if not (0 <= cx <= width and 0 <= cy <= height):
        raise ParseError(
            f"the principal point ({cx:g}, {cy:g}) lies outside the {width:g}×{height:g} image, so these are not the "
            "eight numbers W H f ppx ppy k1 k2 k3"
        )
    return _document(context, size=[width, height], K=[f, f, cx, cy], k=[*k])


def _argoverse_cameras(tree: Node, _context: ReadContext) -> Named:
    for item in tree["camera_data_"].items():
        name = item["key"].text()
        size = next((size for start, size in ARGOVERSE.items() if name.startswith(start)), None)
        kind = "rectified" if name.endswith("_rect") else "raw"
        yield name, with_more(item["value"], {"size": list(size) if size else None, "kind": kind})


def _argoverse(_tree: Node, node: Node, item: Calibration) -> Calibration:
    if find(node, "size") is not None:
        taken = "the file does not state image sizes; those of Argoverse's cameras of this name were taken"
        provenance = replace(item.provenance, assumptions=(*item.provenance.assumptions, taken))
        item = noted(replace(item, provenance=provenance), taken)
    if node["kind"].text() == "raw":
        return item
    return noted(item, "distortion_coefficients_ is of the raw images; a rectified camera has no distortion")


def _is_param(content: Content) -> Sniff | None:
    """A length of a version, two small numbers, and the last row of a projection."""
    data = content.data
    if len(data) not in PARAM_LENGTHS or data[:2] != b"\0\0" or data[4:6] != b"\0\0":
        return None
    width, height, *numbers = struct.unpack_from(PARAM, data)
    if numbers[8:11] != [0.0, 0.0, 1.0] or min(width, height) <= 0:
        return None
    return Sniff(Sure.MAGIC, f"{len(data)} bytes with a size and a 3×4 matrix, big-endian")


def _param(data: bytes, context: ReadContext) -> Node:
    if len(data) not in PARAM_LENGTHS:
        raise ParseError(f"{len(data)} bytes, expected {' or '.join(map(str, PARAM_LENGTHS))}")
    count = PARAM_LENGTHS[len(data)]
    width, height, *numbers = struct.unpack(f"{PARAM}{count}d", data)
    if not all(map(math.isfinite, numbers)):
        raise ParseError("a number is not finite")
    if count < 9:
        raise UnsupportedModelError(
            "it is of ARToolKit before version 5, whose distortion is a polynomial in px that has no counterpart here; "
            "calibrate again with artoolkitX's calib_camera"
        )
    *k, fx, fy, cx, cy, s = numbers[12:]
    if not min(fx, fy, s) > 0:
        raise ParseError(
            f"fx {fx:g}, fy {fy:g} and s {s:g}, expected numbers above zero", place="dist_factor"
        )
    if max(abs(numbers[0] * s / fx - 1), abs(numbers[5] * s / fy - 1)) > PARAM_AGREEMENT:
        raise ParseError(
            f"the matrix has {numbers[0]:g} and {numbers[5]:g}, and fx/s and fy/s are {fx / s:g} and {fy / s:g}",
            place="mat",
        )
    return _document(context, size=[width, height], K=[fx, fy, cx, cy], k=[*k])


def _is_droid(content: Content) -> Sniff | None:
    """Nothing but one line of numbers, the first four of which could be a K in pixels."""
    numbers = _numbers_of(content.lines) if len(content.lines) == 1 else None
    if numbers is None or len(numbers[0]) not in DROID_LENGTHS:
        return None
    fx, fy = numbers[0][:2]
    if min(numbers[0][:4]) < SMALLEST_PX or abs(fx - fy) > fx / 3:
        return None
    return Sniff(Sure.WEAK, f"one line of {len(numbers[0])} numbers, as fx fy cx cy and coefficients")


def _droid(data: bytes, context: ReadContext) -> Node:
    rows = [row for row in rows_of(data, most=MOST_BYTES) if row.strip()]
    if len(rows) != 1:
        raise ParseError(f"{len(rows)} lines of numbers, expected one")
    fx, fy, cx, cy, *k = strict.numbers(rows[0], count=DROID_LENGTHS)
    return _document(context, K=[fx, fy, cx, cy], k=[*k])


def _is_dso(content: Content) -> Sniff | None:
    """Four lines: a camera, two numbers, the kind of rectification, two numbers."""
    if len(content.lines) != 4:
        return None
    first, size, rectified, made = content.lines
    name = first.split()[0].lower()
    counts = [len((_numbers_of([row]) or [()])[0]) for row in (first, size, rectified, made)]
    is_camera = name in DSO or counts[0] in (5, 8)
    is_rectified = rectified.split()[0] in DSO_MODES or counts[2] in (4, 5)
    if not (is_camera and is_rectified and counts[1] == counts[3] == 2):
        return None
    return Sniff(Sure.MAGIC, f"four lines as DSO reads them, the third is {strict.shown(rectified)}")


def _dso(data: bytes, context: ReadContext) -> Node:
    """The first two lines; the last two are of the camera that DSO is to make."""
    rows = [row for line in text_of(data, most=MOST_BYTES).splitlines() if (row := line.split())]
    if len(rows) < 3:
        raise ParseError(f"{len(rows)} lines, expected the camera, its image size and what to make")
    row = rows[0]
    named = row[0].lower() if row[0][:1].isalpha() else "radtan" if len(row) == 8 else "fov"
    if named not in DSO:
        refuse_model(row[0], tuple(DSO), place="line 1")
    row = row[1:] if row[0][:1].isalpha() else row
    fx, fy, cx, cy, *k = strict.numbers(" ".join(row), count=DSO[named], place="line 1")
    size = strict.numbers(" ".join(rows[1]), count=2, place="line 2")
    if named == "pinhole" and any(k):
        raise ParseError("a Pinhole has no distortion, but there are numbers after K", place="line 1")
    model = f"{named} in fractions" if max(cx, cy) < 1 else named
    return _document(context, model=model, K=[fx, fy, cx, cy], k=[*k], size=[*size])


def _is_llff(content: Content) -> Sniff | None:
    if not content.data.startswith(NPY) or not _SHAPE_OF_17.search(content.data[:4096]):
        return None
    return Sniff(Sure.SHAPE, "a numpy file with 17 columns, as LLFF's poses_bounds")


def _llff(data: bytes, context: ReadContext) -> Node:
    """Height, width and focal length of each image, and how many images have them."""
    from calibrary.parsers.formats import _npy  # noqa: PLC0415  loads numpy

    rows = _npy.array(data)
    if rows.ndim != 2 or rows.shape[1] != 17 or not 0 < len(rows) <= MOST_IMAGES:
        raise ParseError(f"an array of shape {rows.shape}, expected rows of 17 numbers")
    views = Counter(map(tuple, rows[:, (4, 9, 14)].tolist()))
    return _document(
        context,
        cameras={
            f"camera {number}": {"size": [width, height], "K": [f, f, 0.0, 0.0], "views": count}
            for number, ((height, width, f), count) in enumerate(views.items(), start=1)
        },
    )


def _is_neus(content: Content) -> Sniff | None:
    names = names_of_arrays(content.data)
    if any(_WORLD.fullmatch(name) for name in names) and any(name.startswith("scale_mat_") for name in names):
        return Sniff(Sure.MAGIC, "a zip archive of numpy arrays with world_mat_0 and scale_mat_0")
    return None


def _neus(data: bytes, context: ReadContext) -> Node:
    """K of the images, by the name of the first that has it, and how many have it."""
    import numpy as np  # noqa: PLC0415  for these files alone

    from calibrary.parsers.formats import projection_matrix  # noqa: PLC0415  loads numpy

    images: dict[str, tuple[NDArray[np.float64], int]] = {}
    for name, node in Node(arrays(data), source=context.name).entries():
        if not _WORLD.fullmatch(name):
            continue
        K = projection_matrix.upper_triangle(np.array(node.matrix(4, 4))[:3, :3])
        if not min(K[0, 0], K[1, 1]) >= projection_matrix.SMALLEST_FOCAL_PX:
            raise ParseError(
                "it decomposes into focal lengths that are not in px, expected K·[R | t]", place=name
            )
        same = next((one for one, (known, _) in images.items() if np.abs(known - K).max() < EQUAL_PX), name)
        first, count = images.get(same, (K, 0))
        images[same] = first, count + 1
    if not images:
        raise ParseError("there is no world_mat_0")
    cameras: dict[str, Json] = {}
    for name, (K, count) in images.items():
        (fx, skew, cx), (_, fy, cy), _ = K.tolist()
        cameras[name] = {"K": [fx, fy, cx, cy, skew if abs(skew) >= EQUAL_PX else 0.0], "views": count}
    return _document(context, cameras=cameras)


def _counted(tree: Node, _context: ReadContext) -> Named:
    yield from ((name, replace(node, place=name)) for name, node in tree["cameras"].entries())


def _viewed(_tree: Node, node: Node, item: Calibration) -> Calibration:
    return replace(item, quality=Quality(views=node["views"].whole()))


def _mvsnet(data: bytes, context: ReadContext) -> Node:
    head, word, rest = text_of(data, most=MOST_BYTES).partition("\nintrinsic")
    if not head.lstrip().startswith("extrinsic") or not word:
        raise ParseError("there are no lines 'extrinsic' and 'intrinsic'")
    numbers = [strict.number(part, place="intrinsic") for part in rest.split()[:9]]
    return _document(context, intrinsic=[*numbers])


def _is_mvsnet(content: Content) -> Sniff | None:
    """The two words, each on a line of its own."""
    if content.first_line == "extrinsic" and "intrinsic" in content.lines:
        return Sniff(Sure.MAGIC, "the lines 'extrinsic' and 'intrinsic'")
    return None


def _is_named(content: Content) -> Sniff | None:
    """The names of either."""
    if not any(name in (content.text or "") for name in ("fx_color", "doffs")):
        return None
    names = {line.partition("=")[0].strip() for line in content.lines}
    if {"fx_color", "mx_color", "colorWidth"} <= names:
        return Sniff(Sure.MAGIC, "the names fx_color, mx_color and colorWidth of ScanNet")
    if {"cam0", "width", "height", "doffs"} <= names:
        return Sniff(Sure.MAGIC, "the names cam0, doffs, width and height of Middlebury")
    return None


def _named(data: bytes, context: ReadContext) -> Node:
    values: dict[str, Json] = {}
    for row in rows_of(data, most=MOST_BYTES):
        name, mark, value = (part.strip() for part in row.partition("="))
        if mark and name in values:
            raise ParseError("it is a duplicate key", place=name)
        if mark:
            values[name] = value
    return Node(values, source=context.name)


def _named_cameras(tree: Node, _context: ReadContext) -> Named:
    """Middlebury's left and right one, or ScanNet's of colour and depth, each with the same names."""
    for name in ("cam0", "cam1"):
        if name in tree:
            size: Json = [tree["width"].value, tree["height"].value]
            K = strict.numbers(
                tree[name].text().strip("[]").replace(";", " "), count=9, source=tree.source, place=name
            )
            yield name, with_more(tree, {"kind": "rectified", "K": [*K], "size": size})
    for name in ("color", "depth") if "cam0" not in tree else ():
        if f"fx_{name}" in tree:
            numbers = [
                strict.number(tree[f"{key}_{name}"].text(), place=f"{key}_{name}")
                for key in ("fx", "fy", "mx", "my")
            ]
            sides = [tree[f"{name}{side}"].value for side in ("Width", "Height")]
            yield name, with_more(tree, {"kind": "", "K": [*numbers], "size": [*sides]})


def _is_nsvf(content: Content) -> Sniff | None:
    """Lines of four, three, one and two numbers."""
    rows = _numbers_of(content.lines) if 4 <= len(content.lines) <= 6 else None
    if rows is None or (shape := tuple(map(len, rows))) not in NSVF_SHAPES:
        return None
    return Sniff(Sure.SHAPE, f"lines of {', '.join(map(str, shape))} numbers")


def _nsvf(data: bytes, context: ReadContext) -> Node:
    rows = [strict.numbers(row) for row in rows_of(data, most=MOST_BYTES) if row.strip()]
    shape = tuple(map(len, rows))
    if shape not in NSVF_SHAPES:
        listed = ", ".join(map(str, shape))
        raise ParseError(f"lines of {listed or 'no'} numbers, expected 4, 3, 1, (1,) 2")
    first, second, third, fourth = rows[0]
    K = [first, first, second, third] if fourth == 0 else [first, second, third, fourth]
    return _document(context, K=[*K], size=[*rows[shape.index(2)][::-1]])


def _nuscenes_cameras(tree: Node, _context: ReadContext) -> Named:
    """Those of the sensors that have a matrix."""
    tokens = set[str]()
    for item in tree.items():
        if item["camera_intrinsic"].value == []:
            continue
        token = item["token"].text()
        if token in tokens:
            item["token"].fail("it is a duplicate token")
        tokens.add(token)
        yield token, replace(item, place=token)


def _theia_cameras(tree: Node, _context: ReadContext) -> Named:
    """The images that state a focal length, or all where none does, with all of K and of the lens."""
    every = [item["CameraIntrinsicsPrior"] for item in tree["priors"].items()]
    for node in [one for one in every if "focal_length" in one] or every:
        f, (cx, cy) = node["focal_length"].number(), node["principal_point"].numbers(2)
        aspect, skew = numbers_at(node, ("aspect_ratio",), 1.0) + numbers_at(node, ("skew",), 0.0)
        tangential = node.get("tangential_distortion_coeffs")
        p: Json = [] if tangential is None else [*tangential.numbers((0, 2))]
        name = node["image_name"].text()
        K: Json = {"fx": f, "fy": f * aspect, "cx": cx, "cy": cy, "skew": skew}
        yield name, replace(with_more(node, {"K": K, "tangential": p or [0.0, 0.0]}), place=name)


def _theia_lens(values: Sequence[float]) -> Distortion:
    p1, p2, *k = values
    k1, k2, k3 = (*k, 0.0, 0.0, 0.0)[:3]
    return lens((k1, k2, p1, p2, k3))


def _theia(tree: Node, _node: Node, item: Calibration) -> Calibration:
    items = tree["priors"].items()
    without = sum("focal_length" not in one["CameraIntrinsicsPrior"] for one in items)
    note = f"{without} of {len(items)} images state no focal length, and are left out"
    return noted(item, note) if without else item


def _record3d(tree: Node, _node: Node, item: Calibration) -> Calibration:
    """How far the frames, whose focus changes, differ from K."""
    frames, fx = find(tree, "perFrameIntrinsicCoeffs"), item.intrinsics.fx
    focals = [row.numbers(4)[0] for row in frames.items()] if frames is not None else []
    if not focals or (min(focals) == fx == max(focals)):
        return item
    spread = f"{min(focals):.5g} to {max(focals):.5g} px; K has {fx:.5g}"
    return noted(item, f"the focal length of the {len(focals)} frames is {spread}")


def _gaussian_cameras(tree: Node, _context: ReadContext) -> Named:
    for node in tree.items():
        yield str(node["img_name"].value), with_more(node, {"cx": 0.0, "cy": 0.0})


SCENES: Final = (
    Program(
        name="alicevision_cal",
        title="AliceVision (POPART) calibration of eight numbers",
        words="""\
AliceVision's (POPART's) ``.cal``: eight bare numbers of a camera.

In the format's own words::

    W H f ppx ppy k1 k2 k3

separated by white space. ``f`` is the mean of fx and fy. The principal point is that of OpenCV's matrix, unchanged. The
program that writes the file omits the two tangential coefficients of OpenCV's five. Nothing in the file identifies it,
so it is read in this format only if no other format recognises it.

(Meshroom's CameraCalibration node writes OpenCV's own storage format under the same ending.)

Source: AliceVision, ``dataio/IFeed.cpp``, readCalibrationFromFile, and the calibration's ``exportData``.
""",
        suffixes=(".cal", ".txt"),
        reference="https://github.com/alicevision/AliceVision",
        syntaxes=TEXT,
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            tangential=Tangential.NONE,
            coefficients=("k1", "k2", "k3"),
            remarks=("one focal length, the mean of fx and fy",),
        ),
        recognise=_is_eight,
        load=_eight,
        K=("K",),
        size=("size",),
        models={"": Model(_without_k4, ("k",))},
        finish=lambda _tree, _node, item: noted(
            item, "the format omits tangential terms and the difference of fx and fy"
        ),
    ),
    Program(
        name="argoverse",
        title="Argoverse vehicle calibration",
        words="""\
Argoverse's ``vehicle_calibration_info.json``: the cameras of a car, seven around and two ahead.

In the format's own words::

    {"camera_data_": [{"key": "image_raw_ring_front_center", "value": {
        "focal_length_x_px_": 1392.1, "focal_length_y_px_": 1392.1, "focal_center_x_px_": 980.1,
        "focal_center_y_px_": 604.3, "skew_": 0.0, "distortion_coefficients_": [-0.17, 0.12, -0.03],
        "vehicle_SE3_camera_": {…}}}, …]}

The three coefficients are k1, k2, k3 of OpenCV's polynomial. A camera whose key ends in ``_rect`` is of rectified
images, which have no distortion: the program projects into them with K alone, and the coefficients beside it are those
of the raw images. The file does not state image sizes: the data set's are
1920×1200 around the car and 2464×2056 ahead.

Source: argoverse-api, ``argoverse/utils/calibration.py``: ``CameraConfig`` ("distortion_coeffs: k1, k2, k3"),
``load_stereo_calib`` and ``project_cam_to_image`` for rectified ones; ``argoverse/utils/camera_stats.py``: the sizes.
""",
        suffixes=(".json",),
        reference="https://github.com/argoverse/argoverse-api",
        syntaxes=JSON,
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            tangential=Tangential.NONE,
            coefficients=("k1", "k2", "k3"),
            remarks=("the image sizes are those of the data set, by the cameras' names",),
        ),
        marks=(Mark(("camera_data_",)),),
        cameras=_argoverse_cameras,
        K=ARGOVERSE_K,
        size=("size",),
        model=("kind",),
        models={"raw": Model(_without_k4, ("distortion_coefficients_",), (3,)), "rectified": Model()},
        finish=_argoverse,
    ),
    Program(
        name="artoolkit_param",
        title="ARToolKit 5 and artoolkitX camera_para.dat",
        words="""\
ARToolKit's ``camera_para.dat``: the camera of ARToolKit 5 and artoolkitX, as big-endian binary numbers.

In the format's own words::

    int32 xsize, ysize
    double mat[3][4]                      fx/s  0  cx  0 …   of the undistorted image
    double dist_factor[9]                 version 4: k1 k2 p1 p2 fx fy cx cy s
    double dist_factor[17]                version 5: k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 fx fy cx cy s

The distortion is OpenCV's: x = (u − cx)·s/fx of an undistorted pixel, whose image is fx·x'(x, y) + cx. So K has
dist_factor's fx, fy, cx, cy. The version is told by the length. Versions 1 to 3 have a polynomial of their own with
four to six numbers, and are refused.

Source: artoolkitX, ``AR/paramDistortion.c``, ``arParamIdeal2Observ``; ``paramFile.c``.
""",
        suffixes=(".dat",),
        reference="https://github.com/artoolkitx/artoolkitx",
        syntaxes=BINARY,
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            coefficients=OPENCV_ORDER[:12],
            remarks=(
                "fx, fy, cx and cy of K are in dist_factor, and the matrix is that of the undistorted image",
            ),
        ),
        recognise=_is_param,
        load=_param,
        K=("K",),
        size=("size",),
        models={"": Model(lens, ("k",))},
    ),
    Program(
        name="droid_calib",
        title="DROID-SLAM calibration (fx fy cx cy …)",
        words="""\
DROID-SLAM's calibration, one line of numbers, which DPVO, MASt3R-SLAM's kin and many scripts read as well.

In the format's own words (``calib/tum3.txt``, ``calib/barn.txt``, ``calib/euroc.txt``)::

    535.4 539.2 320.1 247.6
    458.654 457.296 367.215 248.375 -0.28340811 0.07395907 0.00019359 1.76187114e-05

They are fx, fy, cx, cy, followed by any coefficients that ``cv2.undistort`` takes: k1 k2 p1 p2, k3, and k4 k5 k6. The
program scales K with the images, so the file does not state their size.

Source: DROID-SLAM, ``demo.py``, ``image_stream``.
""",
        suffixes=(".txt",),
        reference="https://github.com/princeton-vl/DROID-SLAM",
        syntaxes=TEXT,
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            coefficients=OPENCV_ORDER[:8],
            remarks=("one line: fx, fy, cx, cy and the coefficients",),
        ),
        recognise=_is_droid,
        load=_droid,
        K=("K",),
        size=(),
        models={"": Model(lens, ("k",))},
    ),
    Program(
        name="dso_camera",
        title="DSO camera.txt (TUM monoVO, 4Seasons)",
        words="""\
DSO's ``camera.txt``, which LSD-SLAM and the TUM monoVO, 4Seasons and VI datasets' tools share.

In the format's own words::

    RadTan 458.654 457.296 367.215 248.375 -0.2834 0.0740 0.00019 0.00002
    752 480                 # the images
    crop                    # full, none, or "fx fy cx cy 0": the rectified camera that DSO is to make
    640 480                 # its images

The models are Pinhole, FOV (omega after K) and RadTan, EquiDistant, KannalaBrandt with four coefficients each; without
a name five numbers are FOV, or Pinhole where the last is 0, and eight are RadTan. RadTan is OpenCV's k1 k2 p1 p2,
EquiDistant and KannalaBrandt are cv2.fisheye's. Where cx and cy are below 1, all of K is in fractions of the sides,
and the principal point counts from the corner of the first pixel: DSO takes half a pixel off. Else the numbers are
K itself.

Source: DSO, README.md "Geometric Calibration File" and ``src/util/Undistort.cpp``.
""",
        suffixes=(".txt",),
        reference="https://github.com/JakobEngel/dso",
        syntaxes=TEXT,
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            coefficients=OPENCV_ORDER[:4],
            remarks=(
                "EquiDistant's and KannalaBrandt's four are cv2.fisheye's k1, k2, k3, k4",
                "where cx and cy are below 1, K is in fractions of each side, from the outer corner of the top-left "
                "pixel",
            ),
        ),
        recognise=_is_dso,
        load=_dso,
        K=("K",),
        size=("size",),
        model=("model",),
        models={
            name + unit: Model(made, numbers, convention=convention)
            for unit, convention in (("", None), (" in fractions", IN_FRACTIONS))
            for name, made, numbers in (
                ("pinhole", lambda _: NoDistortion(), ()),
                ("fov", field_of_view, ("k",)),
                ("radtan", lens, ("k",)),
                ("equidistant", fisheye, ("k",)),
                ("kannalabrandt", fisheye, ("k",)),
            )
        },
    ),
    Program(
        name="gaussian_cameras",
        title="3D Gaussian splatting cameras.json",
        words="""\
``cameras.json`` of 3D Gaussian splatting: the undistorted camera of every image of a scene.

In the format's own words::

    [{"id": 0, "img_name": "00001", "width": 1959, "height": 1090, "position": […], "rotation": […],
      "fy": 1164.6, "fx": 1159.5}, …]

The training's images are undistorted and their principal point in the middle: it goes by the field of view alone.
Images whose numbers are the same are one camera.

Source: gaussian-splatting, ``utils/camera_utils.py``, ``camera_to_JSON``.
""",
        suffixes=(".json",),
        reference="https://github.com/graphdeco-inria/gaussian-splatting",
        syntaxes=JSON,
        convention=Convention(
            origin=Origin.IMAGE_CENTRE,
            tangential=Tangential.NONE,
            remarks=("undistorted images; the principal point is in the middle",),
        ),
        marks=(Mark(("img_name", "width", "height", "fx", "fy", "rotation"), at="[0]"),),
        cameras=_gaussian_cameras,
        K=("fx", "fy", "cx", "cy"),
        grade=Grade.ADJUSTED,
        assumptions=(
            "the file has no principal point; the program renders with it in the middle of the image",
        ),
        is_of_images=True,
    ),
    Program(
        name="llff_npy",
        title="LLFF poses_bounds.npy",
        words="""\
``poses_bounds.npy`` of LLFF, which NeRF and its descendants read: pose, size, focal length and depths of each image.

In the format's own words::

    N×17 numbers: a 3×5 matrix by rows, [R | t | (height, width, focal)], then the nearest and the farthest depth

One focal length for both axes, and the principal point in the middle of the image. COLMAP solved for it, mostly with a
radial distortion, which the file does not keep: the distortion is unknown.

Source: LLFF, README "Using your own poses without running COLMAP"; ``llff/poses/pose_utils.py``, ``save_poses``.
""",
        suffixes=(".npy",),
        reference="https://github.com/Fyusion/LLFF",
        syntaxes=BINARY,
        convention=Convention(
            origin=Origin.IMAGE_CENTRE,
            tangential=Tangential.NONE,
            remarks=("one focal length, and the principal point in the middle of the image",),
        ),
        recognise=_is_llff,
        load=_llff,
        cameras=_counted,
        K=("K",),
        size=("size",),
        models=UNKNOWN_LENS,
        grade=Grade.ADJUSTED,
        most=MOST_IMAGES,
        finish=_viewed,
    ),
    Program(
        name="mvsnet_cam",
        title="MVSNet camera (_cam.txt)",
        words="""\
MVSNet's ``_cam.txt``, one for each image, which its many descendants and BlendedMVS share.

In the format's own words::

    extrinsic
    0.970 0.007 0.241 -191.0
    …
    0.0 0.0 0.0 1.0

    intrinsic
    2892.33 0 823.205
    0 2883.18 619.071
    0 0 1

    425 2.5                        nearest depth, interval (number, farthest)

The images are undistorted; the file does not state their size. MVSNet counts from the corner of the image: its
converter copies COLMAP's cx and cy unchanged, and its warping has the pixels' centres at 0.5, 1.5, … of K. Its PyTorch
descendants put them at 0, 1, … for the same files, half a pixel off; a file that was made for those is read with
``--pixel-origin centre``.

Sources: MVSNet, README "Camera files"; ``mvsnet/preprocess.py``, ``load_cam``: nine numbers behind the word intrinsic,
row by row; ``mvsnet/colmap2mvsnet.py``, which writes them; ``mvsnet/homography_warping.py``, ``get_pixel_grids`` and
``interpolate``; MVSNet_pytorch, ``models/module.py``, ``homo_warping``.
""",
        suffixes=(".txt",),
        reference="https://github.com/YoYo000/MVSNet",
        syntaxes=TEXT,
        convention=Convention(
            origin=Origin.CORNER,
            tangential=Tangential.NONE,
            remarks=(
                "undistorted images",
                "the origin is MVSNet's own; its PyTorch descendants count from the pixel's centre",
            ),
        ),
        recognise=_is_mvsnet,
        load=_mvsnet,
        K="intrinsic",
        asks_origin=True,
        size=(),
        grade=Grade.ADJUSTED,
    ),
    Program(
        name="named_pinholes",
        title="ScanNet scene and Middlebury stereo calibration (.txt)",
        words="""\
ScanNet's ``sceneXXXX_XX.txt`` and Middlebury's ``calib.txt``: pinholes among a scene's numbers, name by name.

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
""",
        suffixes=(".txt",),
        reference="https://vision.middlebury.edu/stereo/data/scenes2014/",
        syntaxes=TEXT,
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            tangential=Tangential.NONE,
            remarks=(
                "Middlebury's images are rectified",
                "the origin is not stated",
            ),
        ),
        recognise=_is_named,
        load=_named,
        cameras=_named_cameras,
        K=("K",),
        asks_origin=True,
        size=("size",),
        model=("kind",),
        models={"": Model(lambda _: None), "rectified": Model(K="K")},
    ),
    Program(
        name="neus_npz",
        title="NeuS and IDR cameras (cameras_sphere.npz)",
        words="""\
``cameras_sphere.npz`` and ``cameras.npz`` of IDR, NeuS and their descendants: a projection matrix for each image.

In the format's own words::

    world_mat_0   4×4    K·[R | t] in its first three rows, for pixels
    scale_mat_0   4×4    takes the unit sphere to the object
    world_mat_1 …

calibrary decomposes each matrix into K, as the programs do with ``cv2.decomposeProjectionMatrix``; images whose K agree
are one camera. Pixels are counted by whole numbers, 0 being the first. ``camera_mat_0``, if it is there, is no K. The
file states neither image size nor distortion.

Sources: IDR, ``code/utils/rend_util.py``, ``load_K_Rt_from_P``; NeuS, ``models/dataset.py``, ``gen_rays_at``.
""",
        suffixes=(".npz",),
        reference="https://github.com/lioryariv/idr/blob/main/DATA_CONVENTION.md",
        syntaxes=BINARY,
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            tangential=Tangential.NONE,
            remarks=("K comes from an RQ decomposition; the file contains no distortion and no image size",),
        ),
        recognise=_is_neus,
        load=_neus,
        cameras=_counted,
        K=("K[0:1]", "K[1:2]", "K[2:3]", "K[3:4]", "K[4:]"),
        size=(),
        models=UNKNOWN_LENS,
        grade=Grade.DERIVED,
        assumptions=(ORIGIN_UNKNOWN,),
        most=MOST_IMAGES,
        finish=_viewed,
    ),
    Program(
        name="nsvf_intrinsics",
        title="NSVF, SRN and DeepVoxels intrinsics.txt",
        words="""\
``intrinsics.txt`` of NSVF, SRN, DeepVoxels and pixelNeRF scenes.

In the format's own words::

    1111.111 400 400 0.            f cx cy 0, or fx fy cx cy
    0. 0. 0.                       the scene's centre
    0.                             near plane, absent in some
    1.                             scale
    800 800                        height width

The scenes are rendered or undistorted, so there is no distortion. Where cx and cy count from is not stated; half the
image's side, which most files have, is the middle counted from the corner.

Source: scene-representation-networks, ``util.py``, ``parse_intrinsics``; NSVF, ``fairnr/data/data_utils.py``.
""",
        suffixes=(".txt",),
        reference="https://github.com/facebookresearch/NSVF",
        syntaxes=TEXT,
        convention=Convention(
            origin=Origin.CORNER,
            tangential=Tangential.NONE,
            remarks=(
                "height comes before width",
                "the origin is not stated",
            ),
        ),
        recognise=_is_nsvf,
        load=_nsvf,
        K=("K",),
        asks_origin=True,
        size=("size",),
    ),
    Program(
        name="nuscenes",
        title="nuScenes calibrated_sensor.json",
        words="""\
nuScenes' ``calibrated_sensor.json``: the cameras of every vehicle's calibration, among its other sensors.

In the format's own words::

    [{"token": "75ad8e2a8a3f4594a13db2398430d097", "sensor_token": "ec4b5d41…", "translation": […], "rotation": […],
      "camera_intrinsic": [[1262.8, 0.0, 786.7], [0.0, 1262.8, 437.9], [0.0, 0.0, 1.0]]},
     {"token": "…", "camera_intrinsic": []}, …]

A lidar or radar has an empty matrix. "All camera images come undistorted and rectified"; their size is in another
table.

Source: nuScenes, ``docs/schema_nuscenes.md``, "calibrated_sensor".
""",
        suffixes=(".json",),
        reference="https://www.nuscenes.org/nuscenes#data-format",
        syntaxes=JSON,
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            tangential=Tangential.NONE,
            remarks=(
                "undistorted images",
                "the origin is not stated",
            ),
        ),
        marks=(Mark(("camera_intrinsic", "sensor_token"), at="[0]"),),
        cameras=_nuscenes_cameras,
        K="camera_intrinsic",
        asks_origin=True,
        size=(),
        most=MOST_IMAGES,
    ),
    Program(
        name="polycam",
        title="Polycam camera",
        words="""\
Polycam's cameras: JSON of fx, fy, cx, cy and a pose, one file for each image.

In the format's own words::

    {"fx": 1360.2, "fy": 1360.2, "cx": 514.9, "cy": 385.3, "width": 1024, "height": 768, "t_00": 0.7, …}

The numbers are ARKit's, which count from the corner of the image. The images are not corrected, and no distortion is
stated.

Sources: Polycam, "Raw data export", whose program is closed; nerfstudio, ``process_data/polycam_utils.py``, which
copies the numbers unchanged to a transforms.json, and ``cameras/cameras.py``, ``get_image_coords``, which has the
pixels' centres at 0.5, 1.5, … of it.
""",
        suffixes=(".json",),
        reference="https://github.com/PolyCam/polyform",
        syntaxes=JSON,
        convention=Convention(
            origin=Origin.CORNER,
            remarks=("every number has its name",),
        ),
        marks=(Mark((*K4, "t_00", "t_01")),),
        K=K4,
        asks_origin=True,
        models=UNKNOWN_LENS,
    ),
    Program(
        name="record3d",
        title="Record3D metadata.json",
        words="""\
Record3D's ``metadata.json``: the camera of an iPhone's or iPad's recording with depth.

In the format's own words::

    {"w": 1440, "h": 1920, "dw": 192, "dh": 256, "fps": 60,
     "K": [1347.6, 0, 0, 0, 1347.6, 0, 720.2, 965.7, 1],
     "perFrameIntrinsicCoeffs": [[1347.6, 1347.6, 720.2, 965.7], …], "poses": […]}

K runs down the columns. ARKit's autofocus changes it from frame to frame; calibrary reads the file's own K and reports
how far the frames differ from it. Apple counts from the top-left corner of the image. The phone rectifies the images to
an unknown degree, so the distortion is not stated.

Sources: Record3D, "Exported metadata", whose program is closed; nerfstudio, ``process_data/record3d_utils.py``, which
transposes K and puts the principal point into the middle; Apple, "ARCamera.intrinsics".
""",
        suffixes=(".json",),
        reference="https://record3d.app/",
        syntaxes=JSON,
        convention=Convention(
            origin=Origin.CORNER,
            tangential=Tangential.NONE,
            remarks=("K runs down the columns", "the distortion is not stated"),
        ),
        marks=tuple(Mark(("K", "w", "h", key)) for key in ("dw", "perFrameIntrinsicCoeffs", "poses")),
        K="K",
        is_transposed=True,
        size=("w", "h"),
        models={"": Model(lambda _: None)},
        assumptions=(
            "Apple counts from the top-left corner of the image, which was taken for the first pixel's outer corner",
        ),
        finish=_record3d,
    ),
    Program(
        name="theia_priors",
        title="TheiaSfM calibration file",
        words="""\
TheiaSfM's calibration file: what is known of the cameras of a reconstruction before it begins.

In the format's own words::

    {"priors": [
        {"CameraIntrinsicsPrior": {
            "image_name": "view_1.jpg", "width": 752, "height": 480, "focal_length": 433.2, "aspect_ratio": 0.9993,
            "principal_point": [371.6, 238.3], "skew": 0.0, "camera_intrinsics_type": "PINHOLE_RADIAL_TANGENTIAL",
            "radial_distortion_coeffs": [-0.21, 0.04, 0.006], "tangential_distortion_coeffs": [-0.0004, 0.0008]}}, …]}

fy is aspect_ratio · focal_length. PINHOLE has two radial coefficients, PINHOLE_RADIAL_TANGENTIAL three and OpenCV's p1
and p2, FISHEYE the four of cv2.fisheye, FOV its angle and DIVISION_UNDISTORTION one number in pixels, which is refused.
Where the principal point counts from is not stated. Images whose numbers are the same are one camera.

Source: TheiaSfM, ``src/theia/io/read_calibration.h`` and ``sfm/camera/pinhole_radial_tangential_camera_model.h``.
""",
        suffixes=(".json", ".txt"),
        reference="https://github.com/sweeneychris/TheiaSfM",
        syntaxes=JSON,
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            coefficients=("k1", "k2", "k3", "p1", "p2"),
            remarks=(
                "fy is aspect_ratio times focal_length",
                "the origin is not stated",
            ),
        ),
        marks=(Mark(("CameraIntrinsicsPrior",), at="priors[0]"),),
        cameras=_theia_cameras,
        K=under("K", "fx fy cx cy skew"),
        asks_origin=True,
        model=("camera_intrinsics_type",),
        models={
            "PINHOLE": Model(_theia_lens, ("tangential", THEIA_RADIAL), (2, 3, 4), missing=0.0),
            "PINHOLE_RADIAL_TANGENTIAL": Model(
                _theia_lens, ("tangential", THEIA_RADIAL), (2, 3, 4, 5), missing=0.0
            ),
            "FISHEYE": Model(fisheye, (THEIA_RADIAL,), (4,)),
            "FOV": Model(field_of_view, (THEIA_RADIAL,), (1,)),
        },
        is_of_images=True,
        most=MOST_IMAGES,
        idle=(THEIA_RADIAL, "tangential_distortion_coeffs"),
        finish=_theia,
    ),
)
"""In alphabetical order."""
