"""Identification of the camera that took an image: the key for the registry, with the catalogue's sub-camera."""

from __future__ import annotations

from datetime import date
from pathlib import Path

from msgspec import Struct

from calibrary.calibration import CameraKey
from calibrary.catalogue import Catalogue, load_catalogue, match_image
from calibrary.errors import InputError
from calibrary.evidence.identity import camera_key, firmware
from calibrary.evidence.metadata import ImageMetadata
from calibrary.known_camera import KnownCamera
from calibrary.records import replace

__all__ = ["Identified", "identified", "image_day", "image_key"]


class Identified(Struct, frozen=True, kw_only=True):
    """A camera identified from an image.

    Attributes:
        key: with the firmware: it is not used to group images, but an entry may apply to one firmware only.
        camera: its row of the catalogue, None for an unknown camera.
        siblings: the other cameras with the same EXIF Model.
        why: how the row was found, or why there is none.
    """

    key: CameraKey
    camera: KnownCamera | None
    siblings: tuple[KnownCamera, ...]
    why: str


def identified(metadata: ImageMetadata, catalogue: Catalogue) -> Identified:
    """Identify the camera that wrote this metadata."""
    match = match_image(catalogue, metadata)
    inferred = match.camera.sub_camera if match.camera is not None else None
    return Identified(
        key=replace(camera_key(metadata, inferred), firmware=firmware(metadata)),
        camera=match.camera,
        siblings=match.siblings or match.candidates,
        why=match.reason,
    )


def image_day(path: Path) -> date | None:
    """The date of an image by the camera's clock, on which an entry must be valid.

    None if the image states no date or cannot be read; the reading of its metadata reports the error.
    """
    from calibrary.parsers.imagery.taken import taken_on  # noqa: PLC0415  the readers, which KEYs do not need

    try:
        return taken_on(path)
    except (InputError, OSError):
        return None


def image_key(path: Path) -> Identified:
    """Identify the camera that took an image.

    Raises:
        InputError: the file cannot be read or is not an image.
    """
    from calibrary.parsers.imagery import read_metadata  # noqa: PLC0415  the readers, which KEYs do not need

    return identified(read_metadata(path), load_catalogue())
