"""Edits made to an image after the camera wrote it, according to Adobe's crs: properties.

DJI's originals contain crs:HasSettings, HasCrop and AlreadyApplied with the value False, so the mere presence of
the properties means nothing. A property that is set moves pixels, unless AlreadyApplied is False. If AlreadyApplied
is missing, the edit counts as applied, because some programs leave it out.
"""

from __future__ import annotations

from calibrary.evidence.metadata import ImageMetadata

__all__ = ["edits"]

SCHEMA = "crs"
LENS_CORRECTIONS = ("LensProfileEnable", "LensManualDistortionAmount", "PerspectiveUpright")


def edits(metadata: ImageMetadata) -> tuple[str, ...]:
    """Edits made to the pixels, such as "lens-corrected by an editor"; empty for an original image."""
    if (metadata.xmp_text(SCHEMA, "AlreadyApplied") or "").lower() in {"false", "0"}:
        return ()
    found = {
        "cropped by an editor": _is_set(metadata, "HasCrop"),
        "lens-corrected by an editor": any(_is_set(metadata, name) for name in LENS_CORRECTIONS),
    }
    return tuple(text for text, applied in found.items() if applied)


def _is_set(metadata: ImageMetadata, name: str) -> bool:
    return (metadata.xmp_text(SCHEMA, name) or "false").lower() not in {"false", "0", "+0", "-0", "0.0"}
