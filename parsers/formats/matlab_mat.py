"""Cameras in MATLAB's ``.mat`` files: structs of cameraParameters, Bouguet's Calib_Results, and scipy's savemat.

In the format's own words::

    cameraParams   struct: IntrinsicMatrix, RadialDistortion, TangentialDistortion, ImageSize …   toStruct(cameraParams)
    fc cc kc alpha_c nx ny fc_error …                                                            Calib_Results.mat
    mtx dist, K D …                                                                              scipy.io.savemat

The structs are MATLAB's (``_matlab_camera``), counted from (1, 1); Bouguet's variables are those of Calib_Results.m and
count from (0, 0), as OpenCV's names (``parsers.names``) do. A ``calibrationSession.mat`` or a saved ``cameraParams``
holds objects, whose properties are in the file's subsystem (``_mcos``). Version 7.3 is an HDF5 file and refused with
the lines that save the numbers.

Sources: The MathWorks, "MAT-File Format"; J.-Y. Bouguet, "Camera Calibration Toolbox for MATLAB"; SciPy, ``scipy.io``.
"""

from __future__ import annotations

from calibrary.calibration import Calibration
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats import bouguet_m, hand_made, opencv_storage
from calibrary.parsers.formats._by_hand import cameras_in
from calibrary.parsers.formats._mat5 import HEADER, variables
from calibrary.parsers.formats._matlab_camera import CONVENTION, cameras
from calibrary.records import Json

HDF5 = b"MATLAB 7.3 MAT-file"
MAX_BYTES = 16 * 1024 * 1024
WAY_OUT = (
    "In MATLAB: s = toStruct(cameraParams); f = fopen('camera.json', 'w'); fprintf(f, '%s', jsonencode(s)); fclose(f); "
    "with calibrationSession.CameraParameters in place of cameraParams for a session of the calibrator. Then read "
    "camera.json"
)


def sniff(content: Content) -> Sniff | None:
    """MATLAB's own first line."""
    if content.data.startswith((HEADER, HDF5)):
        return Sniff(Sure.MAGIC, f"it begins with {content.data[:19].decode()}")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
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


FORMAT = Format(
    name="matlab_mat",
    title="MATLAB file of camera parameters (.mat)",
    suffixes=(".mat",),
    syntaxes=(Syntax.BINARY,),
    reference="https://www.mathworks.com/help/vision/ref/cameraparameters.html",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    options=hand_made.FORMAT.options,
)
