"""Which files are images by their names."""

from __future__ import annotations

import os
from pathlib import Path

__all__ = ["IMAGE_SUFFIXES", "is_image"]

IMAGE_SUFFIXES = frozenset(
    {".jpg", ".jpeg", ".jpe", ".mpo", ".tif", ".tiff", ".dng", ".heic", ".heif", ".png"}
)
"""What a directory scan takes, in lower case. How a file is read is decided by its first bytes."""


def is_image(path: str | Path) -> bool:
    """Whether a file's name is an image's."""
    return os.path.splitext(path)[1].lower() in IMAGE_SUFFIXES  # noqa: PTH122  asked of every file
