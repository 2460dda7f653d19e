"""Azure Kinect's factory calibration, the JSON inside the camera and its recordings.

In the format's own words::

    {"CalibrationInformation": {"Cameras": [
        {"Intrinsics": {"ModelType": "CALIBRATION_LensDistortionModelBrownConrady", "ModelParameterCount": 14,
                        "ModelParameters": [cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, codx, cody, p2, p1]},
         "Location": "CALIBRATION_CameraLocationPV0", "SensorWidth": 4096, "SensorHeight": 3072}, …]}}

cx and fx are fractions of the sensor's width, cy and fy of its height, and the SDK takes half a pixel off cx·width:
they count from the corner of the first pixel. The lens is OpenCV's rational model, p2 before p1. K is of the whole
sensor. The colour camera's 4:3 modes are scaled, its 16:9 modes are also cropped above and below, and the depth
camera's modes are binned and cropped.

Sources: Azure-Kinect-Sensor-SDK, ``src/calibration/calibration.c``, ``src/transformation/mode_specific_calibration.c``
and ``examples/opencv_compatibility``.
"""

from __future__ import annotations

from calibrary.calibration import Calibration
from calibrary.errors import UnsupportedModelError
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, Unit
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._json_text import loaded
from calibrary.parsers.formats._one_camera import camera, refuse_model
from calibrary.parsers.formats._opencv_lens import lens

CONVENTION = Convention(
    unit=Unit.EACH_SIDE,
    origin=Origin.CORNER,
    coefficients=("k1", "k2", "k3", "k4", "k5", "k6", "p2", "p1"),
    remarks=("the principal point comes before the focal lengths", "K is of the whole sensor"),
)
MODEL = "CALIBRATION_LensDistortionModelBrownConrady"
WHOLE_SENSOR = "K is of the whole sensor; the modes of the camera scale and cut its images"
MAX_CAMERAS = 16


def sniff(content: Content) -> Sniff | None:
    """The one key of the document."""
    if "CalibrationInformation" in content.json_keys:
        return Sniff(Sure.MAGIC, "JSON with CalibrationInformation")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The depth and the colour camera, in the file's order."""
    cameras = loaded(data, context)["CalibrationInformation"]["Cameras"]
    nodes = cameras.items()
    if len(nodes) > MAX_CAMERAS:
        cameras.fail(f"{len(nodes)} cameras, expected at most {MAX_CAMERAS}")
    return [_camera(node, context, several=len(nodes) > 1) for node in nodes]


def _camera(node: Node, context: ReadContext, *, several: bool) -> Calibration:
    intrinsics = node["Intrinsics"]
    if intrinsics["ModelType"].text() != MODEL:
        refuse_model(intrinsics["ModelType"].text(), (MODEL,), place=node.place)
    numbers = intrinsics["ModelParameters"].numbers(14)
    cx, cy, fx, fy, k1, k2, k3, k4, k5, k6, codx, cody, p2, p1 = numbers
    if codx or cody:
        raise UnsupportedModelError(
            "the distortion has a centre of its own, which has no counterpart here", place=node.place
        )
    name = node["Location"].text().removeprefix("CALIBRATION_CameraLocation")
    return camera(
        context,
        CONVENTION,
        Native(fx=fx, fy=fy, cx=cx, cy=cy),
        node.image_size("SensorWidth", "SensorHeight"),
        lens((k1, k2, p1, p2, k3, k4, k5, k6)),
        name=name if several else None,
        tag=name,
        assumptions=(WHOLE_SENSOR,),
    )


FORMAT = Format(
    name="azure_kinect",
    title="Azure Kinect calibration",
    suffixes=(".json",),
    syntaxes=(Syntax.JSON,),
    reference="https://microsoft.github.io/Azure-Kinect-Sensor-SDK/master/index.html",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
