"""PhotonVision's camera calibration, exported as JSON, and Chameleon Vision's before it.

In the format's own words::

    {"resolution": {"width": 640.0, "height": 480.0},
     "cameraIntrinsics": {"rows": 3, "cols": 3, "type": 6, "data": [699.4, 0.0, 345.6, …]},
     "distCoeffs": {"rows": 1, "cols": 5, "type": 6, "data": [0.1438, -0.9851, -0.0182, 0.0110, 1.9833]},
     "perViewErrors": […], "standardDeviation": 0.0635, "lensmodel": "LENSMODEL_OPENCV"}

Older versions call the coefficients cameraExtrinsics, and one of them had isFisheye. The numbers are OpenCV's; the
calibrations of several resolutions are in a camera's settings under ``calibrations``. mrcal's other lens models, which
have a name under lensmodel as well, are refused.

Source: PhotonVision, ``CameraCalibrationCoefficients.java``.
"""

from __future__ import annotations

from calibrary.calibration import Calibration, Quality
from calibrary.distortion import Distortion
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._json_text import loaded
from calibrary.parsers.formats._one_camera import camera, fisheye, native_of, opencv_lens, refuse_model
from calibrary.parsers.text import check_count
from calibrary.records import replace

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    remarks=("a fisheye's four are k1, k2, k3, k4",),
)
LENS = "LENSMODEL_OPENCV"
MAX_CAMERAS = 100


def sniff(content: Content) -> Sniff | None:
    """The keys resolution and cameraIntrinsics, or a list of such under calibrations."""
    document = content.json
    listed = document.get("calibrations") if isinstance(document, dict) else None
    found = listed[0] if isinstance(listed, list) and listed else document
    if isinstance(found, dict) and {"resolution", "cameraIntrinsics"} <= found.keys():
        return Sniff(Sure.MAGIC, "JSON with resolution and cameraIntrinsics")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The calibration, or that of every resolution."""
    document = loaded(data, context)
    listed = document.get("calibrations")
    nodes = (document,) if listed is None else listed.items()
    if len(nodes) > MAX_CAMERAS:
        document.fail(f"{len(nodes)} calibrations, expected at most {MAX_CAMERAS}")
    several = len(nodes) > 1
    return [_camera(node, context, several=several) for node in nodes]


def _camera(node: Node, context: ReadContext, *, several: bool) -> Calibration:
    size = node["resolution"].image_size("width", "height")
    model = node.get("lensmodel")
    if model is not None and not model.text().startswith(LENS):
        refuse_model(model.text(), (LENS,), place=model.place)
    coefficients = node["distCoeffs"] if "distCoeffs" in node else node["cameraExtrinsics"]
    mark = node.get("isFisheye")
    if mark is not None and mark.value:
        values = storage.numbers(_untyped(coefficients))
        check_count(len(values), 4, place=coefficients.place)
        lens: Distortion = fisheye(values)
    else:
        lens = opencv_lens(_untyped(coefficients))
    name = f"{size[0]}×{size[1]}" if several else None
    item = camera(
        context,
        CONVENTION,
        native_of(_untyped(node["cameraIntrinsics"])),
        size,
        lens,
        name=name,
        tag=node.place,
    )
    errors = node.get("perViewErrors")
    return item if errors is None else replace(item, quality=Quality(views=len(errors.items())))


def _untyped(node: Node) -> Node:
    """The matrix without OpenCV's number for its type, which is that of a double."""
    kept = {key: child.value for key, child in node.entries() if key != "type"}
    return Node(kept, source=node.source, place=node.place)


FORMAT = Format(
    name="photonvision",
    title="PhotonVision camera calibration",
    suffixes=(".json",),
    syntaxes=(Syntax.JSON,),
    reference="https://docs.photonvision.org/en/latest/docs/calibration/calibration.html",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
