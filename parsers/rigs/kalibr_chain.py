"""Kalibr's camera chain: the pose of each camera relative to the previous one, ``T_cn_cnm1`` in metres.

Source: Kalibr, "YAML formats" of its wiki; ``kalibr_common/ConfigReader.py``.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

import numpy as np

from calibrary import parsers
from calibrary.arrays import FloatArray
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers.content import Content
from calibrary.records import replace
from calibrary.rig import Rig, RigCamera, RigPose

TITLE: Final = "Kalibr camera chain"
KEY: Final = "kalibr/T_cn_cnm1"
MM: Final = 1000.0


def sniff(content: Content) -> bool:
    """Whether it has the key T_cn_cnm1."""
    return "T_cn_cnm1" in (content.text or "")


def read(path: Path, _data: bytes) -> Rig:
    """Read the cameras with their poses relative to the first one."""
    chain = parsers.read(path, format="kalibr")
    R, t = np.eye(3), np.zeros(3)
    cameras = []
    for index, calibration in enumerate(chain):
        name = calibration.camera.sub_camera or f"cam{index}"
        if index:
            step = _step(dict(calibration.extras).get(KEY), path.name, name)
            R, t = step[:3, :3] @ R, step[:3, :3] @ t + step[:3, 3] * MM
        pose = RigPose.of(R, t) if index else None
        cameras.append(RigCamera(name=name, pose=pose, calibration=calibration))
    return Rig(cameras=tuple(cameras))


def _step(text: str | None, source: str, name: str) -> FloatArray:
    try:
        matrix = np.array(json.loads(text or "null"), dtype=np.float64)
    except (ValueError, TypeError):
        matrix = np.zeros(0)
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all():
        raise ParseError("expected T_cn_cnm1 as four rows of four numbers", source=source, place=name)
    turn = matrix[:3, :3]
    if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-3) or np.linalg.det(turn) < 0:
        raise ParseError("T_cn_cnm1 is not a rotation and a translation", source=source, place=name)
    return matrix


def write(rig: Rig, name: str) -> bytes:
    """Write Kalibr's keys; Kalibr's radtan has no k3, so a lens with k3 is refused, as for a single camera.

    Raises:
        UnsupportedModelError: Kalibr cannot represent a lens.
    """
    chain = []
    for index, camera in enumerate(rig.cameras):
        if camera.calibration is None:
            raise UnsupportedModelError(f"{camera.name} has no K, which Kalibr's chain needs", source=name)
        extras = [pair for pair in camera.calibration.extras if pair[0] != KEY]
        if index:
            R, t = rig.pose(camera.name, before=rig.cameras[index - 1].name)
            step = np.eye(4)
            step[:3, :3], step[:3, 3] = R, t / MM
            extras.append((KEY, json.dumps(step.tolist())))
        key = replace(camera.calibration.camera, sub_camera=f"cam{index}")
        chain.append(replace(camera.calibration, camera=key, extras=tuple(extras)))
    return parsers.encode(chain, "kalibr", name=name)[0]
