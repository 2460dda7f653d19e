"""Observation of one image: its identity and its metadata."""

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

ID_BYTES = 12
"""Length of an image id; among 10⁹ images two get the same 96 bits with a probability of 6 · 10⁻¹²."""

EXPORTS = frozenset({".png", ".tif", ".tiff"})
"""Suffixes of maps and previews written by programs; cameras use them too, but write their name into the file."""


class Image(msgspec.Struct, frozen=True, array_like=True, gc=False):
    """One image to be read.

    Attributes:
        name: name in the report: path relative to the folder, or as in a list.
        place: path or URL by which to open it.
        same_as: path or URL that identifies it if different from ``place``: the target of a link.
    """

    name: str
    place: str
    same_as: str | None = None

    @property
    def id(self) -> bytes:
        """Identity of the image: a digest of its location, with links followed.

        The location is used instead of the content, because two images of a hovering camera, or two without
        metadata, can have identical headers and are still two images for a solver, and a digest of the whole
        content would require reading it. A file that is listed twice, through a link, in two spellings of its
        path or by a repeated piece of work, has one location and counts once. A copy (also a hard link) is a separate
        image.
        """
        identity = os.fsencode(self.same_as or self.place)
        return hashlib.blake2b(identity, digest_size=ID_BYTES).digest()


class Seen(Struct, frozen=True, kw_only=True):
    """Everything in an image that affects a report; equal for most images of a flight.

    Attributes:
        metadata: of the camera.
        day: date of the image, if requested and stated.
        is_export: whether the image names no camera and has the suffix of a map or preview.
    """

    metadata: ImageMetadata
    day: date | None = None
    is_export: bool = False


class Observation(Struct, frozen=True, kw_only=True):
    """Result of reading one image.

    Attributes:
        id: identity of the image.
        name: name in reports.
        seen: metadata; None if it cannot be read.
        reason: why it cannot be read.
    """

    id: bytes
    name: str
    seen: Seen | None = None
    reason: str = ""


def observe(source: Source, image: Image, *, days: bool = False, pixels: bool = True) -> Observation:
    """Read the camera metadata of an image; the result depends only on its bytes.

    Args:
        source: its bytes.
        image: its identity.
        days: whether to read the date as well.
        pixels: whether its pixels are compared with its thumbnail where that may show a crop.
    """
    try:
        metadata = read_source(source, pixels=pixels)
        day = day_of(source) if days else None
    except InputError as error:
        return Observation(id=image.id, name=image.name, reason=error.message)
    exported = not names_a_camera(metadata) and PurePosixPath(image.name).suffix.lower() in EXPORTS
    return Observation(
        id=image.id, name=image.name, seen=Seen(metadata=metadata, day=day, is_export=exported)
    )


def names_a_camera(metadata: ImageMetadata) -> bool:
    """Whether the metadata state anything about a camera."""
    stated = (metadata.make, metadata.model, metadata.focal_mm, metadata.focal_35mm, metadata.xmp)
    return any(stated)


def path_order(name: str) -> str:
    """Sort key for names in the order of walking folders: "/" sorts before any other character."""
    return name.replace("/", "\0")
