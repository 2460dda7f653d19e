"""Rows of the table of programs' formats: what toolboxes and programs that calibrate a camera write.

To add one, add its row, and its sample with the formula computed independently to the tests of the formats.
"""

from __future__ import annotations

import json
import math
import re
import struct
from collections.abc import Sequence
from typing import Final

from calibrary.calibration import Calibration, Quality
from calibrary.distortion import (
    BrownConrady,
    Distortion,
    NoDistortion,
    required,
)
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Direction, Origin, Tangential
from calibrary.parsers.document import Node
from calibrary.parsers.format import Capacity, Option, ReadContext, Sniff, Sure, WriteContext
from calibrary.parsers.formats._json_text import loaded
from calibrary.parsers.formats._lenses import (
    BROWN5,
    COUNTS,
    FISHEYE4,
    OPENCV_ORDER,
    BrownWithoutK3,
    double_sphere,
    extended_unified,
    field_of_view,
    fisheye,
    lens,
    radial,
    smallest_lens,
)
from calibrary.parsers.formats._one_camera import refuse_model
from calibrary.parsers.formats._table import (
    FOUR,
    K4,
    MOST_BYTES,
    OF_RAY,
    Mark,
    Model,
    Named,
    Program,
    at,
    document_of,
    everywhere,
    find,
    listed,
    noted,
    numbers_at,
    numbers_of,
    one_each,
    taylor,
    turned,
    under,
    with_more,
    with_turn,
)
from calibrary.parsers.formats._text_rows import keyed, rows_of, text_of
from calibrary.records import Json, replace


def _calib_io_cameras(tree: Node, _context: ReadContext) -> Named:
    """Only the first camera of a kind has the model's name; later ones repeat the number that it got there."""
    names: dict[int, str] = {}
    for index, node in enumerate(at(tree, "Calibration.cameras").items()):
        model = node["model"]
        # cereal sets the highest bit of a number where the name that belongs to it stands beside it.
        number = model["polymorphic_id"].whole() & ~(1 << 31)
        if "polymorphic_name" in model:
            names[number] = model["polymorphic_name"].text()
        if number not in names:
            model["polymorphic_id"].fail(f"no camera before it gave {number} a name")
        body = model["ptr_wrapper"]["data"]
        f, ratio = one_each(body, under("parameters", "f.val ar.val"))
        yield f"cam{index}", with_more(body, {"kind": names[number], "fy": f * ratio})


def _calibu_cameras(tree: Node, _context: ReadContext) -> Named:
    yield from ((f"camera {index}", node) for index, node in enumerate(everywhere(tree, "camera_model")))


def _ftc_cameras(tree: Node, _context: ReadContext) -> Named:
    for camera in everywhere(tree, "Camera"):
        for node in everywhere(camera, "Calibration"):
            yield f"{at(camera, 'vid').text()} {at(camera, 'pid').text()} {at(node, 'size').text()}", node


def _photonvision_cameras(tree: Node, _context: ReadContext) -> Named:
    several = find(tree, "calibrations")
    for node in (tree,) if several is None else several.items():
        width, height = one_each(node, under("resolution", "width height"))
        yield f"{width:g}×{height:g}", node


def _photonvision(_tree: Node, node: Node, item: Calibration) -> Calibration:
    model = find(node, "lensmodel")
    if model is not None and not model.text().startswith("LENSMODEL_OPENCV"):
        refuse_model(model.text(), ("LENSMODEL_OPENCV",), place=model.place)
    errors = find(node, "perViewErrors")
    return item if errors is None else replace(item, quality=Quality(views=len(errors.items())))


def _slstudio_cameras(tree: Node, _context: ReadContext) -> Named:
    for name, keys in SLSTUDIO.items():
        yield name, Node({key: tree[key].value for key in keys if key in tree}, source=tree.source)


SLSTUDIO = {
    "camera": ("Kc", "kc", "frameWidth", "frameHeight"),
    "projector": ("Kp", "kp", "screenResX", "screenResY"),
}


PLUS_FAMILY, PLUS_HEADING = "ARToolKitPlus_CamCal_", "ARToolKitPlus_CamCal_Rev02"


PLUS_COUNT = 13


PLUS_BYTES = 64 * 1024
"""A hundred times what such a file contains."""


PLUS_ITERATIONS = "artoolkitplus_cal/undist_iterations"


PLUS_MOST_ITERATIONS = 20
"""What the program allows itself at most."""


PLUS_ORIGIN = (
    "the format does not say where cx and cy count from; they were read as counted from the centre of the "
    "top-left pixel, as in the toolbox that its files are filled in from"
)


def _is_plus(content: Content) -> Sniff | None:
    if content.first_line.startswith(PLUS_FAMILY):
        return Sniff(Sure.MAGIC, f"the first line is {strict.shown(content.first_line)}")
    return None


