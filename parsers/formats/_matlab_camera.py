"""MATLAB's ``cameraParameters`` and ``cameraIntrinsics`` as structs, in any container.

Fields after ``toStruct(cameraParams)``::

    RadialDistortion       [k1 k2] or [k1 k2 k3]
    TangentialDistortion   [p1 p2]
    ImageSize              [rows columns]
    IntrinsicMatrix        [fx 0 0; s fy 0; cx cy 1]          transposed, until R2022b
    K                      [fx s cx; 0 fy cy; 0 0 1]          since
    FocalLength, PrincipalPoint, Skew                         of cameraIntrinsics
    MappingCoefficients [a0 a2 a3 a4], DistortionCenter, StretchMatrix [c d; e 1]      of fisheyeIntrinsics

A fisheye's ray is (x, y, a0 + a2·ρ² + a3·ρ³ + a4·ρ⁴) of (u, v) = StretchMatrix·(x, y) + DistortionCenter, Scaramuzza's
model. The centre of the first pixel is (1, 1), and p1 and p2 are OpenCV's. A struct of stereoParameters contains two
of these, CameraParameters1 and CameraParameters2. Other programs do not always transpose their
IntrinsicMatrix; the zeros show which.

Source: The MathWorks, "cameraParameters", "cameraIntrinsics", "cameraIntrinsicsToOpenCV" and "fisheyeIntrinsics" of the
Computer Vision Toolbox.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from calibrary.calibration import Calibration, ImageSize
from calibrary.distortion import BrownConrady, Distortion, NoDistortion
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import ReadContext
from calibrary.parsers.formats._one_camera import camera, native_of
from calibrary.parsers.formats._taylor import taylor_lens, upper_triangle
from calibrary.parsers.formats.hand_made import lens_in
from calibrary.parsers.text import image_size
from calibrary.records import Json, replace

CONVENTION: Final = Convention(
    origin=Origin.FIRST_IS_ONE,
    coefficients=("k1", "k2", "k3", "p1", "p2"),
    remarks=(
        "IntrinsicMatrix is transposed, K is not",
        "ImageSize is rows and columns",
        "the third radial coefficient may be left out",
    ),
)
MATRICES = ("K", "IntrinsicMatrix")
FISHEYE = frozenset({"MappingCoefficients", "DistortionCenter", "StretchMatrix"})
MAX_DEPTH = 4
MAX_CAMERAS = 100


def is_camera(value: Json) -> bool:
    """Whether a struct is a camera's."""
    return isinstance(value, dict) and (
        ("RadialDistortion" in value and any(key in value for key in (*MATRICES, "FocalLength")))
        or {"IntrinsicMatrix", "ImageSize"} <= value.keys()
        or _is_transposed(value.get("IntrinsicMatrix"))
        or value.keys() >= FISHEYE
    )


def _is_transposed(rows: Json) -> bool:
    """Whether a matrix is MATLAB's, with the principal point in its last row."""
    if not (
        isinstance(rows, list)
        and len(rows) == 3
        and all(isinstance(row, list) and len(row) == 3 for row in rows)
    ):
        return False
    return [row[2] for row in rows if isinstance(row, list)] == [0, 0, 1]


def cameras(tree: Node, context: ReadContext) -> list[Calibration]:
    """All cameras among the structs, named by their variable if there are several; empty if there are none."""
    found = list(_structs(tree, "", 0))
    if len(found) > MAX_CAMERAS:
        tree.fail(f"{len(found)} cameras, expected at most {MAX_CAMERAS}")
    return [_camera(node, context, name if len(found) > 1 else None, tag=name) for name, node in found]


def _structs(node: Node, name: str, depth: int) -> Iterator[tuple[str, Node]]:
    """Yield the outermost structs that are cameras; a cameraParameters contains its Intrinsics a second time."""
    if is_camera(node.value):
        yield name, node
    elif isinstance(node.value, dict) and depth < MAX_DEPTH:
        for key, child in node.entries():
            yield from _structs(child, f"{name}.{key}" if name else key, depth + 1)


def _camera(node: Node, context: ReadContext, name: str | None, *, tag: str) -> Calibration:
    native, lens, turned = (
        _fisheye(node) if set(node.keys()) >= FISHEYE else (_native(node), _lens(node, context), 0.0)
    )
    item = camera(context, CONVENTION, native, _size(node), lens, name=name, tag=tag or None)
    if turned:
        note = f"the camera's frame is turned about its axis by {math.degrees(turned):.4f}° against MATLAB's"
        item = replace(item, notes=(*item.notes, note))
    error = node.get("MeanReprojectionError")
    if error is None or not isinstance(error.value, int | float) or not error.value > 0:
        return item
    note = f"MATLAB's mean reprojection error, not an RMS, is {error.number():.4g} px"
    return replace(item, notes=(*item.notes, note))


def _native(node: Node) -> Native:
    key = next((key for key in MATRICES if key in node), None)
    if key is not None:
        rows = node[key].matrix(3, 3)
        return native_of(node[key], transposed=bool(rows[2][0] or rows[2][1]))
    fx, fy = node["FocalLength"].numbers(2)
    cx, cy = node["PrincipalPoint"].numbers(2)
    skew = node.get("Skew")
    return Native(fx=fx, fy=fy, cx=cx, cy=cy, skew=0.0 if skew is None else skew.number())


def _fisheye(node: Node) -> tuple[Native, Distortion, float]:
    """K and the lens of fisheyeIntrinsics, and the angle by which the stretch turns the camera about its axis."""
    a0, a2, a3, a4 = node["MappingCoefficients"].numbers(4)
    lens, f = taylor_lens((a0, 0.0, a2, a3, a4), place="MappingCoefficients")
    (c, d), (e, one) = node["StretchMatrix"].matrix(2, 2)
    if one != 1 or not c > 0:
        node["StretchMatrix"].fail("expected [c d; e 1] with c above zero")
    fx, skew, fy, turned = upper_triangle(f * c, 1 / c, e / c, d / c, place="StretchMatrix")
    cx, cy = node["DistortionCenter"].numbers(2)
    return Native(fx=fx, fy=fy, cx=cx, cy=cy, skew=skew), lens, turned


def _size(node: Node) -> ImageSize | None:
    """Image size (columns, rows); None for an empty ImageSize or zeros."""
    found = node.get("ImageSize")
    if found is None or found.value in ([], 0, 0.0) or found.value == [0, 0]:
        return None
    rows, columns = found.numbers(2)
    return image_size(columns, rows, source=found.source, place=found.place)


def _lens(node: Node, context: ReadContext) -> Distortion | None:
    """MATLAB's own coefficients, else those that a script put beside; None if there are none."""
    if "RadialDistortion" not in node:
        return lens_in(node, context)[1]
    radial = node["RadialDistortion"].numbers((2, 3))
    tangential = node.get("TangentialDistortion")
    p1, p2 = (0.0, 0.0) if tangential is None else tangential.numbers(2)
    if not any((*radial, p1, p2)):
        return NoDistortion()
    k1, k2, k3 = (*radial, 0.0)[:3]
    return BrownConrady(k1=k1, k2=k2, k3=k3, p1=p1, p2=p2)
