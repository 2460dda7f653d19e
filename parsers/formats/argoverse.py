"""Argoverse's ``vehicle_calibration_info.json``: the cameras of a car, seven around and two ahead.

In the format's own words::

    {"camera_data_": [{"key": "image_raw_ring_front_center", "value": {
        "focal_length_x_px_": 1392.1, "focal_length_y_px_": 1392.1, "focal_center_x_px_": 980.1,
        "focal_center_y_px_": 604.3, "skew_": 0.0, "distortion_coefficients_": [-0.17, 0.12, -0.03],
        "vehicle_SE3_camera_": {…}}}, …]}

The three coefficients are k1, k2, k3 of OpenCV's polynomial. A camera whose key ends in ``_rect`` is of rectified
images, which have no distortion: the program projects into them with K alone, and the coefficients beside it are those
of the raw images. The file does not state image sizes: the data set's are
1920×1200 around the car and 2464×2056 ahead.

Source: argoverse-api, ``argoverse/utils/calibration.py``: ``CameraConfig`` ("distortion_coeffs: k1, k2, k3"),
``load_stereo_calib`` and ``project_cam_to_image`` for rectified ones; ``argoverse/utils/camera_stats.py``: the sizes.
"""

from __future__ import annotations

from calibrary.calibration import Calibration, ImageSize
from calibrary.distortion import NoDistortion
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, Tangential
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._json_text import loaded
from calibrary.parsers.formats._one_camera import camera
from calibrary.parsers.formats._opencv_lens import lens
from calibrary.records import replace

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    tangential=Tangential.NONE,
    coefficients=("k1", "k2", "k3"),
    remarks=("the image sizes are those of the data set, by the cameras' names",),
)
SIZES: dict[str, ImageSize] = {"image_raw_ring_": (1920, 1200), "image_raw_stereo_": (2464, 2056)}
SIZE_TAKEN = "the file does not state image sizes; those of Argoverse's cameras of this name were taken"
RECTIFIED = "_rect"
RAW = "distortion_coefficients_ is of the raw images; a rectified camera has no distortion"
MAX_CAMERAS = 100


def sniff(content: Content) -> Sniff | None:
    """The list of cameras under the API's own key."""
    if "camera_data_" in content.json_keys:
        return Sniff(Sure.MAGIC, "JSON with camera_data_")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera, by its key."""
    items = loaded(data, context)["camera_data_"].items()
    if len(items) > MAX_CAMERAS:
        raise items[0].fail(f"{len(items)} cameras; at most {MAX_CAMERAS} are read")
    return [_camera(item["key"].text(), item["value"], context) for item in items]


def _camera(name: str, node: Node, context: ReadContext) -> Calibration:
    native = Native(
        fx=node["focal_length_x_px_"].number(),
        fy=node["focal_length_y_px_"].number(),
        cx=node["focal_center_x_px_"].number(),
        cy=node["focal_center_y_px_"].number(),
        skew=node["skew_"].number(),
    )
    k1, k2, k3 = node["distortion_coefficients_"].numbers(3)
    size = next((size for start, size in SIZES.items() if name.startswith(start)), None)
    taken = (SIZE_TAKEN,) if size is not None else ()
    rectified = name.endswith(RECTIFIED)
    made = lens((k1, k2, 0.0, 0.0, k3)) if not rectified else NoDistortion()
    item = camera(context, CONVENTION, native, size, made, name=name, tag=node.place, assumptions=taken)
    return replace(item, notes=(*item.notes, RAW)) if rectified else item


FORMAT = Format(
    name="argoverse",
    title="Argoverse vehicle calibration",
    suffixes=(".json",),
    syntaxes=(Syntax.JSON,),
    reference="https://github.com/argoverse/argoverse-api",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
