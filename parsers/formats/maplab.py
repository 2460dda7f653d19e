"""maplab's and SVO's camera rigs (``ncamera.yaml``, ``sensors.yaml``), as aslam_cv2 writes them.

In the format's own words::

    label: "VISensor"
    cameras:
    - camera:
        label: cam0
        image_height: 480
        image_width: 752
        type: pinhole                                   # unified-projection
        intrinsics: {cols: 1, rows: 4, data: [458.655, 457.297, 367.216, 248.375]}
        distortion:
          type: radial-tangential                       # equidistant, fisheye, none
          parameters: {cols: 1, rows: 4, data: [-0.2834, 0.0740, 0.00019, 0.00002]}
      T_B_C: …

``sensors.yaml`` has the same under ``sensors``, beside the rig's other sensors. A unified projection has xi before
its focal lengths, (1 + xi) times those of the pinhole near the axis; ``fisheye`` is the FOV model of Devernay and
Faugeras, and equidistant cv2.fisheye's.

Source: aslam_cv2, ``aslam_cv_cameras/src/{camera-yaml-serialization,distortion-radtan,distortion-fisheye}.cc``.
"""

from __future__ import annotations

from collections.abc import Iterator

from calibrary.calibration import Calibration
from calibrary.distortion import Distortion, FieldOfView, NoDistortion, Unified
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._one_camera import camera, fisheye, refuse_model
from calibrary.parsers.formats._opencv_lens import lens
from calibrary.parsers.text import check_count

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "p1", "p2"),
    remarks=(
        "equidistant's four are k1, k2, k3, k4",
        "with unified-projection, xi comes before the focal lengths, which are (1 + xi) times those of the pinhole",
    ),
)
TYPES = ("pinhole", "unified-projection")
COUNTS = {"none": 0, "radial-tangential": 4, "equidistant": 4, "fisheye": 1}
MAX_CAMERAS = 1000


def sniff(content: Content) -> Sniff | None:
    """Cameras in a list, each with an image_height, a type and a T_B_C."""
    if "image_height" not in (content.text or ""):
        return None
    inner = {line.partition(":")[0].lstrip("- ") for line in content.lines}
    rig = next((key for key in content.yaml_keys if key in {"cameras", "sensors", "ncameras"}), None)
    if rig and {"camera", "image_height", "type", "intrinsics", "distortion"} <= inner:
        return Sniff(Sure.MAGIC, f"the key {rig} with camera, image_height and distortion under it")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera of every rig, in the file's order."""
    tree = storage.load(data, source=context.name)
    nodes = list(_cameras(tree))
    if not nodes:
        tree.fail("there is no camera in its lists of cameras")
    if len(nodes) > MAX_CAMERAS:
        tree.fail(f"{len(nodes)} cameras, expected at most {MAX_CAMERAS}")
    several = len(nodes) > 1
    return [_camera(node, context, f"cam{index}" if several else None) for index, node in enumerate(nodes)]


def _cameras(node: Node) -> Iterator[Node]:
    """The cameras under ``cameras``, also of rigs that are sensors among others."""
    for key in ("sensors", "ncameras", "cameras"):
        for item in node[key].items() if key in node else ():
            if key == "cameras":
                yield item["camera"]
            elif "cameras" in item:
                yield from _cameras(item)


def _camera(node: Node, context: ReadContext, name: str | None) -> Calibration:
    kind = node["type"]
    if kind.text() not in TYPES:
        refuse_model(kind.text(), TYPES, place=kind.place)
    unified = kind.text() == "unified-projection"
    numbers = storage.numbers(node["intrinsics"])
    check_count(len(numbers), 5 if unified else 4, place=node["intrinsics"].place)
    *special, fu, fv, cu, cv = numbers
    size = node.image_size("image_width", "image_height")
    native = Native(fx=fu, fy=fv, cx=cu, cy=cv)
    return camera(context, CONVENTION, native, size, _lens(node, special), name=name, tag=node.place)


def _lens(node: Node, special: list[float]) -> Distortion:
    kind = node["distortion"]["type"]
    expected = ("none", "radial-tangential") if special else tuple(COUNTS)
    if kind.text() not in expected:
        refuse_model(kind.text(), expected, place=kind.place)
    values: tuple[float, ...] = ()
    if COUNTS[kind.text()]:
        parameters = node["distortion"]["parameters"]
        values = storage.numbers(parameters)
        check_count(len(values), COUNTS[kind.text()], place=parameters.place)
    if special:
        if special[0] <= -1:
            node["intrinsics"].fail(f"xi is {special[0]:g}, expected a number above −1")
        return Unified(xi=special[0], **dict(zip(("k1", "k2", "p1", "p2"), values, strict=False)))
    if kind.text() == "equidistant":
        return fisheye(values)
    if kind.text() == "fisheye":
        return FieldOfView(omega=values[0]) if values[0] else NoDistortion()
    return lens(values)


FORMAT = Format(
    name="maplab",
    title="maplab and SVO camera rig (ncamera.yaml)",
    suffixes=(".yaml", ".yml"),
    syntaxes=(Syntax.TEXT,),
    reference="https://github.com/ethz-asl/maplab",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    idle=("distortion.parameters",),
)
