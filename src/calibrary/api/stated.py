"""Facts stated by the caller: about a camera, and the days and firmware that an entry applies to."""

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
"""Stated fields, where None leaves a field to the files; or a function from the known key to the final one."""


def overlay(camera: CameraLike | None) -> Callable[[CameraKey], CameraKey]:
    """Return a function that replaces fields of a camera key by the stated ones, and a serial number by its hash."""
    if callable(camera):
        said = camera
        return lambda known: hashed(said(known))
    names = CameraKey.__struct_fields__
    stated = {name: value for name in names if (value := getattr(camera, name, None)) is not None}
    return lambda known: hashed(replace(known, **stated))


def hashed(camera: CameraKey) -> CameraKey:
    """Replace the serial number in a key by its hash; 16 hexadecimal digits are taken to be a hash already."""
    if not camera.serial or is_serial_hash(camera.serial):
        return camera
    return replace(camera, serial=hash_serial(camera.make, camera.serial))


def validity(first: date | None, last: date | None) -> Validity | None:
    """Return the days from ``first`` to ``last``, both included; None if neither is stated."""
    return Validity(first=first, last=last) if first is not None or last is not None else None


def firmware_range(text: str) -> FirmwareRange:
    """Parse a range of firmware versions, both ends included: "MIN..MAX", "MIN..", "..MAX" or one version.

    Raises:
        InputError: the text is not a range.
    """
    first, dots, last = text.partition("..")
    ends = (first, last) if dots else (first, first)
    low, high = (end.strip(" .") or None for end in ends)
    return FirmwareRange(min=low, max=high)
