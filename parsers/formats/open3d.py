"""Open3D's ``PinholeCameraIntrinsic`` and ``PinholeCameraTrajectory`` in JSON.

In the format's own words::

    {"width": 640, "height": 480, "intrinsic_matrix": [621.4, 0, 0,  0, 621.4, 0,  313.7, 240.0, 1]}
    {"class_name": "PinholeCameraTrajectory", "parameters": [{"intrinsic": {…}, "extrinsic": […]}, …]}

The matrix is Eigen's, column by column. A trajectory has a camera for each image; those with the same numbers are one.
Open3D projects pixel (u, v) of an image by u = fx·x/z + cx with whole numbers at the pixels' centres, and knows no
distortion: its images are undistorted, or nobody took care, so the distortion is unknown.

Sources: Open3D, ``cpp/open3d/camera/PinholeCameraIntrinsic.cpp``, ``ConvertToJsonValue``;
``geometry/PointCloudFactory.cpp``.
"""

from __future__ import annotations

from calibrary.calibration import Calibration, Grade
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Origin, Tangential
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._json_text import loaded
from calibrary.parsers.formats._one_camera import ORIGIN_UNKNOWN, camera, native_of
from calibrary.records import Json, replace

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    tangential=Tangential.NONE,
    remarks=("the matrix is written column by column", "no distortion"),
)
KEYS = frozenset({"width", "height", "intrinsic_matrix"})
MAX_CAMERAS = 1_000_000


def sniff(content: Content) -> Sniff | None:
    """The three keys with nine numbers, or a trajectory of such cameras."""
    document = content.json
    if not isinstance(document, dict):
        return None
    matrix = document.get("intrinsic_matrix")
    if (
        document.keys() >= KEYS
        and isinstance(matrix, list)
        and len(matrix) == 9
        and matrix[2] == matrix[5] == 0
    ):
        return Sniff(Sure.MAGIC, "JSON with width, height and an intrinsic_matrix by columns")
    if document.get("class_name") == "PinholeCameraTrajectory":
        return Sniff(Sure.MAGIC, "JSON whose class_name is PinholeCameraTrajectory")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The camera, or every one of a trajectory that differs."""
    document = loaded(data, context)
    if "intrinsic_matrix" in document:
        return [_camera(document, context, None)]
    images = document["parameters"].items()
    if len(images) > MAX_CAMERAS:
        document["parameters"].fail(f"{len(images)} cameras; at most {MAX_CAMERAS} are read")
    first: dict[str, Node] = {}
    for image in images:
        first.setdefault(repr(image["intrinsic"].value), image["intrinsic"])
    several = len(first) > 1
    return [_camera(node, context, node.place if several else None) for node in first.values()]


def _camera(node: Node, context: ReadContext, name: str | None) -> Calibration:
    matrix = node["intrinsic_matrix"]
    numbers = matrix.numbers(9)
    columns = list[Json](list[Json](numbers[at : at + 3]) for at in (0, 3, 6))
    native = native_of(Node(columns, source=matrix.source, place=matrix.place), transposed=True)
    size = node.image_size("width", "height")
    item = camera(
        context, CONVENTION, native, size, None, name=name, tag=node.place, assumptions=(ORIGIN_UNKNOWN,)
    )
    return replace(item, grade=Grade.DERIVED)


FORMAT = Format(
    name="open3d",
    title="Open3D camera and trajectory",
    suffixes=(".json",),
    syntaxes=(Syntax.JSON,),
    reference="https://www.open3d.org/docs/release/python_api/open3d.camera.PinholeCameraIntrinsic.html",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
