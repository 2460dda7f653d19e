"""Calibration files read as the user says: what a file does not state itself, and which of its cameras to use."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from calibrary import parsers
from calibrary.arguments import Reading
from calibrary.calibration import Calibration
from calibrary.errors import InputError, first_of
from calibrary.parsers.unsized import UnsizedCalibration
from calibrary.progress import stage

__all__ = ["choose", "chosen", "read_file", "read_unsized"]

LISTED: Final = 8


def read_file(path: Path, reading: Reading) -> Sequence[Calibration]:
    """Read all cameras in a file, regardless of ``reading.camera``.

    Raises:
        InputError: as for :func:`calibrary.parsers.read`.
    """
    with stage(f"read {path}"):
        return parsers.read(
            path,
            format=reading.format,
            image_size=reading.image_size,
            size_from_centre=reading.size_from_centre,
            options=reading.set,
            max_bytes=reading.max_bytes,
        )


def read_unsized(path: Path, reading: Reading) -> list[Calibration | UnsizedCalibration]:
    """Read all cameras in a file that may not state its image size; such cameras are returned without it.

    Raises:
        InputError: as for :func:`calibrary.parsers.read`.
    """
    return parsers.read_unsized(path, format=reading.format, options=reading.set, max_bytes=reading.max_bytes)


def chosen(path: Path, reading: Reading) -> Calibration:
    """Read the camera of a file that ``reading.camera`` chooses.

    Raises:
        InputError: as for :func:`calibrary.parsers.read` and :func:`choose`.
    """
    return choose(read_file(path, reading), reading.camera, source=path.name)


def choose(
    cameras: Sequence[Calibration], number: int | None, *, source: str, how: str = "--camera N"
) -> Calibration:
    """Choose one of a file's cameras.

    Args:
        cameras: all cameras of the file.
        number: number of the camera, from 1; None for the only one.
        source: file name, for messages.
        how: how the user chooses a camera, for messages.

    Raises:
        InputError: there are several cameras and no number, or no camera has the number.
    """
    if number is None and len(cameras) == 1:
        return cameras[0]
    listed = first_of((f"{at} {item.camera}" for at, item in enumerate(cameras, start=1)), LISTED, "; ")
    if number is None:
        raise InputError(f"holds {len(cameras)} cameras, choose one with {how}: {listed}", source=source)
    if not 1 <= number <= len(cameras):
        raise InputError(
            f"has no camera {number}; it holds {len(cameras)}, counted from 1, choose one with {how}: {listed}",
            source=source,
        )
    return cameras[number - 1]
