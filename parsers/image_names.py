"""Recognition of image files by name."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["IMAGE_SUFFIXES", "is_image"]

IMAGE_SUFFIXES = frozenset(
    {".jpg", ".jpeg", ".jpe", ".mpo", ".tif", ".tiff", ".dng", ".heic", ".heif", ".png"}
)
"""Suffixes of images in a directory scan, in lower case. The first bytes of a file decide how it is read."""


def is_image(path: str | Path) -> bool:
    """Whether a file name has the suffix of an image."""
    return os.path.splitext(path)[1].lower() in IMAGE_SUFFIXES  # noqa: PTH122  asked of every file