def _plus_numbers(data: bytes, context: ReadContext) -> Node:
    """The thirteen numbers of the line after the heading."""
    rows = [line for raw in text_of(data, most=PLUS_BYTES).splitlines() if (line := raw.strip())]
    if not rows or not rows[0].startswith(PLUS_FAMILY):
        raise ParseError(f"the first line is not {PLUS_HEADING}")
    if rows[0] != PLUS_HEADING:
        raise ParseError(f"its revision is {strict.shown(rows[0])}, expected {PLUS_HEADING}")
    if len(rows) == 1:
        raise ParseError("there is no line of numbers after the heading")
    return Node(
        {"numbers": [*strict.numbers(rows[1], count=PLUS_COUNT, place="second line")]}, source=context.name
    )


def _plus(_tree: Node, node: Node, item: Calibration) -> Calibration:
    sixth, iterations = numbers_at(node, ("numbers[11:]",))
    ignored = (f"the sixth coefficient, {sixth:g}, is read by no program",) if sixth else ()
    item = replace(item, extras=((PLUS_ITERATIONS, f"{iterations:.0f}"),))
    return noted(item, PLUS_ORIGIN, *ignored)


def _plus_written(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """Two lines; the count of iterations that stands last is not a part of the camera."""
    [item] = calibrations
    native = PLUS.native(item.intrinsics)
    made = required(item.distortion, BrownConrady)
    coefficients = (made.k1, made.k2, made.p1, made.p2, made.k3, 0.0)
    usual = str(PLUS_MOST_ITERATIONS if any(coefficients) else 0)
    numbers = (native.cx, native.cy, native.fx, native.fy, *coefficients)
    row = [*map(str, item.intrinsics.image_size), *map(repr, numbers)]
    row.append(dict(item.extras).get(PLUS_ITERATIONS, usual))
    return f"{PLUS_HEADING}\n{' '.join(row)}\n".encode()


PLUS = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=BROWN5,
    remarks=("the principal point comes before the focal lengths", "a sixth coefficient is not used"),
)


ADAPTER_MODEL = Option(
    name="model", values=("ucm",), meaning="whether a file with alpha alone is of UCM, and not cut short"
)


ADAPTERS: Final = {
    "DS": ({"alpha", "xi"},),
    "EUCM": ({"alpha"}, {"alpha", "beta"}),
    "KB": ({*FISHEYE4},),
    "RadTan": ({*BROWN5[:4]}, {*BROWN5}),
}
"""The parameters of a model, by which it is known."""


def _adapter_cameras(tree: Node, context: ReadContext) -> Named:
    node, image = tree["parameter"], tree["image"]
    node = with_more(node, {"size": [image["width"].value, image["height"].value]})
    if "coefficients" in node:
        c, d, e = (node[key].number() for key in ("c", "d", "e"))
        terms, centre = node["coefficients"]["unprojection"], one_each(node, ("cx", "cy"))
        affine = (c, 1 / c, e / c, d / c) if c else (0.0,) * 4
        yield None, with_more(with_turn(node, terms, affine, centre, "c"), {"kind": "OCamCalib"})
        return
    names = {*node.keys()} - {*K4, "size"}
    kind = next((kind for kind, every in ADAPTERS.items() if names in every), "")
    if not kind:
        raise UnsupportedModelError(
            f"the parameters are {', '.join(sorted(names)) or 'none'}, of no model that is known here; expected UCM, "
            "EUCM, DS, KB, RadTan or OCamCalib",
            place="parameter",
        )
    if (
        names == {"alpha"}
        and context.option(ADAPTER_MODEL.name) is None
        and "ucm" not in context.name.lower()
    ):
        node.fail(
            "alpha alone is UCM's, and also that of a file of DS or EUCM that was cut short; name the file UCM.yml "
            "or give --set model=ucm"
        )
    yield None, with_more(node, {"kind": kind})


def _adapter_eucm(values: Sequence[float]) -> Distortion:
    if not 0 <= values[0] <= 1:
        raise UnsupportedModelError(
            f"alpha is {values[0]:g}, expected 0 to 1: beyond, the model is another one, which is not known "
            "here; fit the camera with DS or KB in the tool",
            place="parameter.alpha",
        )
    return extended_unified(values)


QUALISYS = "Qualisys does not publish the lens's formula nor its origin; OpenCV's and the edge of the image were taken"


QUALISYS_PX = 64.0


