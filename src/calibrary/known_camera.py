"""What is known of a camera before any image of it is read: the type the catalogue and the registry share."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Final

from calibrary.calibration import ImageSize

__all__ = ["BANDS", "SUB_CAMERAS", "KnownCamera", "Projection", "normalise_sub_camera"]

VISIBLE: Final = frozenset({"rgb", "wide", "zoom", "medium-tele", "tele"})
"""Sub-cameras that take colour pictures; "rgb" is what a tag says when it does not say which of them."""

BANDS: Final = frozenset({"blue", "green", "red", "red-edge", "nir", "panchromatic"})

SUB_CAMERAS: Final = VISIBLE | BANDS | {"thermal", "multispectral"}
"""The common vocabulary; any other word is an unknown tag."""

_SPELLINGS: Final = {
    "rgb": "rgb visible visual vis color colour truecolor truecolour eo",
    "wide": "wide wideangle",
    "zoom": "zoom",
    "medium-tele": "mediumtele mediumtelephoto",
    "tele": "tele telephoto",
    "thermal": "thermal infrared ir lwir tir",
    "multispectral": "multispectral",
    "blue": "blue",
    "green": "green gre",
    "red": "red",
    "red-edge": "rededge reg re",
    "nir": "nir nearinfrared",
    "panchromatic": "panchromatic panchro pan",
}
_WORDS: Final = {text: word for word, texts in _SPELLINGS.items() for text in texts.split()}
_LONGEST_TEXT: Final = 200
_LONGEST_WORD: Final = 48


def normalise_sub_camera(text: str) -> str | None:
    """The common word for what a tag calls a sub-camera or band.

    DJI's ImageSource ("WideCamera", "InfraredCamera"), Skydio's and FLIR's CameraSource ("COLOR", "IR") and
    every maker's BandName ("Red edge", "RedEdge", "REG", "LWIR") come down to one vocabulary
    (:data:`SUB_CAMERAS`). A word outside it stays apart, lower-cased and joined by hyphens, so that two
    cameras never fall together because neither was understood: "Blue-444" is not "Blue".

    Returns:
        None when the text holds no letter or digit.
    """
    text = text[:_LONGEST_TEXT]
    parts = text.split(",")
    if len(parts) > 1 and {"red", "green", "blue"} <= {normalise_sub_camera(part) for part in parts}:
        return "rgb"
    lowered = text.lower()
    squeezed = "".join(c for c in lowered if c.isalnum())
    word = _WORDS.get(squeezed) or _WORDS.get(squeezed.removesuffix("camera"))
    if word is not None:
        return word
    spaced = "".join(c if c.isalnum() else " " for c in lowered)
    return "-".join(spaced.split())[:_LONGEST_WORD].strip("-") or None


class Projection(StrEnum):
    """How the lens maps the world; only a perspective camera has a pinhole K."""

    PERSPECTIVE = "perspective"
    FISHEYE = "fisheye"


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownCamera:
    """One camera of the catalogue: a body, sub-camera and lens at its native frame.

    Attributes:
        make, models: as EXIF writes them; ``models`` holds every spelling that was seen.
        other_makes: what EXIF Make says besides ``make``.
        title: what people call it.
        sub_camera: "wide", "tele", "thermal", … where one Model has several; None where the Model is one
            camera, or several that are alike.
        bands: the bands of a multispectral head that this entry describes alike.
        lens: the lens, where it comes off.
        native_size: (width, height) px of the full frame.
        pitch_um: pixel pitch at the native size, None where no source gives one.
        sensor_width_mm: where a source gives the width but none the frame, so that no pitch follows.
        focal_mm: nominal focal length; of a zoom lens, the one that ``fx_over_w`` is of.
        zoom_mm: (shortest, longest) focal length of a zoom lens.
        focal_35mm: FocalLengthIn35mmFilm as this camera writes it.
        projection: perspective or fisheye; of a fisheye, ``fx_over_w`` holds on the axis only.
        fx_over_w: expected fx / W at the native size, None where unknown.
        spread: relative half-width within which units and sources of this camera lie.
        conflicts: what the sources disagree about, in words.
        notes: what else to know.
        sources: where each number is from, by field name.
        exif_focal_trusted: False where this camera is known to write a wrong EXIF FocalLength.
    """

    make: str
    models: tuple[str, ...]
    other_makes: tuple[str, ...] = ()
    title: str
    sub_camera: str | None = None
    bands: tuple[str, ...] = ()
    lens: str | None = None
    native_size: ImageSize | None = None
    pitch_um: float | None = None
    sensor_width_mm: float | None = None
    focal_mm: float | None = None
    zoom_mm: tuple[float, float] | None = None
    focal_35mm: float | None = None
    projection: Projection = Projection.PERSPECTIVE
    fx_over_w: float | None = None
    spread: float | None = None
    conflicts: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    sources: tuple[tuple[str, str], ...] = ()
    exif_focal_trusted: bool = True

    def source(self, field: str) -> str | None:
        """Where one number is from, by its field's name."""
        return next((text for name, text in self.sources if name == field), None)

    def fx_over_w_at(self, focal_mm: float | None) -> float | None:
        """Expected fx / W of the full frame at a focal length; a zoom lens moves it, other lenses do not.

        Args:
            focal_mm: as EXIF tells it, None when it does not.

        Returns:
            None where nothing is expected: no source, or a zoom lens at an unknown or impossible setting.
        """
        if self.fx_over_w is None or self.zoom_mm is None or self.focal_mm is None:
            return self.fx_over_w
        shortest, longest = self.zoom_mm
        if focal_mm is None or not shortest * 0.95 <= focal_mm <= longest * 1.05:
            return None
        return self.fx_over_w * focal_mm / self.focal_mm

    def answers(self, sub_camera: str) -> bool:
        """Whether a tag in the common vocabulary names this very camera."""
        return sub_camera == self.sub_camera or sub_camera in self.bands

    def may_answer(self, sub_camera: str) -> bool:
        """Whether a tag in the common vocabulary leaves room for this camera.

        "rgb" says visible, not which; and a Model that is one camera is it whatever its visible camera is
        called. Thermal cameras and bands are never anything else.
        """
        if self.answers(sub_camera):
            return True
        if self.sub_camera is None:
            return sub_camera in VISIBLE
        return {sub_camera, self.sub_camera} <= VISIBLE and "rgb" in {sub_camera, self.sub_camera}
