"""Kalibr's ``results-cam-*.txt``, what its calibrators print, with the standard deviations.

In the format's own words::

    Calibration results
    ====================
    Camera-system parameters:
    cam0 (/cam0/image_raw):
        type: <class 'aslam_cv.libaslam_cv_python.DistortedPinholeCameraGeometry'>
        distortion: [-0.2134  0.0447 -0.0004  0.0008] +- [0.0012 0.0011 0.0001 0.0001]
        projection: [433.21 432.93 371.58 238.34] +- [0.13 0.12 0.22 0.24]
        reprojection error: [0.000012, -0.000003] +- [0.120000, 0.090000]

    baseline T_1_0: …

Of a camera with an IMU (``results-imucam-*.txt``) it prints each number by name, without deviations::

    cam0
    -----
      Camera model: pinhole
      Focal length: [433.21, 432.93]
      Principal point: [371.58, 238.34]
      Distortion model: radtan
      Distortion coefficients: [-0.2134, 0.0447, -0.0004, 0.0008]

The numbers and their order are those of the camera chain (``kalibr``); the class names the models. The deviations are
one sigma. The file does not state the image size, but the chain beside it does.

Sources: Kalibr, ``kalibr_camera_calibration/CameraUtils.py``, ``printParameters`` and ``saveResultTxt``;
``kalibr_common/ConfigReader.py``, ``CameraParameters.printDetails``.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from calibrary.calibration import Calibration, Quality
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats import kalibr
from calibrary.parsers.formats._text_rows import text_of
from calibrary.records import Json, replace

MODELS = {
    "PinholeCameraGeometry": ("pinhole", "none"),
    "DistortedPinholeCameraGeometry": ("pinhole", "radtan"),
    "EquidistantPinholeCameraGeometry": ("pinhole", "equidistant"),
    "EquidistantDistortedPinholeCameraGeometry": ("pinhole", "equidistant"),
    "FovPinholeCameraGeometry": ("pinhole", "fov"),
    "FovDistortedPinholeCameraGeometry": ("pinhole", "fov"),
    "OmniCameraGeometry": ("omni", "none"),
    "DistortedOmniCameraGeometry": ("omni", "radtan"),
    "ExtendedUnifiedCameraGeometry": ("eucm", "none"),
    "DoubleSphereCameraGeometry": ("ds", "none"),
}
"""Kalibr's classes, each with the models of its camera chain."""
MAX_BYTES = 1024 * 1024
MAX_CAMERAS = 1000
_CAMERA = re.compile(r"^\s*(cam\d+) \(.{0,200}\):\s*$", re.MULTILINE)
_TYPE = re.compile(r"type: <class '[\w.]{0,100}?\.?(\w{1,100})'>")
_VALUES = re.compile(r"(distortion|projection): \[([^\[\]]{0,2000})\] \+- \[([^\[\]]{0,2000})\]")
NAMES = ("fx", "fy", "cx", "cy")
DETAILS = ("Camera model", "Focal length", "Principal point", "Distortion model", "Distortion coefficients")
_BY_NAME = re.compile(r"^(cam\d+)[ \t]*\r?\n-+[ \t]*\r?\n((?:[ \t]+\S.*\n?)+)", re.MULTILINE)
_DETAIL = re.compile(r"^[ \t]+([A-Za-z][A-Za-z ]{0,40}): ?(.{0,2000}?)[ \t\r]*$", re.MULTILINE)


