"""What a caller states of a camera, in the place of what its files say."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from calibrary.calibration import CameraKey
from calibrary.known_camera import hash_serial
from calibrary.records import replace

__all__ = ["CameraLike", "hash_serial", "overlay"]

CameraLike: TypeAlias = CameraKey | Callable[[CameraKey], CameraKey]
"""The fields that are stated, None leaving one to the files; or a function from what is known to what is meant."""


def overlay(camera: CameraLike | None) -> Callable[[CameraKey], CameraKey]:
    """Replaces what files state of their camera by what the caller does."""
    if callable(camera):
        return camera
    names = CameraKey.__struct_fields__
    stated = {name: value for name in names if (value := getattr(camera, name, None)) is not None}
    return lambda known: replace(known, **stated)
