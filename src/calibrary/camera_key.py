"""The key of a camera; this module does not need NumPy."""

from __future__ import annotations

from calibrary.image_size import ImageSize
from calibrary.records import Record

__all__ = ["CameraKey"]


class CameraKey(Record):
    """Which camera a calibration belongs to. EXIF Model alone is not a key: four sub-cameras may share it.

    Attributes:
        make: as written in EXIF (stripped of padding).
        model: as written in EXIF.
        sub_camera: wide, tele, thermal or a band, if one model has several cameras.
        lens: the lens, if the camera has interchangeable lenses.
        focal_mm: nominal focal length in mm, or that of the zoom.
        capture_mode: what the camera does to the image: "dewarped", "zoom 2x", ….
        image_size: image size that K belongs to, in px.
        serial: serial number of the unit; only its hash is kept.
        firmware: version, as the camera writes it.

    >>> str(calibrary.CameraKey(make="DJI", model="FC6310R", focal_mm=8.8, image_size=(5472, 3648)))
    'DJI FC6310R 8.8 mm 5472×3648'
    """

    make: str | None = None
    model: str | None = None
    sub_camera: str | None = None
    lens: str | None = None
    focal_mm: float | None = None
    capture_mode: str | None = None
    image_size: ImageSize | None = None
    serial: str | None = None
    firmware: str | None = None

    def __str__(self) -> str:
        make, model = self.make or "", self.model or ""
        # Avoid "Canon Canon PowerShot".
        name = model if make and model.lower().startswith(make.lower()) else f"{make} {model}".strip()
        focal = f"{self.focal_mm:g} mm" if self.focal_mm is not None else None
        size = "{}×{}".format(*self.image_size) if self.image_size else None
        parts = [name or "unknown camera", self.sub_camera, self.lens, focal, self.capture_mode, size]
        return " ".join(part for part in parts if part)
