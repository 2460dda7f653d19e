"""Where a file counts its principal point from, and the half pixel between that and the canonical origin.

The canonical origin is the outer corner of the top-left pixel (:mod:`calibrary.calibration`). Nothing else
in the package knows half pixels.
"""

from __future__ import annotations

from enum import StrEnum

__all__ = ["Origin", "canonical_from_file", "file_from_canonical"]


class Origin(StrEnum):
    """Where a principal point counts from; the value is the sentence printed for people."""

    CORNER = "the outer corner of the top-left pixel"
    PIXEL_CENTRE = "the centre of the top-left pixel"
    IMAGE_CENTRE = "the middle of the image"
    FIRST_IS_ONE = "the centre of the top-left pixel, which is (1, 1)"


def canonical_from_file(
    point: tuple[float, float], origin: Origin, image_size: tuple[int, int]
) -> tuple[float, float]:
    """A principal point as a file counts it, (x, y) px with y down, to the canonical origin."""
    dx, dy = _offset(origin, image_size)
    return point[0] + dx, point[1] + dy


def file_from_canonical(
    point: tuple[float, float], origin: Origin, image_size: tuple[int, int]
) -> tuple[float, float]:
    """A principal point in the canonical origin, (x, y) px, as a file counts it."""
    dx, dy = _offset(origin, image_size)
    return point[0] - dx, point[1] - dy


def _offset(origin: Origin, image_size: tuple[int, int]) -> tuple[float, float]:
    """The file's origin in canonical coordinates."""
    if origin is Origin.CORNER:
        return 0.0, 0.0
    if origin is Origin.PIXEL_CENTRE:
        return 0.5, 0.5
    if origin is Origin.FIRST_IS_ONE:
        return -0.5, -0.5
    return image_size[0] / 2, image_size[1] / 2