def _qualisys_cameras(tree: Node, _context: ReadContext) -> Named:
    """With K in px, by the camera's serial."""
    seen = set[str]()
    for index, camera in enumerate(one for one in everywhere(tree, "camera") if "intrinsic" in one):
        node = camera["intrinsic"]
        serial = find(camera, "serial")
        name = str(serial.value) if serial is not None and serial.value else f"camera {index}"
        if name in seen:
            tree.fail("two cameras have the same serial")
        seen.add(name)
        if node["skew"].number():
            raise UnsupportedModelError("skew is not 0, and its unit is not published", place=name)
        fx, fy, u, v, left, top, right, bottom = (
            value / QUALISYS_PX
            for value in one_each(
                node,
                ("focalLengthU", "focalLengthV", "centerPointU", "centerPointV", "sensorMinU", "sensorMinV",
                 "sensorMaxU", "sensorMaxV"),
            )
        )  # fmt: skip
        view = find(camera, "viewrotation")
        yield (
            name,
            with_more(
                node,
                {
                    "K": [fx, fy, u - left, v - top],
                    "size": [float(round(right - left)), float(round(bottom - top))],
                    "view": str(view.value) if view is not None else "",
                    "none": 0.0,
                },
            ),
        )


def _qualisys(_tree: Node, node: Node, item: Calibration) -> Calibration:
    turned = node["view"].value
    if turned in ("", "0"):
        return item
    return noted(item, f"the video is shown turned by {turned}°; K is of the sensor's own frame")


_WHOLE = re.compile(r"\d{1,7}(?:\.0*)?", re.ASCII)


PARAM = ">2i12d"


PARAM_FACTORS = {4: (1, 2), 6: (3,), 9: (4,), 17: (5,)}
"""ARToolKit's versions by the count of dist_factor."""


PARAM_LENGTHS = {struct.calcsize(f"{PARAM}{count}d"): count for count in PARAM_FACTORS}


PARAM_AGREEMENT = 1e-3


def _is_eight(content: Content) -> Sniff | None:
    parts = (content.text or "").split(maxsplit=9)
    if len(parts) != 8 or not all(_WHOLE.fullmatch(part) for part in parts[:2]) or not numbers_of(parts):
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
    return document_of(context, size=[width, height], K=[f, f, cx, cy], k=[*k])


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
    return document_of(context, size=[width, height], K=[fx, fy, cx, cy], k=[*k])


BLUEC = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=BROWN5[:4],
    remarks=("lines are read by their position", "alpha_c, if stated, is the skew as a fraction of fx"),
)
BLUEC_K = tuple(f"K{row}{column}" for row in "123" for column in "123")
BLUEC_LENS = tuple(f"kc{number}" for number in range(1, 10))
BLUEC_SKEW = (
    "the skew was taken as K has it; MultiCamSelfCal passes it over when it corrects points for the lens"
)


def _is_bluec(content: Content) -> Sniff | None:
    """K by its elements and kc by its own, one to a line."""
    if content.first_line.replace(" ", "").startswith("K11=") and any(
        line.startswith("kc1") for line in content.lines
    ):
        return Sniff(Sure.MAGIC, "the lines K11 = … and kc1 = … are those of MultiCamSelfCal")
    return None


def _bluec(data: bytes, context: ReadContext) -> Node:
    tree = keyed(data, context.name, comments="%", most=MOST_BYTES)
    odd = [key for key, _ in tree.entries() if key not in {*BLUEC_K, *BLUEC_LENS, "alpha_c"}]
    if odd:
        tree[odd[0]].fail("it is none of K11 … K33, kc1 … and alpha_c")
    K = one_each(tree, BLUEC_K)
    one_each(tree, BLUEC_LENS[:4])
    skew, stated = K[1], one_each(tree, ("alpha_c",), missing=0.0)[0] * K[0]
    if skew and "alpha_c" in tree and abs(stated - skew) > 1e-6 * K[0]:
        tree["alpha_c"].fail(f"K12 is {skew:g} and alpha_c·K11 is {stated:g}; expected the same skew")
    return with_more(tree, {"K": [K[0], skew or stated, *K[2:]]})


def _bluec_lens(values: Sequence[float]) -> Distortion:
    if any(values[5:]):
        raise UnsupportedModelError(
            "it contains more than five coefficients, of which only k1 k2 p1 p2 k3 are known"
        )
    return lens(values[:5])


