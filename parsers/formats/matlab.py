"""MATLAB's cameras, in its own files and as JSON."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from calibrary.calibration import Calibration, ImageSize
from calibrary.distortion import BrownConrady, Distortion, NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats import bouguet_m, hand_made, opencv_storage
from calibrary.parsers.formats._by_hand import cameras_in
from calibrary.parsers.formats._lenses import taylor_lens, upper_triangle
from calibrary.parsers.formats._mat5 import HEADER, variables
from calibrary.parsers.formats._one_camera import camera, native_of
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


HDF5 = b"MATLAB 7.3 MAT-file"
MAX_BYTES = 16 * 1024 * 1024
WAY_OUT = (
    "In MATLAB: s = toStruct(cameraParams); f = fopen('camera.json', 'w'); fprintf(f, '%s', jsonencode(s)); fclose(f); "
    "with calibrationSession.CameraParameters in place of cameraParams for a session of the calibrator. Then read "
    "camera.json"
)


def sniff_mat(content: Content) -> Sniff | None:
    """MATLAB's own first line."""
    if content.data.startswith((HEADER, HDF5)):
        return Sniff(Sure.MAGIC, f"it begins with {content.data[:19].decode()}")
    return None


def read_mat(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera among the variables."""
    if data.startswith(HDF5):
        raise UnsupportedModelError(f"MATLAB files of version 7.3 are not read. {WAY_OUT}")
    strict.refuse_longer(data, context.at_most(MAX_BYTES), "a MATLAB file without --max-size-mib")
    found = variables(data, source=context.name)
    tree = Node(found.values, source=context.name)
    structs = cameras(tree, context)
    if structs:
        return structs
    if {"fc", "cc", "kc"} <= found.values.keys():
        named = {name: _words(value) for name, value in found.values.items() if name in bouguet_m.WANTED}
        return [bouguet_m.camera_of(named, context)]
    if cameras_in(tree):
        return hand_made.cameras(tree, context, prefix=opencv_storage.PREFIX)
    if found.classes:
        raise UnsupportedModelError(
            f"it holds an object of the class {strict.shown(found.classes[0])}, which cannot be read here. {WAY_OUT}",
        )
    names = ", ".join(map(strict.shown, list(found.values)[:12])) or "none"
    raise ParseError(f"there is no camera; the variables are {names}")


def _words(value: Json) -> str:
    """Numbers as MATLAB's script has them."""
    return " ".join(map(repr, value)) if isinstance(value, list) else repr(value)


MAT = Format(
    name="matlab_mat",
    title="MATLAB file of camera parameters (.mat)",
    words="""\
Cameras in MATLAB's ``.mat`` files: structs of cameraParameters, Bouguet's Calib_Results, and scipy's savemat.

In the format's own words::

    cameraParams   struct: IntrinsicMatrix, RadialDistortion, TangentialDistortion, ImageSize …   toStruct(cameraParams)
    fc cc kc alpha_c nx ny fc_error …                                                            Calib_Results.mat
    mtx dist, K D …                                                                              scipy.io.savemat

The structs are MATLAB's (``_matlab_camera``), counted from (1, 1); Bouguet's variables are those of Calib_Results.m and
count from (0, 0), as OpenCV's names (``parsers.names``) do. A ``calibrationSession.mat`` or a saved ``cameraParams``
holds objects, whose properties are in the file's subsystem (``_mcos``). Version 7.3 is an HDF5 file and refused with
the lines that save the numbers.

Sources: The MathWorks, "MAT-File Format"; J.-Y. Bouguet, "Camera Calibration Toolbox for MATLAB"; SciPy, ``scipy.io``.
""",
    suffixes=(".mat",),
    syntaxes=(Syntax.BINARY,),
    reference="https://www.mathworks.com/help/vision/ref/cameraparameters.html",
    convention=CONVENTION,
    sniff=sniff_mat,
    read=read_mat,
    options=hand_made.FORMAT.options,
)


def sniff_json(content: Content) -> Sniff | None:
    """MATLAB's names of the distortion beside those of K."""
    document = content.json
    if isinstance(document, dict):
        if any(is_camera(value) for value in (document, *document.values())):
            return Sniff(Sure.MAGIC, "JSON with RadialDistortion and MATLAB's names of K")
        return None
    if "RadialDistortion" not in (content.text or ""):
        return None
    keys = {line.partition(":")[0].strip("\"' ") for line in content.lines}
    if "RadialDistortion" in keys and keys & {"IntrinsicMatrix", "FocalLength"} and not content.xml_tags:
        return Sniff(Sure.MAGIC, "the keys RadialDistortion and MATLAB's names of K")
    return None


def read_json(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera among the structs."""
    tree = storage.load(data, source=context.name)
    found = cameras(tree, context)
    if not found:
        tree.fail("there is no struct with RadialDistortion and a K, an IntrinsicMatrix or a FocalLength")
    return found


JSON = Format(
    name="matlab_json",
    title="MATLAB camera parameters in JSON or YAML",
    words="""\
MATLAB's camera parameters as JSON or YAML: ``jsonencode(toStruct(cameraParams))`` and what scripts make of it.

In the format's own words::

    {"RadialDistortion": [-0.1131, 0.0247], "TangentialDistortion": [0, 0], "ImageSize": [3648, 5472],
     "IntrinsicMatrix": [[3650.1, 0, 0], [0, 3648.7, 0], [2741.3, 1815.9, 1]], "MeanReprojectionError": 0.31}

The fields are MATLAB's own (``_matlab_camera``): the matrix is transposed, or called K and is not, the centre of the
first pixel is (1, 1), and sizes are rows and columns. The struct may be under a name, and there may be several.

Source: The MathWorks, "cameraParameters" and ``jsonencode``.
""",
    suffixes=(".json", ".yaml", ".yml"),
    syntaxes=(Syntax.JSON, Syntax.TEXT),
    reference="https://www.mathworks.com/help/vision/ref/cameraparameters.tostruct.html",
    convention=CONVENTION,
    sniff=sniff_json,
    read=read_json,
)

FORMATS = (
    MAT,
    JSON,
)
