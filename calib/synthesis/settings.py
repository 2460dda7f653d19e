"""Settings of a synthetic image, apart from the camera."""

from __future__ import annotations

import math

from msgspec import Struct, field

from calibrary.calib.synthesis.sheet import Sheet, Shutter
from calibrary.errors import InputError


class Settings(Struct, frozen=True, kw_only=True):
    """Light, lens, sensor and file; the defaults describe a good camera in good light.

    Attributes:
        sheet: real shape of the board.
        shutter: shutter of the camera.
        blur_px: standard deviation of the point spread function, px.
        motion_px: (x, y) motion of every point during the exposure, px; the true position is its middle.
        tones: light from black and from white print, 0 … 1 at saturation.
        vignetting: share of the light lost in the image corner.
        gamma: the file's value is light^(1/gamma).
        noise: standard deviation of the read noise, in 8-bit gray levels of the file.
        shot_noise: standard deviation of the photon noise at saturation, in the same levels; it is proportional to the
            square root of the light, so with a gamma of 2.2 it is nearly constant.
        glare: light that a lamp's reflection adds at its centre, somewhere on the board.
        texture: contrast of the backdrop.
        bits: 8 or 16 per pixel.
        quality: JPEG quality; None for no compression, as with 16 bits.

    Raises:
        InputError: a value is not valid.
    """

    sheet: Sheet = field(default_factory=Sheet)
    shutter: Shutter = field(default_factory=Shutter)
    blur_px: float = 0.8
    motion_px: tuple[float, float] = (0.0, 0.0)
    tones: tuple[float, float] = (0.05, 0.75)
    vignetting: float = 0.35
    gamma: float = 2.2
    noise: float = 2.0
    shot_noise: float = 0.0
    glare: float = 0.0
    texture: float = 0.5
    bits: int = 8
    quality: int | None = 92

    def __post_init__(self) -> None:
        for name, (low, high) in _LIMITS.items():
            value = getattr(self, name)
            numbers = value if isinstance(value, tuple) else (value,)
            if not all(math.isfinite(number) and low <= number <= high for number in numbers):
                raise InputError(f"is {value}, expected {low:g} … {high:g}", place=name)
        if self.bits not in {8, 16}:
            raise InputError(f"is {self.bits}, expected 8 or 16", place="bits")
        if self.quality is not None and (self.bits != 8 or not 1 <= self.quality <= 95):
            raise InputError(f"is {self.quality}, expected 1 … 95, and 8 bits", place="quality")


_LIMITS = {
    "blur_px": (0.0, 100.0),
    "motion_px": (-200.0, 200.0),
    "tones": (0.0, 1.0),
    "vignetting": (0.0, 1.0),
    "gamma": (0.1, 10.0),
    "noise": (0.0, 255.0),
    "shot_noise": (0.0, 255.0),
    "glare": (0.0, 1000.0),
    "texture": (0.0, 1.0),
}
