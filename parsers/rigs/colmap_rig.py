"""COLMAP's rig configuration, ``rig_config.json`` for ``colmap rig_configurator``: x_camera = R x_rig + t, in metres.

Example::

    [{"cameras": [
        {"image_prefix": "left/", "ref_sensor": true, "camera_model_name": "OPENCV", "camera_params": [ … ]},
        {"image_prefix": "right/", "cam_from_rig_rotation": [w, x, y, z], "cam_from_rig_translation": [x, y, z], …}
    ]}]

The rig's frame is that of the reference camera. An image prefix is a folder below COLMAP's image path.

Source: COLMAP, "Rig support" of its documentation; ``colmap/scene/rig.cc``, ReadRigConfig.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers.content import Content
from calibrary.parsers.document import Node
from calibrary.records import Json
from calibrary.rig import Rig, RigCamera, RigPose
from calibrary.rotations import from_quaternion, quaternion
from calibrary.strictjson import parse_json

TITLE: Final = "COLMAP rig configuration"
MM: Final = 1000.0


def sniff(content: Content) -> bool:
    """Whether it is a list with image prefixes."""
    return '"image_prefix"' in (content.text or "")


def read(path: Path, data: bytes) -> Rig:
    """Read the first rig of the file; its cameras have no K, because the file states no image size."""
    found = parse_json(data, source=path.name)
    if not isinstance(found, list) or not found:
        raise ParseError("expected a list with a rig", source=path.name)
    document = Node({"rigs": found[:1]}, source=path.name)
    cameras = []
    for node in document["rigs"].items()[0]["cameras"].items():
        name = node["image_prefix"].text().strip("/") or "camera"
        is_reference = (flag := node.get("ref_sensor")) is not None and flag.value is True
        if is_reference:
            cameras.append(RigCamera(name=name))
            continue
        rotation: FloatArray = np.array(node["cam_from_rig_rotation"].numbers(4))
        if not np.linalg.norm(rotation) > 0:
            node["cam_from_rig_rotation"].fail("a quaternion of zeros")
        shift = np.array(node["cam_from_rig_translation"].numbers(3)) * MM
        cameras.append(RigCamera(name=name, pose=RigPose.of(from_quaternion(rotation), shift)))
    return Rig(cameras=tuple(cameras))


def write(rig: Rig, name: str) -> bytes:
    """Write all cameras of the rig, each in a folder with its name, with its lens as a COLMAP model.

    Raises:
        UnsupportedModelError: no COLMAP model represents one of the lenses exactly.
    """
    cameras: list[Json] = []
    for camera in rig.cameras:
        entry: dict[str, Json] = {"image_prefix": f"{camera.name}/"}
        if camera.pose is None:
            entry["ref_sensor"] = True
        else:
            entry["cam_from_rig_rotation"] = quaternion(camera.pose.rotation).tolist()
            entry["cam_from_rig_translation"] = (camera.pose.translation / MM).tolist()
        if camera.calibration is not None:
            try:
                model, _, _, params = camera.calibration.to_colmap()
            except UnsupportedModelError as error:
                raise UnsupportedModelError(f"{camera.name}: {error.message}", source=name) from None
            entry |= {"camera_model_name": model, "camera_params": list(params)}
        cameras.append(entry)
    return (json.dumps([{"cameras": cameras}], indent=2) + "\n").encode()
