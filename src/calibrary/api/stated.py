"""What a caller states: of a camera, instead of what its files say, and of the days and firmware an entry is for."""

from __future__ import annotations

from collections.abc import Callable
from datetime import date
from typing import TypeAlias

from calibrary.calibration import CameraKey
from calibrary.known_camera import hash_serial, is_serial_hash
from calibrary.records import replace
from calibrary.registry.entry import Validity
from calibrary.registry.firmware import FirmwareRange

__all__ = ["CameraLike", "firmware_range", "hash_serial", "hashed", "overlay", "validity"]

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


def validity(first: date | None, last: date | None) -> Validity | None:
    """The days from one to another, both included; None where neither is stated."""
    return Validity(first=first, last=last) if first is not None or last is not None else None


def firmware_range(text: str) -> FirmwareRange:
    """The firmware versions from MIN to MAX, both included, out of "MIN..MAX", "MIN..", "..MAX" or one version.

    Raises:
        InputError: it is not a range.
    """
    first, dots, last = text.partition("..")
    ends = (first, last) if dots else (first, first)
    low, high = (end.strip(" .") or None for end in ends)
    return FirmwareRange(min=low, max=high)
