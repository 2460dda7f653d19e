"""vikit's camera parameters, which SVO, FAST-LIVO and FAST-LIVO2 read.

In the format's own words::

    cam_model: Pinhole             # EquidistantCamera, ATAN, PolynomialCamera, Ocam
    cam_width: 640
    cam_height: 512
    scale: 0.5                     # the program shrinks its images by it before use
    cam_fx: 431.795
    cam_fy: 431.550
    cam_cx: 310.833
    cam_cy: 266.986
    cam_d0: -0.0944                # k1
    cam_d1: 0.0947                 # k2
    cam_d2: -0.0081                # p1
    cam_d3: 0.0001                 # p2

EquidistantCamera has k1 to k4 of cv2.fisheye. ATAN is the FOV model with cam_d0 its angle, and there cam_fx … cam_cy
are fractions of the image's sides, counted from the corner of the first pixel. A coefficient that is left out is
zero. PolynomialCamera, which FAST-LIVO2's FishPoly is as well, takes θ to θ(1 + k2·θ + k3·θ² + … + k7·θ⁶); it is read
where k5, k6 and k7 are zero.

Sources: rpg_vikit as FAST-LIVO2 has it, ``vikit_ros/include/vikit/camera_loader.h`` and
``vikit_common/src/{polynomial,atan}_camera.cpp``.
"""

from __future__ import annotations

from collections.abc import Callable

from calibrary.calibration import Calibration
from calibrary.distortion import Distortion, FieldOfView, FisheyePolynomial, NoDistortion
from calibrary.errors import UnsupportedModelError
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, Unit
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._one_camera import camera, fisheye, refuse_model
from calibrary.parsers.formats._opencv_lens import lens
from calibrary.records import replace

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("cam_d0", "cam_d1", "cam_d2", "cam_d3"),
    remarks=(
        "they are OpenCV's k1, k2, p1, p2; EquidistantCamera has k1 to k4 of cv2.fisheye",
        "ATAN's K is in fractions of each side, from the outer corner of the top-left pixel",
    ),
)
RELATIVE = Convention(unit=Unit.EACH_SIDE, origin=Origin.CORNER)
NAMES = {
    "width": ("cam_width", "image_width"), "height": ("cam_height", "image_height"), "fx": ("cam_fx", "A11"),
    "fy": ("cam_fy", "A22"), "cx": ("cam_cx", "u0"), "cy": ("cam_cy", "v0"), "skew": ("cam_skew", "A12"),
}  # fmt: skip
"""Each number's name, and that in FAST-LIVO2's rigs of several cameras."""
MAX_CAMERAS = 1000


def sniff(content: Content) -> Sniff | None:
    """The key cam_model, alone or in the cameras that cam_num counts."""
    keys = set(content.yaml_keys)
    if {"cam_model", "cam_width", "cam_fx"} <= keys:
        return Sniff(Sure.MAGIC, "the keys cam_model, cam_width and cam_fx")
    if "cam_num" in keys and "cam_0" in keys and "cam_model:" in (content.text or ""):
        return Sniff(Sure.MAGIC, "the keys cam_num and cam_0 with a cam_model")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The camera of the file, or those of the rig."""
    tree = storage.load(data, source=context.name)
    if "cam_num" not in tree:
        return [_camera(tree, context, None)]
    count = tree["cam_num"].whole()
    if not 1 <= count <= MAX_CAMERAS:
        tree["cam_num"].fail(f"{count} cameras, expected 1 to {MAX_CAMERAS}")
    names = [f"cam_{index}" for index in range(count)]
    return [_camera(tree[name], context, name if count > 1 else None) for name in names]


def _camera(node: Node, context: ReadContext, name: str | None) -> Calibration:
    model = node["cam_model"]
    if model.text() not in LENSES:
        refuse_model(model.text(), tuple(LENSES), place=model.place)
    width, height, fx, fy, cx, cy = (_by_either_key(node, key).number() for key in list(NAMES)[:6])
    skew = _by_either_key(node, "skew").number() if LENSES[model.text()] is _polynomial else 0.0
    item = camera(
        context,
        RELATIVE if model.text() == "ATAN" else CONVENTION,
        Native(fx=fx, fy=fy, cx=cx, cy=cy, skew=skew),
        Node({"w": width, "h": height}, source=context.name).image_size("w", "h"),
        LENSES[model.text()](node),
        name=name,
        tag=node.place,
    )
    scale = node.get("scale")
    if scale is None or scale.number() == 1:
        return item
    note = f"vikit shrinks the images by the file's scale, {scale.number():g}; K is of the size before"
    return replace(item, notes=(*item.notes, note))


def _by_either_key(node: Node, key: str) -> Node:
    own, other = NAMES[key]
    return node[other] if other in node else node[own]


def _numbers(node: Node, *names: str) -> list[float]:
    """The coefficients; vikit takes zero for one that is left out."""
    return [found.number() if (found := node.get(name)) is not None else 0.0 for name in names]


def _pinhole(node: Node) -> Distortion:
    return lens(_numbers(node, *CONVENTION.coefficients))


def _equidistant(node: Node) -> Distortion:
    return fisheye(_numbers(node, "k1", "k2", "k3", "k4"))


def _atan(node: Node) -> Distortion:
    omega = node["cam_d0"].number()
    return FieldOfView(omega=omega) if omega else NoDistortion()


def _polynomial(node: Node) -> Distortion:
    k2, k3, k4, *higher = _numbers(node, "k2", "k3", "k4", "k5", "k6", "k7")
    if any(higher):
        raise UnsupportedModelError(
            "the fisheye's polynomial reaches θ⁷ with even powers, which has no counterpart here; calibrate with "
            "vikit's EquidistantCamera, which is cv2.fisheye's model",
            place=node.place,
        )
    return FisheyePolynomial(k2=k2, k3=k3, k4=k4)


LENSES: dict[str, Callable[[Node], Distortion]] = {
    "Pinhole": _pinhole,
    "EquidistantCamera": _equidistant,
    "ATAN": _atan,
    "PolynomialCamera": _polynomial,
    "FishPoly": _polynomial,
}

FORMAT = Format(
    name="vikit",
    title="vikit camera (SVO, FAST-LIVO2)",
    suffixes=(".yaml", ".yml"),
    syntaxes=(Syntax.TEXT,),
    reference="https://github.com/xuankuzcr/rpg_vikit",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
