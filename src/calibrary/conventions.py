"""Pixel origins of file formats, and the conversion of principal points to the canonical origin.

The canonical origin is the outer corner of the top-left pixel (:mod:`calibrary.calibration`). Only this module
converts between origins.
"""

from __future__ import annotations

from enum import StrEnum

__all__ = ["Origin", "canonical_from_file", "file_from_canonical"]


class Origin(StrEnum):
    """Pixel origin of a principal point; the value is the phrase used in messages and reports."""

    CORNER = "the outer corner of the top-left pixel"
    PIXEL_CENTRE = "the centre of the top-left pixel"
    IMAGE_CENTRE = "the middle of the image"
    FIRST_IS_ONE = "the centre of the top-left pixel, which is (1, 1)"


def canonical_from_file(
    point: tuple[float, float], origin: Origin, image_size: tuple[int, int]
) -> tuple[float, float]:
    """Convert a principal point, (x, y) px with y down, from a file's origin to the canonical one."""
    dx, dy = _offset(origin, image_size)
    return point[0] + dx, point[1] + dy


def file_from_canonical(
    point: tuple[float, float], origin: Origin, image_size: tuple[int, int]
) -> tuple[float, float]:
    """Convert a principal point, (x, y) px, from the canonical origin to a file's origin."""
    dx, dy = _offset(origin, image_size)
    return point[0] - dx, point[1] - dy


def _offset(origin: Origin, image_size: tuple[int, int]) -> tuple[float, float]:
    """Return the file's origin in canonical coordinates, (x, y) px."""
    if origin is Origin.CORNER:
        return 0.0, 0.0
    if origin is Origin.PIXEL_CENTRE:
        return 0.5, 0.5
    if origin is Origin.FIRST_IS_ONE:
        return -0.5, -0.5
    return image_size[0] / 2, image_size[1] / 2
