"""TheiaSfM's calibration file: what is known of the cameras of a reconstruction before it begins.

In the format's own words::

    {"priors": [
        {"CameraIntrinsicsPrior": {
            "image_name": "view_1.jpg", "width": 752, "height": 480, "focal_length": 433.2, "aspect_ratio": 0.9993,
            "principal_point": [371.6, 238.3], "skew": 0.0, "camera_intrinsics_type": "PINHOLE_RADIAL_TANGENTIAL",
            "radial_distortion_coeffs": [-0.21, 0.04, 0.006], "tangential_distortion_coeffs": [-0.0004, 0.0008]}}, …]}

fy is aspect_ratio · focal_length. PINHOLE has two radial coefficients, PINHOLE_RADIAL_TANGENTIAL three and OpenCV's p1
and p2, FISHEYE the four of cv2.fisheye, FOV its angle and DIVISION_UNDISTORTION one number in pixels, which is refused.
Where the principal point counts from is not stated. Images whose numbers are the same are one camera.

Source: TheiaSfM, ``src/theia/io/read_calibration.h`` and ``sfm/camera/pinhole_radial_tangential_camera_model.h``.
"""

from __future__ import annotations

from collections.abc import Sequence

from calibrary.calibration import Calibration, ImageSize
from calibrary.distortion import Distortion, FieldOfView, NoDistortion
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._json_text import loaded
from calibrary.parsers.formats._one_camera import ORIGIN, camera, chosen_origin, fisheye, refuse_model
from calibrary.parsers.formats._opencv_lens import lens
from calibrary.records import replace

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "k3", "p1", "p2"),
    remarks=("fy is aspect_ratio times focal_length", "the origin is not stated"),
)
LENGTHS = {"PINHOLE": (0, 1, 2), "PINHOLE_RADIAL_TANGENTIAL": (0, 1, 2, 3), "FISHEYE": (4,), "FOV": (1,)}
"""How many radial coefficients each model may state."""
KEY = "CameraIntrinsicsPrior"
MAX_IMAGES = 50_000


def sniff(content: Content) -> Sniff | None:
    """The one key, and that of its first item."""
    listed = content.json.get("priors") if isinstance(content.json, dict) else None
    first = listed[0] if isinstance(listed, list) and listed else None
    if isinstance(first, dict) and KEY in first:
        return Sniff(Sure.MAGIC, f"JSON with priors and {KEY}")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera that differs, in the order of the images, by the name of its first image."""
    priors = loaded(data, context)["priors"]
    items = priors.items()
    if len(items) > MAX_IMAGES:
        priors.fail(f"{len(items)} images, expected at most {MAX_IMAGES}")
    found: dict[tuple[ImageSize | None, Native, Distortion], str] = {}
    known = [item for item in items if "focal_length" in item[KEY]]
    without = len(items) - len(known)
    for item in known or items:
        node = item[KEY]
        size = node.image_size("width", "height") if "width" in node else None
        found.setdefault((size, _native(node), _lens(node)), node["image_name"].text())
    several = len(found) > 1
    origin, sentence = chosen_origin(context, CONVENTION.origin)
    convention = replace(CONVENTION, origin=origin)
    cameras = [
        camera(
            context, convention, K, size, k, name=name if several else None, tag=name, assumptions=(sentence,)
        )
        for (size, K, k), name in found.items()
    ]
    note = f"{without} of {len(items)} images state no focal length, and are left out"
    return [replace(item, notes=(*item.notes, note)) for item in cameras] if without else cameras


def _native(node: Node) -> Native:
    f, aspect = node["focal_length"].number(), node.get("aspect_ratio")
    cx, cy = node["principal_point"].numbers(2)
    skew = node.get("skew")
    return Native(
        fx=f,
        fy=f if aspect is None else f * aspect.number(),
        cx=cx,
        cy=cy,
        skew=0.0 if skew is None else skew.number(),
    )


def _lens(node: Node) -> Distortion:
    kind = node["camera_intrinsics_type"]
    if kind.text() not in LENGTHS:
        refuse_model(kind.text(), tuple(LENGTHS), place=kind.place)
    radial = _coefficients(node, "radial_distortion_coeffs", LENGTHS[kind.text()])
    if kind.text() == "FISHEYE":
        return fisheye(radial)
    if kind.text() == "FOV":
        return FieldOfView(omega=radial[0]) if radial[0] else NoDistortion()
    k1, k2, k3 = (*radial, 0.0, 0.0, 0.0)[:3]
    p1, p2 = (*_coefficients(node, "tangential_distortion_coeffs", (0, 2)), 0.0, 0.0)[:2]
    return lens((k1, k2, p1, p2, k3))


def _coefficients(node: Node, key: str, counts: Sequence[int]) -> tuple[float, ...]:
    found = node.get(key)
    return () if found is None and 0 in counts else node[key].numbers(counts)


FORMAT = Format(
    name="theia_priors",
    title="TheiaSfM calibration file",
    suffixes=(".json", ".txt"),
    syntaxes=(Syntax.JSON,),
    reference="https://github.com/sweeneychris/TheiaSfM",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    options=(ORIGIN,),
    idle=("radial_distortion_coeffs", "tangential_distortion_coeffs"),
)
