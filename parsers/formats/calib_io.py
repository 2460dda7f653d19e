"""calib.io's Camera Calibrator, the calibration it saves as JSON.

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
"""

from __future__ import annotations

from calibrary.calibration import Calibration, ImageSize
from calibrary.errors import UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._json_text import loaded
from calibrary.parsers.formats._opencv_lens import smallest_lens

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE, remarks=("fx = f, fy = f·ar", "coefficients are named as OpenCV's")
)
OPENCV = "libCalib::CameraModelOpenCV"
COEFFICIENTS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tauX", "tauY")
FIRST_OF_ITS_KIND = 1 << 31
"""cereal sets this bit of a number where the name that belongs to it stands beside it."""


def sniff(content: Content) -> Sniff | None:
    """Calibration.cameras, the first with a model of libCalib's."""
    if "Calibration" in content.json_keys and '"libCalib::' in (content.text or ""):
        return Sniff(Sure.MAGIC, "the key Calibration and a model of libCalib")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera, in the file's order, named by its number."""
    cameras = loaded(data, context)["Calibration"]["cameras"].items()
    names: dict[int, str] = {}
    return [
        _camera(f"cam{index}" if len(cameras) > 1 else None, camera["model"], names, context)
        for index, camera in enumerate(cameras)
    ]


def _camera(name: str | None, model: Node, names: dict[int, str], context: ReadContext) -> Calibration:
    kind = _kind(model, names)
    if kind != OPENCV:
        raise UnsupportedModelError(
            f"the model is {strict.shown(kind)}, which has no counterpart here; calibrate again with {OPENCV}",
            place=model.place,
        )
    body = model["ptr_wrapper"]["data"]
    parameters = body["parameters"]
    f, ar, cx, cy = (parameters[key]["val"].number() for key in ("f", "ar", "cx", "cy"))
    values = [parameters[key]["val"].number() for key in COEFFICIENTS]
    size = context.size(_size(body))
    return context.calibration(
        CONVENTION.intrinsics(Native(fx=f, fy=f * ar, cx=cx, cy=cy), size),
        smallest_lens(values),
        name=name,
        tag=model.place,
    )


def _kind(model: Node, names: dict[int, str]) -> str:
    number = model["polymorphic_id"].whole()
    if "polymorphic_name" in model:
        names[number & ~FIRST_OF_ITS_KIND] = model["polymorphic_name"].text()
    if (number & ~FIRST_OF_ITS_KIND) not in names:
        model["polymorphic_id"].fail(f"no camera before it gave {number} a name")
    return names[number & ~FIRST_OF_ITS_KIND]


def _size(body: Node) -> ImageSize | None:
    node: Node | None = body
    for key in ("CameraModelCRT", "CameraModelBase", "imageSize"):
        node = node.get(key) if node is not None else None
    return node.image_size("width", "height") if node is not None else None


FORMAT = Format(
    name="calib_io",
    title="calib.io Camera Calibrator",
    suffixes=(".json",),
    syntaxes=(Syntax.JSON,),
    reference="https://calib.io/pages/camera-calibrator",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
