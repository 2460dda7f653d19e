"""Finding the camera that took an image."""

from __future__ import annotations

from calibrary.evidence.identity import stated_sub_camera
from calibrary.evidence.metadata import ImageMetadata
from calibrary.registry.catalogue.matching import Catalogue, Match

__all__ = ["match_image"]


def match_image(catalogue: Catalogue, metadata: ImageMetadata) -> Match:
    """What the catalogue makes of everything an image says about its camera."""
    return catalogue.find(
        metadata.make,
        metadata.model,
        sub_camera=stated_sub_camera(metadata),
        size=metadata.size,
        focal_mm=metadata.focal_mm,
        focal_35mm=metadata.focal_35mm,
        lens=metadata.lens,
    )