def _bluec_written(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """The lines in the places where the programs look for them."""
    [item] = calibrations
    native = BLUEC.native(item.intrinsics)
    made = required(item.distortion, BrownWithoutK3)
    K = (native.fx, 0.0, native.cx, 0.0, native.fy, native.cy, 0.0, 0.0, 1.0)
    rows = [f"{name} = {value!r}" for name, value in zip(BLUEC_K, K, strict=True)]
    rows += ["", *(f"{n} = {v!r}" for n, v in zip(BLUEC_LENS, made.coefficients.values(), strict=False)), ""]
    return "".join(f"{row}\n" for row in rows).encode()


OCAM_HEADING = "#polynomial coefficients for the DIRECT mapping function"
OCAM_CLEARLY = 2.0
"""How many times farther from the image's middle the other reading of a centre is, at least."""
OCAM_MOST = 64
"""Coefficients in either function, as in the toolbox's own reader."""


def _is_ocam(content: Content) -> Sniff | None:
    """The first heading is the same in every file; in JSON the two polynomials."""
    if {"pol", "invpol", "xc", "yc"} <= set(content.json_keys):
        return Sniff(Sure.MAGIC, "JSON with pol, invpol, xc and yc")
    if content.first_line.replace("# ", "#", 1).startswith(OCAM_HEADING):
        return Sniff(Sure.MAGIC, "the first line is OCamCalib's heading of the direct mapping function")
    return None


def _ocam(data: bytes, context: ReadContext) -> Node:
    """The names of OCamCalib's C structure, of JSON or of the five rows of numbers."""
    if data.lstrip().startswith(b"{"):
        return loaded(data, context)
    text = text_of(data, most=MOST_BYTES)
    if not text.lstrip().startswith("#"):
        raise ParseError(f"it does not begin with {OCAM_HEADING}")
    rows = [row for raw in strict.lines(text) if (row := raw.strip()) and not row.startswith("#")]
    if len(rows) != 5:
        raise ParseError(f"{len(rows)} rows of numbers, expected 5")
    place = "direct mapping function"
    count, *terms = rows[0].split()
    promised = strict.whole(count, place=place)
    if not 1 <= promised <= OCAM_MOST:
        raise ParseError(f"{promised} coefficients, expected 1 to {OCAM_MOST}", place=place)
    pol = strict.numbers(" ".join(terms), count=promised, place=place)
    if not pol[0] < 0:
        raise ParseError(f"a0 is {pol[0]:g}, expected a negative one: the axis points backwards", place=place)
    xc, yc = strict.numbers(rows[2], count=2, place="center")
    c, d, e = strict.numbers(rows[3], count=3, place="affine parameters")
    height, width = strict.numbers(rows[4], count=2, place="image size")
    known: dict[str, Json] = {"pol": [*pol], "invpol": rows[1], "xc": xc, "yc": yc, "c": c, "d": d, "e": e}
    return document_of(context, **known, width=width, height=height)


def _ocam_cameras(tree: Node, _context: ReadContext) -> Named:
    """In JSON some turn the axis forwards, and some write the centre's column first."""
    pol = tree["pol"].numbers()
    terms: list[Json] = [-value for value in pol] if pol and pol[0] < 0 else [*pol]
    width, height = tree.image_size("width", "height")
    xc, yc, c, d, e = one_each(tree, ("xc", "yc", "c", "d", "e"))
    is_column_first = False
    if not isinstance(tree["invpol"].value, str):
        off = [math.hypot(x / width - 0.5, y / height - 0.5) for x, y in ((xc, yc), (yc, xc))]
        if min(off) * OCAM_CLEARLY > max(off):
            tree["xc"].fail(
                f"it is not clear whether xc {xc:g} and yc {yc:g} are column and row or, as OCamCalib's, row and "
                "column; write the camera as OCamCalib's calib_results.txt"
            )
        is_column_first = off[0] < off[1]
    affine = (c, 1 / c, e / c, d / c) if is_column_first and c else (1.0, c, d, e)
    centre, order = ((xc, yc), "column and row") if is_column_first else ((yc, xc), "row and column")
    node = with_turn(tree, replace(tree["pol"], value=terms), affine, centre, "affine parameters")
    yield None, with_more(node, {"terms": terms, "order": order})


def _ocam_finished(_tree: Node, node: Node, item: Calibration) -> Calibration:
    inverse = node["invpol"]
    text = inverse.value if isinstance(inverse.value, str) else " ".join(map(json.dumps, inverse.numbers()))
    if inverse.value is not text:
        item = noted(item, f"xc and yc were taken as {node['order'].text()}, by the image size")
    return turned(node, replace(item, extras=(("ocamcalib/invpol", " ".join(text.split())),)), "OCamCalib's")


ROWS: Final = (
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
        models={"": Model(radial, ("k",))},
        finish=lambda _tree, _node, item: noted(
            item, "the format omits tangential terms and the difference of fx and fy"
        ),
    ),
    Program(
        name="anipose",
        title="Anipose calibration (TOML)",
        words="""\
Anipose's ``calibration.toml``, which aniposelib, Pose2Sim, FreeMoCap and sleap-anipose share.

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
""",
        suffixes=(".toml",),
        reference="https://anipose.readthedocs.io/en/latest/",
        convention=Convention(origin=Origin.PIXEL_CENTRE, coefficients=OPENCV_ORDER[:5], remarks=(FOUR,)),
        marks=(Mark((), inner=("matrix", "distortions", "size"), words=("[", "=")),),
        cameras=lambda tree, _: (
            (str(node.value.get("name") or key), node)
            for key, node in tree.entries()
            if isinstance(node.value, dict) and "matrix" in node
        ),
        K="matrix",
        size=("size",),
        model=("fisheye",),
        models={
            **{mark: Model(lens, ("distortions",), COUNTS) for mark in ("", "false")},
            "true": Model(fisheye, ("distortions",), (4,)),
        },
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
        name="artoolkitplus_cal",
        title="ARToolKitPlus camera calibration",
        words="""\
ARToolKitPlus camera calibration, Rev02: a heading and one line of numbers.

In the format's own words::

    ARToolKitPlus_CamCal_Rev02
    xsize ysize cc_x cc_y fc_x fc_y kc1 kc2 kc3 kc4 kc5 kc6 undist_iterations

The principal point comes before the focal lengths. The numbers are those of Bouguet's Camera Calibration Toolbox, from
which the files are filled in by hand or by a script: kc1 … kc5 are k1, k2, p1, p2, k3, and kc6 is not used. The program
does not read what follows the line of numbers.

Sources: ARToolKitPlus, ``Camera.cpp`` and ``Camera.h``; J.-Y. Bouguet, "Description of the calibration
parameters".
""",
        suffixes=(".cal",),
        reference="https://github.com/paroj/artoolkitplus",
        convention=PLUS,
        recognise=_is_plus,
        load=_plus_numbers,
        K=("numbers[4:6]", "numbers[2:4]"),
        size=("numbers[0:2]",),
        models={"": Model(lens, ("numbers[6:11]",))},
        finish=_plus,
        write=_plus_written,
        capacity=Capacity(models=(NoDistortion, BrownConrady)),
    ),
    Program(
        name="bluec_rad",
        title="blue-c (CalTech, MultiCamSelfCal) camera parameters",
        words="""\
blue-c's ``.rad`` (also ``.cal``): CalTech's camera parameters for MultiCamSelfCal, one to a line.

In the format's own words::

    K11 = 422.3
    K12 = 0.0
    …
    K33 = 1.0

    kc1 = -0.28      % k1
    kc2 = 0.07       % k2
    kc3 = 0.0004     % p1
    kc4 = -0.0001    % p2

The programs read the lines by their position: nine of K, an empty line, and four coefficients of Bouguet's Camera
Calibration Toolbox; there is no line for a fifth. Some files end with ``alpha_c = …``, the skew as a fraction of fx.
The image size is not in the file.

Source: MultiCamSelfCal, ``RadialDistortions/readradfile.m`` and ``undoradial.m``; J.-Y. Bouguet, "Description
of the calibration parameters".
""",
        suffixes=(".rad", ".cal"),
        reference="https://github.com/strawlab/MultiCamSelfCal",
        convention=BLUEC,
        recognise=_is_bluec,
        load=_bluec,
        K="K",
        size=(),
        models={"": Model(_bluec_lens, BLUEC_LENS, missing=0.0)},
        finish=lambda _tree, _node, item: noted(item, BLUEC_SKEW) if item.intrinsics.skew else item,
        write=_bluec_written,
        capacity=Capacity(models=(NoDistortion, BrownWithoutK3)),
    ),
    Program(
        name="calib_io",
        title="calib.io Camera Calibrator",
        words="""\
calib.io's Camera Calibrator, the calibration it saves as JSON.

In the format's own words::

    {"Calibration": {"cameras": [{
        "model": {"polymorphic_id": 2147483649, "polymorphic_name": "libCalib::CameraModelOpenCV",
                  "ptr_wrapper": {"valid": 1, "data": {
                      "CameraModelCRT": {"CameraModelBase": {"imageSize": {"width": 5472, "height": 3648}}},
                      "parameters": {"f": {"val": 3650.1, "state": 2}, "ar": {"val": 0.9996, "state": 2},
                                     "cx": …, "cy": …, "k1": … "k6", "p1", "p2", "s1" … "s4", "tauX", "tauY"}}}},
        "transform": …}]}}

fx = f and fy = f·ar; the coefficients are OpenCV's by name. Only the first camera of a kind has the model's name; later
ones repeat the number that it got there.

Source: calib.io, ``readCalibParameters.cpp`` (public domain); cereal's polymorphic pointers.
""",
        suffixes=(".json",),
        reference="https://calib.io/pages/camera-calibrator",
        convention=Convention(
            origin=Origin.PIXEL_CENTRE, remarks=("fx = f, fy = f·ar", "coefficients are named as OpenCV's")
        ),
        marks=(Mark(("Calibration",), words=('"libCalib::',)),),
        cameras=_calib_io_cameras,
        K=("parameters.f.val", "fy", "parameters.cx.val", "parameters.cy.val"),
        size=under("CameraModelCRT.CameraModelBase.imageSize", "width height"),
        model=("kind",),
        models={
            "libCalib::CameraModelOpenCV": Model(
                smallest_lens,
                tuple(f"parameters.{name}.val" for name in (*OPENCV_ORDER[:12], "tauX", "tauY")),
            )
        },
    ),
    Program(
        name="calibu",
        title="Calibu camera rig (vicalib)",
        words="""\
Calibu's camera rigs (``cameras.xml``), which vicalib writes.

In the format's own words::

    <rig>
      <camera>
        <camera_model name="" index="0" serialno="0" type="calibu_fu_fv_u0_v0_k1_k2_k3" version="8">
          <width> 640 </width>
          <height> 480 </height>
          <params> [ 433.2; 432.9; 371.6; 238.3; -0.21; 0.04; 0 ] </params>
        </camera_model>
        <pose> … </pose>
      </camera>
    </rig>

The type lists the parameters: none after u0 v0 is a pinhole, k1 k2 k3 are factors of r², r⁴ and r⁶, w is the FOV
model's angle and kb4 Kannala and Brandt's four. Where u0 and v0 count from is not stated; vicalib's corners are those
of OpenCV's pixels.

Source: Calibu, ``include/calibu/cam/camera_models_*.h`` and ``src/cam/camera_xml.cpp``.
""",
        suffixes=(".xml",),
        reference="https://github.com/arpg/Calibu",
        roots=("rig", "camera", "camera_model"),
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            tangential=Tangential.NONE,
            coefficients=("k1", "k2", "k3"),
            remarks=("the model's type lists its parameters", "the origin is not stated; OpenCV's is used"),
        ),
        marks=(Mark(("camera_model", "params")),),
        cameras=_calibu_cameras,
        K=("params[0:4]",),
        model=("type",),
        models={
            f"calibu_fu_fv_u0_v0{rest}": Model(made, ("params[4:]",), (count,))
            for rest, made, count in (
                ("", lens, 0),
                ("_w", field_of_view, 1),
                ("_k1_k2", radial, 2),
                ("_k1_k2_k3", radial, 3),
                ("_kb4", fisheye, 4),
            )
        },
        assumptions=(
            "Calibu does not state where u0 and v0 count from; the centre of the top-left pixel was taken",
        ),
    ),
    Program(
        name="fisheye_adapter",
        title="Fisheye-Calib-Adapter camera",
        words="""\
Fisheye-Calib-Adapter's camera models in YAML, between which the tool converts.

In the format's own words::

    image: {width: 752, height: 480}
    parameter:
      fx: 348.11
      fy: 347.11
      cx: 365.81
      cy: 249.36
      alpha: 0.5657        # UCM: alpha; EUCM: alpha, beta; DS: alpha, xi; KB: k1 … k4
      xi: -0.2443

The model is the file's name (``DS.yml``), and the names of the parameters tell it as well. UCM's alpha is EUCM's with
beta = 1. OCamCalib's model is read from the ray polynomial (``unprojection``), from the other one nothing is taken.

Sources: S. Lee, "Fisheye-Calib-Adapter", 2024, ``FCA``'s ``model/*.cpp`` (``parse``, ``project``); the models' own
papers.
""",
        suffixes=(".yml", ".yaml"),
        reference="https://github.com/eowjd0512/fisheye-calib-adapter",
        convention=Convention(
            origin=Origin.PIXEL_CENTRE, remarks=("the names of the parameters tell the model",)
        ),
        marks=(Mark(("image", "parameter"), inner=("cx",)),),
        cameras=_adapter_cameras,
        K=K4,
        size=("size",),
        model=("kind",),
        models={
            "DS": Model(double_sphere, ("xi", "alpha")),
            "EUCM": Model(_adapter_eucm, ("alpha", "beta"), missing=1.0),
            "KB": Model(fisheye, FISHEYE4),
            "RadTan": Model(lens, BROWN5, missing=0.0),
            "OCamCalib": Model(taylor, ("coefficients.unprojection",), K=OF_RAY),
        },
        options=(ADAPTER_MODEL,),
        finish=lambda _tree, node, item: turned(node, item, "the file's"),
    ),
    Program(
        name="ftc_webcams",
        title="FTC webcam calibrations",
        words="""\
The webcam calibrations of FIRST Tech Challenge's SDK, ``teamwebcamcalibrations.xml``.

In the format's own words::

    <Calibrations>
      <Camera vid="Logitech" pid="0x085C">
        <Calibration size="640 480" focalLength="602.5, 603.25" principalPoint="318.75, 241.5"
                     distortionCoefficients="0.11, -0.24, 0.001, -0.0005, 0.09, 0, 0, 0"/>

Focal lengths and principal point are px, and the coefficients are OpenCV's: k1 k2 p1 p2 k3 k4 k5 k6.

Source: FtcRobotController, ``FtcRobotController/src/main/res/xml/teamwebcamcalibrations.xml``, its comment.
""",
        suffixes=(".xml",),
        reference="https://github.com/FIRST-Tech-Challenge/FtcRobotController",
        roots=("Calibrations",),
        convention=Convention(origin=Origin.PIXEL_CENTRE, coefficients=OPENCV_ORDER[:8]),
        marks=(Mark(("Calibrations", "Camera", "Calibration"), words=("focalLength", "principalPoint")),),
        cameras=_ftc_cameras,
        K=("focalLength[0:2]", "principalPoint[0:2]"),
        size=("size[0:2]",),
        models={"": Model(smallest_lens, ("distortionCoefficients[0:]",), COUNTS)},
    ),
    Program(
        name="multical",
        title="multical calibration.json",
        words="""\
multical's ``calibration.json``: the cameras of a rig, each with OpenCV's model.

In the format's own words::

    {"cameras": {"cam1": {"model": "standard", "image_size": [1920, 1080],
                          "K": [[1361.8, 0, 959.5], [0, 1361.8, 539.5], [0, 0, 1]],
                          "dist": [[-0.0154, 0, 0, 0, 0]]}},
     "camera_poses": {…}, "image_sets": {…}}

``model`` says which flag ``cv2.calibrateCamera`` was given (standard, rational, thin_prism, tilted), and the number
of coefficients says the same. A fisheye is cv2.fisheye's.

Source: multical, ``multical/io/export_calib.py`` and ``multical/camera.py``.
""",
        suffixes=(".json",),
        reference="https://github.com/oliver-batchelor/multical",
        convention=Convention(origin=Origin.PIXEL_CENTRE, coefficients=OPENCV_ORDER, remarks=(FOUR,)),
        marks=(Mark(("K", "dist", "image_size"), at="cameras.*"),),
        cameras=listed("cameras"),
        K="K",
        size=("image_size",),
        model=("model",),
        models={
            **{
                name: Model(lens, ("dist",), COUNTS)
                for name in ("", "standard", "rational", "thin_prism", "tilted")
            },
            "fisheye": Model(fisheye, ("dist",), (4,)),
        },
    ),
    Program(
        name="ocamcalib",
        title="OCamCalib (Scaramuzza) calib_results.txt",
        words="""\
``calib_results.txt`` of OCamCalib, D. Scaramuzza's toolbox for omnidirectional cameras.

In the format's own words, headings beginning with ``#`` in between::

    5 -3.2e+02 0.0 8.6e-04 -3.5e-08 6.7e-09        the DIRECT mapping function, a0 a1 a2 a3 a4
    11 407.2 159.7 …                                the inverse mapping function
    261.7 326.9                                     center: "row" and "column", from 0
    1.0020 0.0014 0.0001                            affine parameters "c", "d", "e"
    480 640                                         image size: "height" and "width"

A ray is (x, y, a0 + a2·ρ² + …) of the sensor's x (down) and y (right), with row = c·x + d·y + centre and column = e·x +
y + centre. The third axis points backwards, so a0 is negative, and −a0 is the focal length on the axis. K is f·(1 e; d
c) brought to its upper triangle; where d is not zero that turns the camera about its axis, by as much as the notes say.
The inverse function is a fit to the direct one, so calibrary reads the direct one.

Sources: OCamCalib, ``ocam_functions.cpp``; D. Scaramuzza and others, IROS 2006.
""",
        suffixes=(".txt", ".json"),
        reference="https://sites.google.com/site/scarabotix/ocamcalib-omnidirectional-camera-calibration-toolbox-for-matlab",
        convention=Convention(
            origin=Origin.PIXEL_CENTRE,
            direction=Direction.DISTORTED_TO_UNDISTORTED,
            tangential=Tangential.NONE,
            coefficients=("a0", "a1", "a2", "a3", "a4"),
            remarks=(
                "rows come before columns",
                "the polynomial takes a radius in px to the ray's third component",
            ),
        ),
        recognise=_is_ocam,
        load=_ocam,
        cameras=_ocam_cameras,
        K=OF_RAY,
        models={"": Model(taylor, ("terms",))},
        finish=_ocam_finished,
    ),
    Program(
        name="photonvision",
        title="PhotonVision camera calibration",
        words="""\
PhotonVision's camera calibration, exported as JSON, and Chameleon Vision's before it.

In the format's own words::

    {"resolution": {"width": 640.0, "height": 480.0},
     "cameraIntrinsics": {"rows": 3, "cols": 3, "type": 6, "data": [699.4, 0.0, 345.6, …]},
     "distCoeffs": {"rows": 1, "cols": 5, "type": 6, "data": [0.1438, -0.9851, -0.0182, 0.0110, 1.9833]},
     "perViewErrors": […], "standardDeviation": 0.0635, "lensmodel": "LENSMODEL_OPENCV"}

Older versions call the coefficients cameraExtrinsics, and one of them had isFisheye. The numbers are OpenCV's; the
calibrations of several resolutions are in a camera's settings under ``calibrations``. mrcal's other lens models, which
have a name under lensmodel as well, are refused.

Source: PhotonVision, ``CameraCalibrationCoefficients.java``.
""",
        suffixes=(".json",),
        reference="https://docs.photonvision.org/en/latest/docs/calibration/calibration.html",
        convention=Convention(origin=Origin.PIXEL_CENTRE, coefficients=OPENCV_ORDER[:8], remarks=(FOUR,)),
        marks=(
            Mark(("resolution", "cameraIntrinsics")),
            Mark(("resolution", "cameraIntrinsics"), at="calibrations[0]"),
        ),
        cameras=_photonvision_cameras,
        K="cameraIntrinsics",
        size=under("resolution", "width height"),
        model=("isFisheye",),
        models={
            **{mark: Model(lens, ("distCoeffs|cameraExtrinsics",), COUNTS) for mark in ("", "false")},
            "true": Model(fisheye, ("distCoeffs|cameraExtrinsics",), (4,)),
        },
        finish=_photonvision,
    ),
    Program(
        name="qualisys",
        title="Qualisys and Theia Markerless camera calibration",
        words="""\
Qualisys Track Manager's camera calibration (``.qca.txt``, XML), which Theia Markerless and Pose2Sim share.

In the format's own words::

    <calibration type="regular" …>
      <cameras>
        <camera active="1" serial="26580" model="Miqus Video" viewrotation="0">
          <transform x="4263.3" … r33="1"/>
          <intrinsic focallength="9.27" sensorMinU="0" sensorMaxU="122879" sensorMinV="0" sensorMaxV="69631"
            focalLengthU="107872.6" focalLengthV="107880.3" centerPointU="60827.3" centerPointV="32684.0" skew="0"
            radialDistortion1="-0.0454" radialDistortion2="0.1396" radialDistortion3="0"
            tangentalDistortion1="0.0006" tangentalDistortion2="-0.0004"/>

Lengths are in 64ths of a pixel, from 0 at the image's edge to 64 times the number of pixels; sensorMax is the last of
them. "tangental" is the program's own spelling. The direction and the order of the distortion are not published.
calibrary uses those of OpenCV, as the converters of Theia and Pose2Sim do.

Sources: Qualisys, "Real-time server protocol", settings of the calibration; Theia Markerless, "Camera calibration";
Pose2Sim, ``Utilities/calib_toml_to_qca.py``.
""",
        suffixes=(".txt", ".xml"),
        reference="https://docs.qualisys.com/qtm-rt-protocol/",
        syntaxes=(Syntax.XML,),
        convention=Convention(
            origin=Origin.CORNER,
            coefficients=("k1", "k2", "k3", "p1", "p2"),
            remarks=(
                "lengths are in 64ths of a pixel",
                "the direction of the distortion is not published; OpenCV's is used",
            ),
        ),
        marks=(Mark(("intrinsic",), words=("tangentalDistortion1=",)),),
        cameras=_qualisys_cameras,
        K=("K",),
        size=("size",),
        models={
            "": Model(
                lens,
                (
                    *(
                        "radialDistortion1",
                        "radialDistortion2",
                        "tangentalDistortion1",
                        "tangentalDistortion2",
                    ),
                    "radialDistortion3|none",
                ),
            )
        },
        assumptions=(QUALISYS,),
        finish=_qualisys,
    ),
    Program(
        name="slstudio",
        title="SLStudio structured-light calibration",
        words="""\
SLStudio's ``calibration.xml``: the camera and the projector of a structured-light scanner.

In the format's own words::

    <opencv_storage>
      <Kc type_id="opencv-matrix">…</Kc>      the camera's K
      <kc type_id="opencv-matrix">…</kc>      its k1 k2 p1 p2 k3
      <Kp type_id="opencv-matrix">…</Kp>      the projector's, as a camera the other way round
      <kp type_id="opencv-matrix">…</kp>
      <Rp>…</Rp> <Tp>…</Tp>
      <frameWidth>1024</frameWidth> <frameHeight>544</frameHeight>
      <screenResX>912</screenResX> <screenResY>1140</screenResY>

Everything is OpenCV's.

Source: SLStudio, ``src/calibrator/CalibrationData.cpp``.
""",
        suffixes=(".xml",),
        reference="https://github.com/jakobwilm/slstudio",
        syntaxes=(Syntax.XML, Syntax.TEXT),
        roots=("opencv_storage",),
        convention=Convention(origin=Origin.PIXEL_CENTRE, coefficients=OPENCV_ORDER[:5]),
        marks=(Mark(("Kc", "kc", "Kp")),),
        cameras=_slstudio_cameras,
        K="Kc|Kp",
        size=("frameWidth|screenResX", "frameHeight|screenResY"),
        models={"": Model(lens, ("kc|kp",), COUNTS)},
    ),
)
"""In alphabetical order."""
