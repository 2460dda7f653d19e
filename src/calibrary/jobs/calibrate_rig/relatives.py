"""Relative poses that a payload writes into the metadata of its frames: MicaSense's RigRelatives."""

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
    """Read the rig that the metadata of one frame per camera state.

    Returns:
        The rig with zero translations, because only rotations are stated; None unless all cameras state one.
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
