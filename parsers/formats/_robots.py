"""Rows of the table of programs' formats: the cameras of robots, of what sees for them, and of motion capture.

To add one, add its row, and its sample with the formula computed independently to the tests of the formats.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Final

from calibrary.calibration import Calibration, Grade
from calibrary.distortion import BrownConrady, Distortion, Division, KannalaBrandt, NoDistortion, required
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Capacity, Option, ReadContext, Sniff, Sure, WriteContext
from calibrary.parsers.formats._json_text import restored
from calibrary.parsers.formats._one_camera import ORIGIN_UNKNOWN, fisheye, size_of
from calibrary.parsers.formats._opencv_lens import OPENCV_ORDER, BrownWithoutK3, lens, smallest_lens
from calibrary.parsers.formats._table import (
    Mark,
    Model,
    Named,
    Program,
    double_sphere,
    everywhere,
    extended_unified,
    find,
    noted,
    numbers_at,
    rest_of,
    under,
    with_more,
    with_rest,
)
from calibrary.parsers.formats._taylor import taylor_lens, upper_triangle
from calibrary.parsers.formats._text_rows import text_of
from calibrary.parsers.formats._yaml_text import decimal, flow, scalar
from calibrary.records import replace

TEXT, XML = (Syntax.TEXT,), (Syntax.XML,)
K4 = ("fx", "fy", "cx", "cy")
BROWN5, FISHEYE4 = OPENCV_ORDER[:5], ("k1", "k2", "k3", "k4")

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

EUROC = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=BROWN5[:4],
    remarks=(
        "equidistant's four are k1, k2, k3, k4",
        "Kimera's omni has a ray's polynomial of the radius in px, from distorted to undistorted, as OCamCalib",
    ),
)
EUROC_KEYS = (
    "resolution", "camera_model", "intrinsics", "distortion_model", "distortion_coefficients", "omni_affine",
    "omni_distortion_center", "omni_pol_inv",
)  # fmt: skip
EUROC_REST = "euroc/"


def _taylor(values: Sequence[float]) -> Distortion:
    return taylor_lens(values, place="")[0]


def _with_turn(node: Node, terms: Node, affine: Sequence[float], centre: Sequence[float], place: str) -> Node:
    """A camera of a ray's polynomial and of the matrix s·(1 e; d c), with K and the angle to its frame."""
    _, f = taylor_lens(terms.numbers(), place=terms.place or "")
    s, c, d, e = affine
    fx, skew, fy, turn = upper_triangle(f * s, c, d, e, place=place)
    cx, cy = centre
    return with_more(node, {"ray": {"fx": fx, "fy": fy, "cx": cx, "cy": cy, "skew": skew, "turn": turn}})


OF_RAY = under("ray", "fx fy cx cy skew")


def _turned(node: Node, item: Calibration, whose: str) -> Calibration:
    found = find(node, "ray.turn")
    if found is None or not found.number():
        return item
    angle = math.degrees(found.number())
    return noted(item, f"the camera's frame is turned about its axis by {angle:.4f}° against {whose}")


def _euroc_cameras(tree: Node, _context: ReadContext) -> Named:
    tree["resolution"].numbers(2)
    if tree["camera_model"].text() == "omni":
        a, b, c = tree["omni_affine"].numbers(3)
        centre = tree["omni_distortion_center"].numbers(2)
        tree = _with_turn(tree, tree["distortion_coefficients"], (1.0, c, b, a), centre, "omni_affine")
    yield None, tree


def _euroc(_tree: Node, node: Node, item: Calibration) -> Calibration:
    return _turned(node, with_rest(item, node, EUROC_REST, (*EUROC_KEYS, "ray")), "Kimera's")


