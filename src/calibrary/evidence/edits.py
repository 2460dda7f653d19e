"""What an editor did to a frame since the camera wrote it: Adobe's crs: properties.

DJI's originals carry crs:HasSettings, HasCrop and AlreadyApplied as False, so that the properties are there
says nothing; only what they say was *applied* changes the pixels.
"""

from __future__ import annotations

from calibrary.evidence.metadata import ImageMetadata

__all__ = ["edits"]

SCHEMA = "crs"


def edits(metadata: ImageMetadata) -> tuple[str, ...]:
    """The applied edits that move pixels, in words; empty for a frame as the camera wrote it."""
    if not _says(metadata, "AlreadyApplied"):
        return ()
    found = {
        "an editor cropped the frame": _says(metadata, "HasCrop"),
        "an editor applied a lens profile": _says(metadata, "LensProfileEnable"),
    }
    return tuple(text for text, applied in found.items() if applied)


def _says(metadata: ImageMetadata, name: str) -> bool:
    return (metadata.xmp_text(SCHEMA, name) or "").lower() in {"true", "1"}
