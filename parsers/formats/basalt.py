"""Basalt's ``calibration.json``: all cameras of a rig, with their places beside the inertial unit.

In the format's own words::

    {"value0": {
        "T_imu_cam": […],
        "intrinsics": [
            {"camera_type": "ds",
             "intrinsics": {"fx": 349.2, "fy": 348.9, "cx": 365.7, "cy": 249.3, "xi": -0.2, "alpha": 0.56}}],
        "resolution": [[752, 480]], …}}

Every number is named. The camera types are ``pinhole``, ``pinhole-radtan8`` (OpenCV's rational model, good up to the
radius rpmax), ``kb4``, ``ucm`` and ``eucm`` (ucm being eucm with beta = 1), ``ds`` and ``fov`` (its angle is w).

Source: V. Usenko et al., basalt-headers, ``serialization/headers_serialization.h`` and ``camera/*.hpp``.
"""

from __future__ import annotations

from collections.abc import Callable

from calibrary.calibration import Calibration
from calibrary.distortion import (
    Distortion,
    DoubleSphere,
    ExtendedUnified,
    FieldOfView,
    KannalaBrandt,
    NoDistortion,
)
from calibrary.errors import UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._json_text import loaded
from calibrary.parsers.formats._opencv_lens import lens

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    remarks=(
        "coefficients are named",
        "with ds, K has the file's focal lengths, (1 + xi) times those of the pinhole near the axis",
    ),
)
RADTAN8 = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")


def sniff(content: Content) -> Sniff | None:
    """value0 with intrinsics that name their camera_type."""
    if content.json_keys != ("value0",):
        return None
    rig = Node(content.json, source=content.name)["value0"]
    if not isinstance(rig.value, dict):
        return None
    cameras = rig.value.get("intrinsics")
    if isinstance(cameras, list) and cameras and isinstance(cameras[0], dict) and "camera_type" in cameras[0]:
        return Sniff(Sure.MAGIC, "value0.intrinsics[0] has a camera_type")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera of the rig, in the file's order, named by its number."""
    rig = loaded(data, context)["value0"]
    cameras, sizes = rig["intrinsics"].items(), rig["resolution"].items()
    if len(cameras) != len(sizes):
        rig["resolution"].fail(f"{len(sizes)} resolutions of {len(cameras)} cameras")
    several = len(cameras) > 1
    return [
        _camera(f"cam{index}" if several else None, camera, size, context)
        for index, (camera, size) in enumerate(zip(cameras, sizes, strict=True))
    ]


def _camera(name: str | None, node: Node, resolution: Node, context: ReadContext) -> Calibration:
    width, height = resolution.numbers(2)
    size = context.size(strict.image_size(width, height, place=resolution.place))
    kind, numbers = node["camera_type"], node["intrinsics"]
    if kind.text() not in LENSES:
        raise UnsupportedModelError(
            f"the camera type is {strict.shown(kind.text())}, which has no counterpart here; "
            f"expected {', '.join(LENSES)}",
            place=kind.place,
        )
    distortion = LENSES[kind.text()](numbers)
    fx, fy, cx, cy = (numbers[key].number() for key in ("fx", "fy", "cx", "cy"))
    K = CONVENTION.intrinsics(Native(fx=fx, fy=fy, cx=cx, cy=cy), size)
    notes = []
    if isinstance(distortion, DoubleSphere) and distortion.xi:
        near = K.fx / (1 + distortion.xi)
        notes.append(
            f"K's fx is Basalt's; near the axis the camera is a pinhole of {near:.6g} px, fx/(1 + xi)"
        )
    if "rpmax" in numbers and numbers["rpmax"].number() > 0:
        notes.append(f"Basalt uses the lens up to the radius rpmax = {numbers['rpmax'].number():g} only")
    return context.calibration(K, distortion, name=name, tag=node.place, notes=tuple(notes))


def _kb4(node: Node) -> Distortion:
    return KannalaBrandt(**{name: node[name].number() for name in KannalaBrandt.names()})


def _ds(node: Node) -> Distortion:
    xi = node["xi"]
    if xi.number() <= -1:
        xi.fail(f"{xi.number():g}, expected a number above −1")
    return DoubleSphere(xi=xi.number(), alpha=_alpha(node))


def _eucm(node: Node) -> Distortion:
    beta = node["beta"]
    if beta.number() <= 0:
        beta.fail(f"{beta.number():g}, expected a positive number")
    return ExtendedUnified(alpha=_alpha(node), beta=beta.number())


def _alpha(node: Node) -> float:
    alpha = node["alpha"].number()
    if not 0 <= alpha <= 1:
        node["alpha"].fail(f"{alpha:g}, expected a number from 0 to 1")
    return alpha


LENSES: dict[str, Callable[[Node], Distortion]] = {
    "pinhole": lambda _node: NoDistortion(),
    "pinhole-radtan8": lambda node: lens([node[name].number() for name in RADTAN8]),
    "kb4": _kb4,
    "ucm": lambda node: ExtendedUnified(alpha=_alpha(node), beta=1.0),
    "eucm": _eucm,
    "ds": _ds,
    "fov": lambda node: FieldOfView(omega=node["w"].number()),
}

FORMAT = Format(
    name="basalt",
    title="Basalt calibration",
    suffixes=(".json",),
    syntaxes=(Syntax.JSON,),
    reference="https://gitlab.com/VladyslavUsenko/basalt-headers",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
