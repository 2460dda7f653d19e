"""What one image says, and which image it is."""

from __future__ import annotations

import hashlib
import os
from datetime import date
from pathlib import PurePosixPath

import msgspec
from msgspec import Struct

from calibrary.errors import InputError
from calibrary.evidence.metadata import ImageMetadata
from calibrary.parsers.imagery.reader import read_source
from calibrary.parsers.imagery.source import Source
from calibrary.parsers.imagery.taken import day_of

__all__ = ["EXPORTS", "ID_BYTES", "Image", "Observation", "Seen", "names_a_camera", "observe", "path_order"]

ID_BYTES = 12
"""Two of 10⁹ images get the same 96 bits with a chance of 6 · 10⁻¹²."""

EXPORTS = frozenset({".png", ".tif", ".tiff"})
"""What programs write maps and previews as; cameras do too, but with their name in it."""


class Image(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One image that is to be read.

    Attributes:
        name: what the report calls it: its path below the folder, or as it stands in a list.
        place: the path or URL to open it by.
        same_as: the path or URL that identifies it, where that is not ``place``: a link's target.
        version: what changes when its content does (size and time, or an ETag), where the listing states it.
    """

    name: str
    place: str
    same_as: str | None = None
    version: str | None = None

    @property
    def id(self) -> bytes:
        """Which image it is: a digest of where it lies, links followed.

        Where it lies, and not what it contains: two frames of a hovering camera, or two that were stripped of their
        metadata, can agree in every byte of their heads and are two images all the same, each of which a solver
        gets; and a digest of the whole content would cost reading it. The same file that is listed twice, by a link,
        in two spellings of its path or by a shard that was done again, lies at one place and counts once. A copy
        (a hard link too) is an image of its own.
        """
        identity = os.fsencode(self.same_as or self.place)
        return hashlib.blake2b(identity, digest_size=ID_BYTES).digest()


class Seen(Struct, frozen=True, kw_only=True):
    """All that images can say which changes anything in a report; equal for most images of a flight.

    Attributes:
        metadata: of the camera.
        day: on which it was taken, where that is asked for and stated.
        is_export: whether an image that names no camera has a suffix that programs write maps and previews with.
    """

    metadata: ImageMetadata
    day: date | None = None
    is_export: bool = False


class Observation(Struct, frozen=True, kw_only=True):
    """One image's answer.

    Attributes:
        id: which image.
        name: what reports call it.
        seen: what it says; None where it cannot be read.
        reason: why it cannot.
        passing: whether another attempt may well succeed, as after a server's error.
    """

    id: bytes
    name: str
    seen: Seen | None = None
    reason: str = ""
    passing: bool = False


def observe(source: Source, image: Image, *, days: bool = False) -> Observation:
    """What the bytes of an image say of its camera: always the same of the same bytes, whatever else is in the run.

    Args:
        source: its bytes.
        image: which it is.
        days: also say on which day it was taken.
    """
    try:
        metadata = read_source(source)
        day = day_of(source) if days else None
    except InputError as error:
        return Observation(id=image.id, name=image.name, reason=error.message)
    exported = not names_a_camera(metadata) and PurePosixPath(image.name).suffix.lower() in EXPORTS
    return Observation(
        id=image.id, name=image.name, seen=Seen(metadata=metadata, day=day, is_export=exported)
    )


def names_a_camera(metadata: ImageMetadata) -> bool:
    """Whether an image states anything of a camera."""
    stated = (metadata.make, metadata.model, metadata.focal_mm, metadata.focal_35mm, metadata.xmp)
    return any(stated)


def path_order(name: str) -> str:
    """Sorts names folder by folder, as they are walked: "/" comes before whatever else a name may contain."""
    return name.replace("/", "\0")
