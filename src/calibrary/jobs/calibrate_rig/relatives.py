"""The relative poses that a payload writes into its frames: MicaSense's RigRelatives."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from calibrary.errors import InputError
from calibrary.parsers.imagery import read_metadata
from calibrary.parsers.rigs.micasense import rotation_of_relatives
from calibrary.rig import Rig, RigCamera, RigPose

__all__ = ["stated_relatives"]


def stated_relatives(frames: Mapping[str, Path]) -> Rig | None:
    """The rig that frames state, from one frame of each camera.

    Returns:
        None where not every camera states its rotation. They state rotations only: the translations are zero.
    """
    turns = {}
    for name, path in frames.items():
        try:
            values = read_metadata(path).xmp_values("Camera", "RigRelatives")
            if values is None:
                return None
            turns[name] = rotation_of_relatives(values)
        except InputError:
            return None
    first, *others = turns
    return Rig(
        cameras=(
            RigCamera(name=first),
            *(
                RigCamera(name=name, pose=RigPose.of(turns[name].T @ turns[first], np.zeros(3)))
                for name in others
            ),
        )
    )
