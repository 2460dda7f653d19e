"""What the user states of a calibration file that does not state it, and which of its cameras is meant."""

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
    """What the user states of files that do not state it, and where the registry is.

    Attributes:
        registry: its folder, None for the default one.
        format: of files whose content does not settle it.
        image_size: (width, height) px, for files that do not say it.
        size_from_centre: whether twice the principal point is taken for a size that nothing states.
        options: answers to what only a file's owner knows.
        camera: which one of a file with several, from 1.
        max_bytes: the longest file that is read.
    """

    registry: Path | None = None
    format: str | None = None
    image_size: ImageSize | None = None
    size_from_centre: bool = False
    options: Mapping[str, str] | None = None
    camera: int | None = None
    max_bytes: int = MAX_BYTES

    def read(self, path: Path) -> Sequence[Calibration]:
        """Every camera in a file, whichever is chosen.

        Raises:
            InputError: the kinds that :func:`calibrary.parsers.read` lists.
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
        """Every camera in a file that does not state its image size, as far as it is known without.

        Raises:
            InputError: the kinds that :func:`calibrary.parsers.read` lists.
        """
        return parsers.read_unsized(path, format=self.format, options=self.options, max_bytes=self.max_bytes)


def choose(
    cameras: Sequence[Calibration], number: int | None, *, source: str, how: str = "--camera N"
) -> Calibration:
    """One of a file's cameras.

    Args:
        cameras: all of them.
        number: which, from 1; None for the only one.
        source: the file's name, for messages.
        how: how to say which, for messages.

    Raises:
        InputError: there are several and no number, or none of that number.
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
