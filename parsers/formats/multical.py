"""multical's ``calibration.json``: the cameras of a rig, each with OpenCV's model.

In the format's own words::

    {"cameras": {"cam1": {"model": "standard", "image_size": [1920, 1080],
                          "K": [[1361.8, 0, 959.5], [0, 1361.8, 539.5], [0, 0, 1]],
                          "dist": [[-0.0154, 0, 0, 0, 0]]}},
     "camera_poses": {…}, "image_sets": {…}}

``model`` says which flag ``cv2.calibrateCamera`` was given (standard, rational, thin_prism, tilted), and the number
of coefficients says the same. A fisheye is cv2.fisheye's.

Source: multical, ``multical/io/export_calib.py`` and ``multical/camera.py``.
"""

from __future__ import annotations

from calibrary.calibration import Calibration
from calibrary.distortion import Distortion
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._json_text import loaded
from calibrary.parsers.formats._one_camera import (
    camera,
    fisheye,
    native_of,
    opencv_lens,
    refuse_model,
    size_of,
)
from calibrary.parsers.text import check_count

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y"),
    remarks=("a fisheye's four are k1, k2, k3, k4",),
)
MODELS = ("standard", "rational", "thin_prism", "tilted", "fisheye")
MAX_CAMERAS = 1000


def sniff(content: Content) -> Sniff | None:
    """Cameras by name, the first of which has K, dist and image_size."""
    table = content.json.get("cameras") if isinstance(content.json, dict) else None
    first = next(iter(table.values()), None) if isinstance(table, dict) else None
    if isinstance(first, dict) and {"K", "dist", "image_size"} <= first.keys():
        return Sniff(Sure.MAGIC, "JSON with cameras that have K, dist and a size")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera, in the file's order."""
    table = loaded(data, context)["cameras"]
    if len(table.keys()) > MAX_CAMERAS:
        table.fail(f"{len(table.keys())} cameras, expected at most {MAX_CAMERAS}")
    several = len(table.keys()) > 1
    return [_camera(name, node, context, several=several) for name, node in table.entries()]


def _camera(name: str, node: Node, context: ReadContext, *, several: bool) -> Calibration:
    model = node["model"].text() if "model" in node else MODELS[0]
    if model not in MODELS:
        refuse_model(model, MODELS, place=node.place)
    if model == "fisheye":
        values = storage.numbers(node["dist"])
        check_count(len(values), 4, place=node["dist"].place)
        lens: Distortion = fisheye(values)
    else:
        lens = opencv_lens(node["dist"])
    size = size_of(node["image_size"])
    return camera(
        context, CONVENTION, native_of(node["K"]), size, lens, name=name if several else None, tag=name
    )


FORMAT = Format(
    name="multical",
    title="multical calibration.json",
    suffixes=(".json",),
    syntaxes=(Syntax.JSON,),
    reference="https://github.com/oliver-batchelor/multical",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
