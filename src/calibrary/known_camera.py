"""What is known of a camera before any image of it is read: the type the catalogue and the registry share."""

from __future__ import annotations

from dataclasses import dataclass

from calibrary.calibration import ImageSize

__all__ = ["KnownCamera", "Projection"]

from enum import StrEnum


class Projection(StrEnum):
    """How the lens maps the world; only a perspective camera has a pinhole K."""

    PERSPECTIVE = "perspective"
    FISHEYE = "fisheye"


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownCamera:
    """One camera of the catalogue: a body, sub-camera and lens at its native frame.

    Attributes:
        make, models: as EXIF writes them; ``models`` holds every spelling that was seen.
        title: what people call it.
        sub_camera: "wide", "tele", "thermal", a band's name, … where one Model has several.
        lens: the lens, where it comes off.
        native_size: (width, height) px of the full frame.
        pitch_um: pixel pitch at the native size, None where no source gives one.
        focal_mm: nominal focal length.
        projection: perspective or fisheye.
        fx_over_w: expected fx / W at the native size, None where unknown.
        spread: relative half-width within which units and sources of this camera lie.
        conflicts: what the sources disagree about, in words.
        sources: where each number is from, by field name.
    """

    make: str
    models: tuple[str, ...]
    title: str
    sub_camera: str | None = None
    lens: str | None = None
    native_size: ImageSize | None = None
    pitch_um: float | None = None
    focal_mm: float | None = None
    focal_35mm: float | None = None
    projection: Projection = Projection.PERSPECTIVE
    fx_over_w: float | None = None
    spread: float | None = None
    conflicts: tuple[str, ...] = ()
    sources: tuple[tuple[str, str], ...] = ()
    exif_focal_trusted: bool = True
    """False where this camera is known to write a wrong EXIF FocalLength."""
