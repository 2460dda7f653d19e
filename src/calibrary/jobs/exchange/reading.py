"""The user's statements on a calibration file: what it does not state itself, and which of its cameras to use."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from msgspec import Struct

from calibrary import parsers
from calibrary.calibration import Calibration, ImageSize
from calibrary.errors import InputError
from calibrary.parsers.files import MAX_BYTES
from calibrary.parsers.unsized import UnsizedCalibration
from calibrary.progress import stage

__all__ = ["Reading", "choose"]

LISTED: Final = 8


class Reading(Struct, frozen=True, kw_only=True):
    """What files do not state themselves, and the registry.

    Attributes:
        registry: folder of the registry, None for the default one.
        format: format of files that cannot be identified by content.
        image_size: (width, height) px, for files that do not state it.
        size_from_centre: whether to assume twice the principal point as an unknown image size.
        options: values of format options that only the file's owner knows.
        camera: number of the camera in a file with several, from 1.
        max_bytes: largest file that is read.
    """

    registry: Path | None = None
    format: str | None = None
    image_size: ImageSize | None = None
    size_from_centre: bool = False
    options: Mapping[str, str] | None = None
    camera: int | None = None
    max_bytes: int = MAX_BYTES

    def read(self, path: Path) -> Sequence[Calibration]:
        """Read all cameras in a file, regardless of ``camera``.

        Raises:
            InputError: as for :func:`calibrary.parsers.read`.
        """
        with stage(f"read {path}"):
            return parsers.read(
                path,
                format=self.format,
                image_size=self.image_size,
                size_from_centre=self.size_from_centre,
                options=self.options,
                max_bytes=self.max_bytes,
            )

    def read_unsized(self, path: Path) -> list[Calibration | UnsizedCalibration]:
        """Read all cameras in a file that may not state its image size; such cameras are returned without it.

        Raises:
            InputError: as for :func:`calibrary.parsers.read`.
        """
        return parsers.read_unsized(path, format=self.format, options=self.options, max_bytes=self.max_bytes)


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
    more = f" and {len(cameras) - LISTED} more" if len(cameras) > LISTED else ""
    listed = "; ".join(f"{at} {item.camera}" for at, item in enumerate(cameras[:LISTED], start=1)) + more
    if number is None:
        raise InputError(f"holds {len(cameras)} cameras, choose one with {how}: {listed}", source=source)
    if not 1 <= number <= len(cameras):
        raise InputError(
            f"has no camera {number}; it holds {len(cameras)}, counted from 1, choose one with {how}: {listed}",
            source=source,
        )
    return cameras[number - 1]
