"""OKVIS's configuration: the cameras of a visual-inertial rig.

In the format's own words::

    %YAML:1.0
    cameras:
         - {T_SC: [ … ],                                                    # from the camera to the rig
            image_dimension: [752, 480],
            distortion_coefficients: [-0.2834, 0.0740, 0.00019, 0.00002],   # k1, k2, p1, p2
            distortion_type: radialtangential,                              # radialtangential8, equidistant
            focal_length: [458.655, 457.296],
            principal_point: [367.216, 248.375]}

radialtangential8, or plumb_bob8, is OpenCV's rational model, and equidistant cv2.fisheye's. A configuration without
``cameras`` leaves them to the sensor, and there is nothing to read.

Source: OKVIS, ``okvis_common/src/VioParametersReader.cpp`` and ``okvis_cv/include/okvis/cameras``.
"""

from __future__ import annotations

from calibrary.calibration import Calibration
from calibrary.distortion import Distortion
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._one_camera import camera, fisheye, refuse_model, size_of
from calibrary.parsers.formats._opencv_lens import lens

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    remarks=("equidistant's four are k1, k2, k3, k4",),
)
COUNTS = {
    "radialtangential": 4, "plumb_bob": 4, "radialtangential8": 8, "plumb_bob8": 8, "equidistant": 4,
}  # fmt: skip
MAX_CAMERAS = 1000


def sniff(content: Content) -> Sniff | None:
    """A list of cameras with image_dimension and distortion_type."""
    text = content.text or ""
    if "cameras" in content.yaml_keys and "image_dimension:" in text and "distortion_type:" in text:
        return Sniff(Sure.MAGIC, "the key cameras with image_dimension and distortion_type under it")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera of the rig, in the file's order, which is how OKVIS numbers them."""
    cameras = storage.load(data, source=context.name)["cameras"]
    nodes = cameras.items()
    if len(nodes) > MAX_CAMERAS:
        cameras.fail(f"{len(nodes)} cameras, expected at most {MAX_CAMERAS}")
    several = len(nodes) > 1
    return [_camera(node, context, f"cam{index}" if several else None) for index, node in enumerate(nodes)]


def _camera(node: Node, context: ReadContext, name: str | None) -> Calibration:
    fx, fy = node["focal_length"].numbers(2)
    cx, cy = node["principal_point"].numbers(2)
    native = Native(fx=fx, fy=fy, cx=cx, cy=cy)
    size = size_of(node["image_dimension"])
    return camera(context, CONVENTION, native, size, _lens(node), name=name, tag=node.place)


def _lens(node: Node) -> Distortion:
    kind = node["distortion_type"]
    if kind.text() not in COUNTS:
        refuse_model(kind.text(), tuple(COUNTS), place=kind.place)
    values = node["distortion_coefficients"].numbers(COUNTS[kind.text()])
    if kind.text() == "equidistant":
        return fisheye(values)
    # Eight are k1 k2 p1 p2 k3 k4 k5 k6, as OpenCV's.
    return lens(values)


FORMAT = Format(
    name="okvis",
    title="OKVIS configuration",
    suffixes=(".yaml", ".yml"),
    syntaxes=(Syntax.TEXT,),
    reference="https://github.com/ethz-asl/okvis",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
