"""What a caller states of a camera, in the place of what its files say."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from calibrary.calibration import CameraKey
from calibrary.known_camera import hash_serial, is_serial_hash
from calibrary.records import replace

__all__ = ["CameraLike", "hash_serial", "hashed", "overlay"]

CameraLike: TypeAlias = CameraKey | Callable[[CameraKey], CameraKey]
"""The fields that are stated, None leaving one to the files; or a function from what is known to what is meant."""


def overlay(camera: CameraLike | None) -> Callable[[CameraKey], CameraKey]:
    """Replaces what files state of their camera by what the caller does; a serial number by its hash."""
    if callable(camera):
        said = camera
        return lambda known: hashed(said(known))
    names = CameraKey.__struct_fields__
    stated = {name: value for name in names if (value := getattr(camera, name, None)) is not None}
    return lambda known: hashed(replace(known, **stated))


def hashed(camera: CameraKey) -> CameraKey:
    """The key with the hash of its serial number in the number's place; 16 hexadecimal digits are a hash already."""
    if not camera.serial or is_serial_hash(camera.serial):
        return camera
    return replace(camera, serial=hash_serial(camera.make, camera.serial))
