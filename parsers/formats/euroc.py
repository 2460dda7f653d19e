"""The ASL dataset format's ``sensor.yaml``, which came with the EuRoC recordings, and Kimera-VIO's camera files.

In the format's own words::

    sensor_type: camera
    comment: front, 5 mm
    T_BS: …                                                  # the sensor in the body's frame
    rate_hz: 20
    resolution: [752, 480]
    camera_model: pinhole
    intrinsics: [458.1, 457.9, 367.2, 248.4]                 # fu, fv, cu, cv
    distortion_model: radial-tangential                      # or equidistant
    distortion_coefficients: [-0.28, 0.07, 0.0002, 0.00002]  # k1, k2, p1, p2

The numbers are Kalibr's, the names of the models are not. Kimera-VIO has ``camera_id`` in place of sensor_type, says
radtan as well, and hands both lenses to OpenCV. Its omni cameras are OCamCalib's::

    camera_model: omni
    intrinsics: []                                           # or those of a pinhole to undistort to
    distortion_model: omni
    distortion_coefficients: [875.1, 0.0, -3.0e-4, -4.8e-8, 1.7e-11]
    omni_affine: [a, b, c]
    omni_distortion_center: [1005.8, 743.0]                  # u, v

A pixel is (u, v) = (1 a; b c)·(x, y) + centre, and its ray (x, y, d0 + d1·ρ + d2·ρ² + d3·ρ³ + d4·ρ⁴) with ρ² = x² + y².
K is d0·(1 a; b c) brought to its upper triangle, as for OCamCalib's own file; it is not what ``intrinsics`` states.

Sources: ETH Zürich ASL, "The EuRoC MAV datasets", ``dataset_tools``; Kimera-VIO, ``src/frontend/CameraParams.cpp`` and
``src/frontend/Camera.cpp`` (BackProjectOmni).
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence

from calibrary.calibration import Calibration
from calibrary.distortion import Distortion, KannalaBrandt, NoDistortion
from calibrary.errors import UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, WriteContext
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._json_text import restored
from calibrary.parsers.formats._opencv_lens import BrownWithoutK3, lens
from calibrary.parsers.formats._taylor import taylor_lens, upper_triangle
from calibrary.parsers.formats._yaml_text import flow, scalar

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    coefficients=("k1", "k2", "p1", "p2"),
    remarks=(
        "equidistant's four are k1, k2, k3, k4",
        "Kimera's omni has a ray's polynomial of the radius in px, from distorted to undistorted, as OCamCalib",
    ),
)


OWN_KEYS = (
    "resolution", "camera_model", "intrinsics", "distortion_model", "distortion_coefficients", "omni_affine",
    "omni_distortion_center", "omni_pol_inv",
)  # fmt: skip
LENSES = ("radial-tangential", "radtan", "equidistant", "none")
PREFIX = "euroc/"


def sniff(content: Content) -> Sniff | None:
    """The keys sensor_type and camera_model, or Kimera's camera_id with the same others."""
    keys = set(content.yaml_keys)
    if {"sensor_type", "camera_model"} <= keys:
        return Sniff(Sure.MAGIC, "the keys sensor_type and camera_model")
    if {"camera_model", "intrinsics", "distortion_model", "distortion_coefficients", "resolution"} <= keys:
        return Sniff(Sure.MAGIC, "the keys camera_model, intrinsics and distortion_coefficients")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera of the file."""
    tree = storage.load(data, source=context.name)
    width, height = tree["resolution"].numbers(2)
    size = context.size(strict.image_size(width, height, place="resolution"))
    native, distortion, notes = _omni(tree) if tree["camera_model"].text() == "omni" else _pinhole(tree)
    return [
        context.calibration(
            CONVENTION.intrinsics(native, size),
            distortion,
            notes=notes,
            extras=tuple(
                (PREFIX + key, json.dumps(node.value, ensure_ascii=False))
                for key, node in tree.entries()
                if key not in OWN_KEYS
            ),
        )
    ]


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """EuRoC's own keys, the resolution last; T_BS and the rest go back where the file they came from had them."""
    [calibration] = calibrations
    K, distortion = calibration.intrinsics, calibration.distortion or NoDistortion()
    native = CONVENTION.native(K)
    extras = {key.removeprefix(PREFIX): text for key, text in calibration.extras if key.startswith(PREFIX)}
    extras.setdefault("sensor_type", json.dumps("camera"))
    rows = [f"{key}: {scalar(restored(text))}" for key, text in extras.items() if key.isidentifier()]
    fisheye = isinstance(distortion, KannalaBrandt)
    rows += [
        "camera_model: pinhole",
        f"intrinsics: {flow([native.fx, native.fy, native.cx, native.cy])}",
        f"distortion_model: {'equidistant' if fisheye else 'radial-tangential'}",
        f"distortion_coefficients: {flow(list(distortion.coefficients.values()) or [0.0] * 4)}",
        f"resolution: [{K.image_size[0]}, {K.image_size[1]}]",
    ]
    return "".join(f"{row}\n" for row in rows).encode()


def _pinhole(tree: Node) -> tuple[Native, Distortion, tuple[str, ...]]:
    if tree["camera_model"].text() != "pinhole":
        _refuse(tree["camera_model"], "pinhole or omni")
    fu, fv, cu, cv = tree["intrinsics"].numbers(4)
    return Native(fx=fu, fy=fv, cx=cu, cy=cv), _distortion(tree), ()


def _omni(tree: Node) -> tuple[Native, Distortion, tuple[str, ...]]:
    kind = tree.get("distortion_model")
    if kind is not None and kind.text() not in {"omni", "none"}:
        _refuse(kind, "omni")
    polynomial, affine = tree["distortion_coefficients"], tree["omni_affine"]
    distortion, f = taylor_lens(polynomial.numbers(5), place=polynomial.place or "")
    a, b, c = affine.numbers(3)
    fx, skew, fy, turn = upper_triangle(f, c, b, a, place=affine.place or "")
    cu, cv = tree["omni_distortion_center"].numbers(2)
    turned = f"the camera's frame is turned about its axis by {math.degrees(turn):.4f}° against Kimera's"
    return Native(fx=fx, fy=fy, cx=cu, cy=cv, skew=skew), distortion, (turned,) if turn else ()


def _distortion(tree: Node) -> Distortion:
    kind = tree["distortion_model"]
    if kind.text() == "none":
        return lens(())
    if kind.text() not in LENSES:
        _refuse(kind, "radial-tangential or equidistant")
    values = tree["distortion_coefficients"].numbers(4)
    if kind.text() == "equidistant":
        return KannalaBrandt(**dict(zip(KannalaBrandt.names(), values, strict=True)))
    return lens(values)


def _refuse(node: Node, wanted: str) -> None:
    raise UnsupportedModelError(
        f"the model is {strict.shown(node.text())}, which has no counterpart here; expected {wanted}",
        source=node.source,
        place=node.place,
    )


FORMAT = Format(
    name="euroc",
    title="EuRoC/ASL sensor.yaml and Kimera-VIO camera",
    suffixes=(".yaml",),
    syntaxes=(Syntax.TEXT,),
    reference="https://projects.asl.ethz.ch/datasets/doku.php?id=kmavvisualinertialdatasets",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(models=(NoDistortion, BrownWithoutK3, KannalaBrandt)),
)
