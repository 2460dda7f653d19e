"""A stereo pair as written by OpenCV's stereo_calib.cpp: M1 D1 M2 D2, and R, T with x_2 = R x_1 + T.

The sample writes two files, intrinsics.yml and extrinsics.yml. Both are read; a single file with all data is
written. OpenCV states no unit of length: millimetres are written, and assumed when reading.

Source: OpenCV, ``samples/cpp/stereo_calib.cpp``; "Camera Calibration and 3D Reconstruction", stereoCalibrate.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

import numpy as np

from calibrary import parsers
from calibrary.arrays import FloatArray
from calibrary.calibration import Calibration
from calibrary.errors import CalibraryError, ParseError, UnsupportedModelError
from calibrary.parsers.content import Content
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats.opencv_storage import PREFIX
from calibrary.records import Json, replace
from calibrary.rig import Rig, RigCamera, RigPose

TITLE: Final = "OpenCV stereo calibration (R, T)"
BESIDE: Final = ("intrinsics.yml", "intrinsics.yaml", "intrinsics.xml")
"""Names of the other file written by stereo_calib.cpp."""


def sniff(content: Content) -> bool:
    """Whether it is a FileStorage with R and T at the top level."""
    text = content.text or ""
    yaml = "\nR:" in text and "\nT:" in text
    return yaml or ("<R " in text and "<T " in text)


def read(path: Path, data: bytes) -> Rig:
    """Read two cameras, with lenses from this file or from intrinsics.yml in the same folder."""
    tree = storage.load(data, source=path.name)
    R = np.array(storage.matrix(tree["R"], 3, 3))
    t = np.array(storage.numbers(tree["T"]))
    if t.shape != (3,):
        tree["T"].fail(f"{t.size} numbers, expected 3")
    if not np.allclose(R @ R.T, np.eye(3), atol=1e-3) or np.linalg.det(R) < 0:
        raise ParseError("R is not a rotation", source=path.name, place="R")
    first, second = _lenses(path, has_own="M1" in tree or "camera_matrix_left" in tree)
    return Rig(
        cameras=(
            RigCamera(name="left", calibration=first),
            RigCamera(name="right", pose=RigPose.of(R, t), calibration=second),
        )
    )


def _lenses(path: Path, *, has_own: bool) -> tuple[Calibration | None, Calibration | None]:
    """The lenses of the pair; None if no file states them or the image size."""
    places = [path] if has_own else [path.with_name(name) for name in BESIDE]
    for place in places:
        if place.is_file():
            try:
                found = parsers.read(place, format="opencv_storage")
            except CalibraryError:
                continue
            if len(found) == 2:
                return found[0], found[1]
    return None, None


def write(rig: Rig, name: str) -> bytes:
    """Write one file with M1 D1 M2 D2 R T, in mm.

    Raises:
        UnsupportedModelError: there are more than two cameras, or they have different image sizes.
    """
    if len(rig.cameras) != 2:
        raise UnsupportedModelError(
            f"OpenCV's stereo file holds two cameras, this rig has {len(rig.cameras)}; write kalibr or colmap",
            source=name,
        )
    first, second = rig.cameras
    if first.calibration is None or second.calibration is None:
        raise UnsupportedModelError("a camera of the rig has no K", source=name)
    R, t = rig.pose(second.name, before=first.name)
    extras = ((PREFIX + "R", _matrix(R)), (PREFIX + "T", _matrix(t[:, None])))
    pair = [
        replace(item, camera=replace(item.camera, sub_camera=label), extras=extras)
        for label, item in (("1", first.calibration), ("2", second.calibration))
    ]
    return parsers.encode(pair, "opencv_storage", name=name)[0]


def _matrix(values: FloatArray) -> str:
    rows, columns = values.shape
    tree: dict[str, Json] = {
        "rows": rows,
        "cols": columns,
        "dt": "d",
        "data": list[Json](values.ravel().tolist()),
    }
    return json.dumps(tree)
