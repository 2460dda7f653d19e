"""MicaSense's rig relatives: the rotation of each band's camera into the frame of the reference band.

Every image of a RedEdge or Altum states it in XMP, ``Camera:RigRelatives``, as three angles in degrees. With
Rx, Ry and Rz the rotations about the axes, x_reference = Rx·Ry·Rz x_band. MicaSense's library also accepts a
JSON file (``Capture.set_external_rig_relatives``): by band index, the angles in rad, translations in m and K
in px.

Source: micasense/imageprocessing, ``micasense/image.py``: rotations_degrees_to_rotation_matrix, get_homography and
set_external_rig_relatives.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calibration import Origin, canonical_from_file
from calibrary.errors import InputError
from calibrary.parsers.content import Content
from calibrary.parsers.document import load_json
from calibrary.records import Json
from calibrary.rig import Rig, RigCamera, RigPose

TITLE: Final = "MicaSense rig relatives (JSON)"
MM: Final = 1000.0


def rotation_of_relatives(values: Sequence[str]) -> FloatArray:
    """Rotation (3, 3) into the reference band's frame, from the XMP property: "-0.1, 0.2, 0.05" or three items.

    Raises:
        InputError: the property does not contain three finite numbers.
    """
    parts = [part for value in values for part in value.split(",")]
    try:
        angles = [float(part) for part in parts]
    except ValueError:
        angles = []
    if len(angles) != 3 or not all(map(math.isfinite, angles)):
        raise InputError(f"RigRelatives {', '.join(parts)!r:.60}: expected three angles in degrees")
    return _turn(np.radians(angles))


def relatives_of(rotation: FloatArray) -> tuple[float, float, float]:
    """The three angles in degrees of a rotation (3, 3) into the reference band's frame."""
    y = math.asin(float(np.clip(rotation[0, 2], -1.0, 1.0)))
    x = math.atan2(-rotation[1, 2], rotation[2, 2])
    z = math.atan2(-rotation[0, 1], rotation[0, 0])
    return math.degrees(x), math.degrees(y), math.degrees(z)


def _turn(angles: FloatArray) -> FloatArray:
    (cx, cy, cz), (sx, sy, sz) = np.cos(angles).tolist(), np.sin(angles).tolist()
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(about_x @ about_y @ about_z)


def sniff(content: Content) -> bool:
    """Whether it has the key rig_relatives."""
    return '"rig_relatives"' in (content.text or "")


def read(path: Path, data: bytes) -> Rig:
    """Read the bands by index; the one without angles and translation is the reference, else the first."""
    document = load_json(data, source=path.name)
    turns, shifts = {}, {}
    for name, node in document.entries():
        turns[name] = _turn(np.array(node["rig_relatives"].numbers(3)))
        shifts[name] = np.array(node["rig_translations"].numbers(3)) * MM
    if not turns:
        document.fail("there is no band")
    first = next(
        (n for n in turns if np.allclose(turns[n], np.eye(3)) and not shifts[n].any()), next(iter(turns))
    )
    cameras = []
    for name, turn in turns.items():
        # The file's poses map into the reference band; the rig's map from the first camera.
        R = turn.T @ turns[first]
        t = turn.T @ (shifts[first] - shifts[name])
        cameras.append(RigCamera(name=name, pose=None if name == first else RigPose.of(R, t)))
    return Rig(cameras=tuple(cameras))


def write(rig: Rig, _name: str) -> bytes:
    """Write the JSON for MicaSense's library, with bands numbered from 0 in the rig's order."""
    document: dict[str, Json] = {}
    for index, camera in enumerate(rig.cameras):
        R, t = rig.pose(camera.name)
        band: dict[str, Json] = {
            "rig_relatives": np.radians(relatives_of(R.T)).tolist(),
            "rig_translations": (-R.T @ t / MM).tolist(),
        }
        if camera.calibration is not None:
            K = camera.calibration.intrinsics
            shift = canonical_from_file((0.0, 0.0), Origin.PIXEL_CENTRE, K.image_size)
            band |= {"fx": K.fx, "fy": K.fy, "cx": K.cx - float(shift[0]), "cy": K.cy - float(shift[1])}
        document[str(index)] = band
    return (json.dumps(document, indent=2) + "\n").encode()
