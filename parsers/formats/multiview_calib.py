"""OpenCV cameras by name in one JSON file: multiview_calib's ``intrinsics.json`` and many like it.

In the format's own words::

    {"cam0": {"K": [[1554.9, 0.0, 946.1], [0.0, 1552.4, 542.5], [0.0, 0.0, 1.0]],
              "dist": [[0.1525, -0.5499, -0.0003, -0.0008, 0.5891]]},
     "cam1": {…}}

Each name has the content of an OpenCV file, with any of its usual keys (``parsers.names``): K and dist, camera_matrix
and dist_coeff, image_size if it is known. Poses beside them are not read.

Source: multiview_calib, README "intrinsics.json" and ``scripts/compute_intrinsics.py``; OpenCV, "Camera Calibration".
"""

from __future__ import annotations

from calibrary.calibration import Calibration
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats import opencv_storage
from calibrary.parsers.formats._json_text import loaded
from calibrary.parsers.names import MATRIX, VECTOR, simplified
from calibrary.records import Json, replace

MAX_CAMERAS = 1000


def sniff(content: Content) -> Sniff | None:
    """JSON of mappings, each of which has a camera matrix and coefficients."""
    table = content.json
    if not isinstance(table, dict) or not table or len(table) > MAX_CAMERAS:
        return None
    if all(_is_camera(value) for value in table.values()):
        return Sniff(
            Sure.SHAPE, f"JSON with cameras by name, {next(iter(table))} first, each with K and coefficients"
        )
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera, in the file's order."""
    tree = loaded(data, context)
    if len(tree.keys()) > MAX_CAMERAS:
        tree.fail(f"{len(tree.keys())} cameras, expected at most {MAX_CAMERAS}")
    several = len(tree.keys()) > 1
    found: list[Calibration] = []
    for name, node in tree.entries():
        for item in opencv_storage.cameras(node, context):
            label = "/".join(filter(None, (name, item.camera.sub_camera)))
            key = replace(item.camera, sub_camera=label if several or item.camera.sub_camera else None)
            found.append(replace(item, camera=key, provenance=replace(item.provenance, tag=label)))
    return found


def _is_camera(value: Json) -> bool:
    keys = [simplified(key) for key in value] if isinstance(value, dict) and len(value) < 100 else []
    return any(MATRIX.fullmatch(key) for key in keys) and any(VECTOR.fullmatch(key) for key in keys)


FORMAT = Format(
    name="multiview_calib",
    title="OpenCV cameras by name in JSON (multiview_calib)",
    suffixes=(".json",),
    syntaxes=(Syntax.JSON,),
    reference="https://github.com/cvlab-epfl/multiview_calib",
    convention=opencv_storage.FORMAT.convention,
    sniff=sniff,
    read=read,
    options=opencv_storage.FORMAT.options,
)
