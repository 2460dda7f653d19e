"""The camera that took an image, as far as the image states it.

EXIF Model alone does not identify a camera: the wide, tele and thermal cameras of one payload share it, and so do
the bands of a multispectral head and the modes of one camera. Two images are of the same camera if the whole key is
equal. Firmware is not part of the key, so that a change of K after a firmware update stays visible in one history.
"""

from __future__ import annotations

from calibrary.calibration import CameraKey
from calibrary.evidence.dji import is_dewarped
from calibrary.evidence.metadata import ImageMetadata
from calibrary.evidence.originality import program_in


def firmware(metadata: ImageMetadata) -> str | None:
    """The camera's firmware: EXIF Software, or None if an image program wrote its own name there."""
    software = metadata.software
    return None if software is None or program_in(software) is not None else software


def camera_key(metadata: ImageMetadata, sub_camera: str | None = None) -> CameraKey:
    """The camera of an image; ``sub_camera`` is the inferred one, used if no tag names it."""
    modes = ["dewarped"] if is_dewarped(metadata) else []
    if metadata.zoom > 1.0:
        modes.append(f"zoom {metadata.zoom:.3g}×")
    return CameraKey(
        make=metadata.make,
        model=metadata.model,
        sub_camera=metadata.sub_camera or sub_camera,
        lens=metadata.lens,
        focal_mm=round(metadata.focal_mm, 2) if metadata.focal_mm is not None else None,
        capture_mode=", ".join(modes) or None,
        image_size=metadata.size,
        serial=metadata.serial,
    )