def _euroc_written(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """EuRoC's own keys, the resolution last; T_BS and the rest go back where the file they came from had them."""
    [item] = calibrations
    K, made = item.intrinsics, item.distortion or NoDistortion()
    native = EUROC.native(K)
    rest = {"sensor_type": json.dumps("camera")} | rest_of(item, EUROC_REST)
    rows = [f"{key}: {scalar(restored(text))}" for key, text in rest.items() if key.isidentifier()]
    kind = "equidistant" if isinstance(made, KannalaBrandt) else "radial-tangential"
    rows += [
        "camera_model: pinhole",
        f"intrinsics: {flow([native.fx, native.fy, native.cx, native.cy])}",
        f"distortion_model: {kind}",
        f"distortion_coefficients: {flow(list(made.coefficients.values()) or [0.0] * 4)}",
        f"resolution: [{K.image_size[0]}, {K.image_size[1]}]",
    ]
    return "".join(f"{row}\n" for row in rows).encode()


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
        terms, centre = node["coefficients"]["unprojection"], numbers_at(node, ("cx", "cy"))
        affine = (c, 1 / c, e / c, d / c) if c else (0.0,) * 4
        yield None, with_more(_with_turn(node, terms, affine, centre, "c"), {"kind": "OCamCalib"})
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


ORTHORITY_LENS = (*OPENCV_ORDER[:12], "tx", "ty")


def _orthority_cameras(tree: Node, _context: ReadContext) -> Named:
    """With K in px, of a focal length in the sensor's unit, or in widths of the image."""
    for name, node in [(None, tree)] if "im_size" in tree else tree.entries():
        width, height = size_of(node["im_size"])
        focal = node["focal_len"]
        fx, fy = focal.numbers(2) if isinstance(focal.value, list) else (focal.number(),) * 2
        sensor = find(node, "sensor_size")
        across, down = (1.0, height / width) if sensor is None else sensor.numbers(2)
        if sensor is not None and min(across, down) <= 0:
            sensor.fail("the sensor's size is not positive")
        cx, cy = (value * max(width, height) for value in numbers_at(node, ("cx", "cy"), missing=0.0))
        yield name, with_more(node, {"K": [fx * width / across, fy * height / down, cx, cy]})


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
            for value in numbers_at(
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


STELLA = Convention(
    origin=Origin.PIXEL_CENTRE, remarks=("coefficients are named; fisheye's four are k1, k2, k3, k4",)
)
STELLA_BLOCK, STELLA_REST = "Camera", "stella_vslam/"
STELLA_LENSES = {
    "perspective": Model(lens, BROWN5),
    "fisheye": Model(fisheye, FISHEYE4),
    "radial_division": Model(
        lambda values: Division(k=values[0]) if values[0] else NoDistortion(), ("distortion",)
    ),
}
STELLA_KEYS = {
    "model",
    *K4,
    "cols",
    "rows",
    *(key for model in STELLA_LENSES.values() for key in model.numbers),
}
STELLA_NEEDED = {"name": json.dumps("camera"), "setup": json.dumps("monocular"), "fps": "30.0"}
"""What the program does not start without; it has no bearing on the camera."""


def _stella_camera(tree: Node, _context: ReadContext) -> Named:
    flat = {
        key.removeprefix("Camera."): child.value for key, child in tree.entries() if key.startswith("Camera")
    }
    node = tree[STELLA_BLOCK] if STELLA_BLOCK in tree else Node(flat, source=tree.source, place=STELLA_BLOCK)
    if node["model"].text() == "equirectangular":
        raise UnsupportedModelError(
            "the images are equirectangular panoramas, each pixel an angle, and no K describes them",
            place=node["model"].place,
        )
    node.image_size("cols", "rows")
    yield None, node


def _stella_written(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """The block Camera; the program's other blocks have defaults. The size comes last and makes it complete."""
    [item] = calibrations
    K, made = item.intrinsics, item.distortion or NoDistortion()
    native = STELLA.native(K)
    rows = [
        (key, scalar(restored(text))) for key, text in (STELLA_NEEDED | rest_of(item, STELLA_REST)).items()
    ]
    if isinstance(made, KannalaBrandt):
        model, coefficients = "fisheye", made.coefficients
    elif isinstance(made, Division):
        model, coefficients = "radial_division", {"distortion": made.k}
    else:
        model, coefficients = "perspective", {**dict.fromkeys(BROWN5, 0.0), **made.coefficients}
    rows.append(("model", json.dumps(model)))
    rows += [(key, decimal(getattr(native, key))) for key in K4]
    rows += [(key, decimal(coefficients[key])) for key in STELLA_LENSES[model].numbers]
    rows += [("cols", str(K.image_size[0])), ("rows", str(K.image_size[1]))]
    return (f"{STELLA_BLOCK}:\n" + "".join(f"  {key}: {value}\n" for key, value in rows)).encode()


ROBOTS: Final = (
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
        syntaxes=TEXT,
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
        name="euroc",
        title="EuRoC/ASL sensor.yaml and Kimera-VIO camera",
        words="""\
The ASL dataset format's ``sensor.yaml``, which came with the EuRoC recordings, and Kimera-VIO's camera files.

In the format's own words::

    sensor_type: camera
    comment: front, 5 mm
    T_BS: …                                                  # the sensor in the body's frame
    rate_hz: 20
    resolution: [752, 480]
    camera_model: pinhole
    intrinsics: [458.1, 457.9, 367.2, 248.4]                 # fu, fv, cu, cv
    distortion_model: radial-tangential                      # or equidistant
    distortion_coefficients: [-0.28, 0.07, 0.0002, 0.00002]  # k1, k2, p1, p2

The numbers are Kalibr's, the names of the models are not. Kimera-VIO has ``camera_id`` in place of sensor_type, says
radtan as well, and hands both lenses to OpenCV. Its omni cameras are OCamCalib's::

    camera_model: omni
    intrinsics: []                                           # or those of a pinhole to undistort to
    distortion_model: omni
    distortion_coefficients: [875.1, 0.0, -3.0e-4, -4.8e-8, 1.7e-11]
    omni_affine: [a, b, c]
    omni_distortion_center: [1005.8, 743.0]                  # u, v

A pixel is (u, v) = (1 a; b c)·(x, y) + centre, and its ray (x, y, d0 + d1·ρ + d2·ρ² + d3·ρ³ + d4·ρ⁴) with ρ² = x² + y².
K is d0·(1 a; b c) brought to its upper triangle, as for OCamCalib's own file; it is not what ``intrinsics`` states.

Sources: ETH Zürich ASL, "The EuRoC MAV datasets", ``dataset_tools``; Kimera-VIO, ``src/frontend/CameraParams.cpp`` and
``src/frontend/Camera.cpp`` (BackProjectOmni).
""",
        suffixes=(".yaml",),
        reference="https://projects.asl.ethz.ch/datasets/doku.php?id=kmavvisualinertialdatasets",
        syntaxes=TEXT,
        convention=EUROC,
        marks=(
            Mark(("sensor_type", "camera_model")),
            Mark(("camera_model", "intrinsics", "distortion_model", "distortion_coefficients", "resolution")),
        ),
        cameras=_euroc_cameras,
        K=("intrinsics",),
        size=("resolution",),
        model=("camera_model", "distortion_model"),
        models={
            **{
                f"pinhole {kind}": Model(lens, ("distortion_coefficients",), (4,))
                for kind in ("radial-tangential", "radtan")
            },
            "pinhole equidistant": Model(fisheye, ("distortion_coefficients",), (4,)),
            "pinhole none": Model(),
            **{
                f"omni{kind}": Model(_taylor, ("distortion_coefficients",), (5,), K=OF_RAY)
                for kind in (" omni", " none", "")
            },
        },
        finish=_euroc,
        write=_euroc_written,
        capacity=Capacity(models=(NoDistortion, BrownWithoutK3, KannalaBrandt)),
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
        syntaxes=TEXT,
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
            "OCamCalib": Model(_taylor, ("coefficients.unprojection",), K=OF_RAY),
        },
        options=(ADAPTER_MODEL,),
        finish=lambda _tree, node, item: _turned(node, item, "the file's"),
    ),
    Program(
        name="orthority",
        title="orthority interior parameters",
        words="""\
orthority's interior parameters, which simple-ortho wrote as well: a camera for orthorectification.

In the format's own words::

    Acme DMC:
        type: pinhole                       # brown, opencv, fisheye
        im_size: [640, 1152]
        focal_len: 120.0                    # or [x, y]
        sensor_size: [92.16, 165.888]       # in the focal length's unit
        cx: 0.0                             # from the middle, as a fraction of the longer side
        cy: 0.0

Without sensor_size the focal length is a fraction of the image's width. brown has k1, k2, p1, p2, k3, opencv any of
OpenCV's fourteen, with tx and ty for τx and τy, and fisheye k1 to k4 of cv2.fisheye; one that is left out is zero. The
file does not state how the numbers were determined.

Source: orthority 0.7.0, ``orthority/camera.py``, ``_get_intrinsic`` and ``OpenCVCamera``, which was run on the same
files: all four types project alike to 1e-12 px; and "Interior parameter file" of its documentation.
""",
        suffixes=(".yaml", ".yml"),
        reference="https://orthority.readthedocs.io/en/stable/",
        syntaxes=TEXT,
        convention=Convention(
            origin=Origin.IMAGE_CENTRE,
            coefficients=ORTHORITY_LENS,
            remarks=(
                "lengths are in the unit of sensor_size, or the image's width without it",
                "cx and cy are fractions of the longer side, and coefficients are named",
            ),
        ),
        marks=(Mark((), inner=("type", "im_size", "focal_len")),),
        cameras=_orthority_cameras,
        K=("K",),
        size=("im_size",),
        model=("type",),
        models={
            "pinhole": Model(),
            "brown": Model(smallest_lens, BROWN5, missing=0.0),
            "opencv": Model(smallest_lens, ORTHORITY_LENS, missing=0.0),
            "fisheye": Model(fisheye, FISHEYE4, missing=0.0),
        },
        grade=Grade.DERIVED,
        assumptions=(ORIGIN_UNKNOWN,),
        idle=("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"),
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
        syntaxes=XML,
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
        name="stella_vslam",
        title="stella_vslam and OpenVSLAM settings",
        words="""\
stella_vslam's settings, OpenVSLAM's before it: a camera among the program's own numbers.

In the format's own words::

    Camera:
      name: "EuRoC monocular"
      setup: "monocular"            # stereo, RGBD
      model: "perspective"          # fisheye, radial_division, equirectangular
      fx: 458.654
      fy: 457.296
      cx: 367.215
      cy: 248.375
      k1: -0.2834                   # perspective: k1, k2, p1, p2, k3; fisheye: k1, k2, k3, k4
      …                             # radial_division: distortion
      fps: 20.0
      cols: 752
      rows: 480

OpenVSLAM's older files have the same names flat, ``Camera.model`` and so on. The program hands perspective and
fisheye to OpenCV; radial_division sees (x', y', 1 + distortion·r'²), Fitzgibbon's division model. An equirectangular
panorama has no K.

Source: stella_vslam, ``src/stella_vslam/camera/{base,perspective,fisheye,radial_division}.cc``.
""",
        suffixes=(".yaml", ".yml"),
        reference="https://stella-cv.readthedocs.io/en/latest/parameters.html",
        syntaxes=TEXT,
        convention=STELLA,
        marks=(Mark(("Camera.model",)), Mark(("Camera",), inner=("model", "setup", "cols", "rows"))),
        cameras=_stella_camera,
        K=K4,
        size=("cols", "rows"),
        model=("model",),
        models=STELLA_LENSES,
        finish=lambda _tree, node, item: with_rest(item, node, STELLA_REST, STELLA_KEYS),
        write=_stella_written,
        capacity=Capacity(models=(NoDistortion, BrownConrady, KannalaBrandt, Division)),
        idle=(
            "Camera.k1",
            "Camera.k2",
            "Camera.k3",
            "Camera.k4",
            "Camera.p1",
            "Camera.p2",
            "Camera.distortion",
        ),
    ),
)
"""In alphabetical order."""