def sniff(content: Content) -> Sniff | None:
    """The line of a camera, and the class under it."""
    text = content.text or ""
    if "CameraGeometry'>" in text and "projection: [" in text and _CAMERA.search(text):
        return Sniff(Sure.MAGIC, "a line 'cam0 (…):' with a type and a projection under it")
    if "Camera model: " in text and "Distortion coefficients: " in text and _BY_NAME.search(text):
        return Sniff(Sure.MAGIC, "a line 'cam0' with a camera model and distortion coefficients under it")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera, in order."""
    text = text_of(data, most=MAX_BYTES)
    blocks = _CAMERA.split(text)[1:]
    cameras = list(zip(blocks[::2], blocks[1::2], strict=True))
    tables = [(name, *_table(name, block)) for name, block in cameras]
    if not cameras:
        tables = [(name, _named(name, block), ()) for name, block in _BY_NAME.findall(text)]
    if not tables or len(tables) > MAX_CAMERAS:
        raise ParseError(f"{len(tables)} cameras, expected 1 to {MAX_CAMERAS}")
    size = context.size(None)
    several = len(tables) > 1
    found = []
    for name, table, deviations in tables:
        node = Node({**table, "resolution": list(size)}, source=context.name, place=name)
        item = kalibr.camera_of(name, node, context, several=several)
        lens = item.distortion.coefficients if item.distortion is not None else {}
        own = kalibr.SHAPES.get(str(table["camera_model"]), ())
        names = (*own, *NAMES, *(name for name in lens if name not in own and lens[name]))
        std = dict(zip(names, deviations, strict=False))
        quality = Quality(std={key: value for key, value in std.items() if value > 0}) if std else None
        found.append(replace(item, quality=quality))
    return found


def _named(name: str, block: str) -> dict[str, Json]:
    """The camera as the chain has it, from the numbers that are printed by name."""
    said = dict(_DETAIL.findall(block))
    missing = next((key for key in DETAILS if key not in said), None)
    if missing is not None:
        raise ParseError(f"there is no {missing}", place=name)
    model = said["Camera model"]
    special = {key.rpartition(" ")[2].lower(): text for key, text in said.items()}
    lacking = [key for key in kalibr.SHAPES.get(model, ()) if key not in special]
    if lacking:
        raise ParseError(f"there is no {', '.join(lacking)} of the {model} camera", place=name)
    own = [strict.number(special[key], place=f"{name}, {key}") for key in kalibr.SHAPES.get(model, ())]
    focal, centre, coefficients = (
        strict.numbers(said[key].strip("[]").replace(",", " "), place=f"{name}, {key}")
        for key in ("Focal length", "Principal point", "Distortion coefficients")
    )
    return {
        "camera_model": model,
        "intrinsics": [*own, *focal, *centre],
        "distortion_model": said["Distortion model"],
        "distortion_coeffs": list(coefficients),
    }


def _table(name: str, block: str) -> tuple[dict[str, Json], tuple[float, ...]]:
    """The camera as the chain has it, and the deviations of its numbers, in order: projection, distortion."""
    kind = _TYPE.search(block)
    if kind is None:
        raise ParseError("there is no type", place=name)
    if kind[1] not in MODELS:
        raise UnsupportedModelError(
            f"the class is {strict.shown(kind[1])}, which is not known here; read the camera chain (camchain.yaml)",
            place=name,
        )
    model, distortion = MODELS[kind[1]]
    values: Mapping[str, tuple[str, str]] = {key: (own, sigma) for key, own, sigma in _VALUES.findall(block)}
    if values.keys() != {"distortion", "projection"}:
        raise ParseError("there is no distortion and projection, each with its deviations", place=name)
    numbers = {key: strict.numbers(own, place=f"{name}, {key}") for key, (own, _) in values.items()}
    deviations = strict.numbers(
        values["projection"][1], count=len(numbers["projection"]), place=f"{name}, projection"
    )
    bent = strict.numbers(values["distortion"][1], place=f"{name}, distortion")
    if len(bent) != len(numbers["distortion"]):
        raise ParseError(f"{len(bent)} deviations of {len(numbers['distortion'])} coefficients", place=name)
    table: dict[str, Json] = {
        "camera_model": model,
        "intrinsics": list(numbers["projection"]),
        "distortion_model": distortion,
        "distortion_coeffs": list(numbers["distortion"]),
    }
    return table, (*deviations, *bent)


FORMAT = Format(
    name="kalibr_results",
    title="Kalibr results (results-cam.txt)",
    suffixes=(".txt",),
    syntaxes=(Syntax.TEXT,),
    reference="https://github.com/ethz-asl/kalibr/wiki/multiple-camera-calibration",
    convention=kalibr.FORMAT.convention,
    sniff=sniff,
    read=read,
    needs_image_size=True,
)
