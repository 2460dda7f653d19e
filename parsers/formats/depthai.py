"""Luxonis OAK cameras: the calibration that DepthAI keeps in the camera's EEPROM, as JSON.

In the format's own words::

    {"productName": "OAK-D", "boardName": "BW1098OBC",
     "cameraData": [[2, {"cameraType": 0,                    0 perspective, 1 fisheye
                         "intrinsicMatrix": [[799.7, 0, 662.9], [0, 799.4, 382.2], [0, 0, 1]],
                         "distortionCoeff": […],             14, in OpenCV's order; a fisheye's first four
                         "width": 1280, "height": 720, …}]], …}

A camera's number is its socket: 0 is CAM_A (colour), 1 CAM_B (left), 2 CAM_C (right). A file may also contain one
camera of the table alone. The coefficients are OpenCV's rational model, whose numerator and denominator nearly cancel
here: values beyond 100 are usual and harmless.

Source: Luxonis, depthai-core, ``EepromData.hpp``, ``CameraInfo.hpp``.
"""

from __future__ import annotations

from collections.abc import Iterator

from calibrary.calibration import Calibration, CameraKey, Grade
from calibrary.distortion import Distortion, KannalaBrandt
from calibrary.errors import UnsupportedModelError
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._json_text import loaded
from calibrary.parsers.formats._opencv_lens import COUNTS, smallest_lens

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y"),
    remarks=("a fisheye's four are k1, k2, k3, k4",),
)
PERSPECTIVE, FISHEYE = 0, 1
SHAPE = frozenset({"intrinsicMatrix", "distortionCoeff"})


def sniff(content: Content) -> Sniff | None:
    """The key cameraData, or one camera of it."""
    keys = set(content.json_keys)
    if "cameraData" in keys:
        return Sniff(Sure.MAGIC, "the key cameraData")
    if keys >= SHAPE:
        return Sniff(Sure.SHAPE, "the keys intrinsicMatrix and distortionCoeff")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera that has been calibrated, in the table's order, named by its socket."""
    document = loaded(data, context)
    if "cameraData" not in document:
        return [_camera(None, None, document, context)]
    model = document.get("productName") or document.get("boardName")
    name = model.text() or None if model is not None else None
    found = [(socket, node) for socket, node in _sockets(document["cameraData"]) if _is_calibrated(node)]
    if not found:
        document["cameraData"].fail(
            "it contains no camera with an intrinsicMatrix: the device is not calibrated"
        )
    several = len(found) > 1
    return [_camera(name, _socket_name(socket) if several else None, node, context) for socket, node in found]


def _sockets(table: Node) -> Iterator[tuple[str, Node]]:
    """Pairs of socket and camera, as C++'s JSON writes a map whose keys are numbers, or an object."""
    if isinstance(table.value, dict):
        yield from table.entries()
        return
    for item in table.items():
        pair = item.items()
        if len(pair) != 2:
            item.fail(f"{len(pair)} values, expected a socket and a camera")
        yield str(pair[0].value), pair[1]


def _is_calibrated(node: Node) -> bool:
    matrix = node.get("intrinsicMatrix")
    return matrix is not None and bool(matrix.value) and matrix.items()[0].value != [0, 0, 0]


def _socket_name(socket: str) -> str:
    return (
        f"CAM_{chr(ord('A') + int(socket))}"
        if socket.isascii() and socket.isdigit() and int(socket) < 26
        else socket
    )


def _camera(model: str | None, name: str | None, node: Node, context: ReadContext) -> Calibration:
    stated = node.image_size("width", "height") if "width" in node or "height" in node else None
    size = context.size(stated)
    matrix = node["intrinsicMatrix"]
    native = Native.of_matrix(matrix.matrix(3, 3), place=matrix.place, source=matrix.source)
    return Calibration(
        camera=CameraKey(make="Luxonis" if model else None, model=model, sub_camera=name, image_size=size),
        intrinsics=CONVENTION.intrinsics(native, size),
        distortion=_distortion(node),
        grade=Grade.CALIBRATED,
        provenance=context.provenance(tag=node.place),
    )


def _distortion(node: Node) -> Distortion:
    kind = node.get("cameraType")
    number = PERSPECTIVE if kind is None else kind.whole()
    if number == FISHEYE:
        values = node["distortionCoeff"].numbers()
        if len(values) < 4 or any(values[4:]):
            node["distortionCoeff"].fail("expected a fisheye's four coefficients and zeros after them")
        return KannalaBrandt(**dict(zip(KannalaBrandt.names(), values, strict=False)))
    if number != PERSPECTIVE:
        raise UnsupportedModelError(
            f"cameraType is {number}, which has no counterpart here; expected 0 (perspective) or 1 (fisheye)",
            source=node.source,
            place=node.place,
        )
    return smallest_lens(node["distortionCoeff"].numbers(COUNTS))


FORMAT = Format(
    name="depthai",
    title="Luxonis DepthAI (OAK) calibration",
    suffixes=(".json",),
    syntaxes=(Syntax.JSON,),
    reference="https://docs.luxonis.com/hardware/platform/depth/calibration/",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
