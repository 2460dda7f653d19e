"""What an editor did to a frame since the camera wrote it: Adobe's crs: properties.

DJI's originals carry crs:HasSettings, HasCrop and AlreadyApplied as False, so that the properties are there
says nothing. What they state as set moves pixels, unless AlreadyApplied says that it was not applied yet; an
image that does not carry that word was written by a program that leaves it out.
"""

from __future__ import annotations

from calibrary.evidence.metadata import ImageMetadata

__all__ = ["edits"]

SCHEMA = "crs"
LENS_CORRECTIONS = ("LensProfileEnable", "LensManualDistortionAmount", "PerspectiveUpright")


def edits(metadata: ImageMetadata) -> tuple[str, ...]:
    """What an editor did to the pixels, as "lens-corrected by an editor"; empty for a frame as it was written."""
    if (metadata.xmp_text(SCHEMA, "AlreadyApplied") or "").lower() in {"false", "0"}:
        return ()
    found = {
        "cropped by an editor": _is_set(metadata, "HasCrop"),
        "lens-corrected by an editor": any(_is_set(metadata, name) for name in LENS_CORRECTIONS),
    }
    return tuple(text for text, applied in found.items() if applied)


def _is_set(metadata: ImageMetadata, name: str) -> bool:
    return (metadata.xmp_text(SCHEMA, name) or "false").lower() not in {"false", "0", "+0", "-0", "0.0"}
