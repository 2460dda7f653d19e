"""What a synthetic frame is taken with, apart from the camera itself."""

from __future__ import annotations

import math

from msgspec import Struct, field

from calibrary.calib.synthesis.sheet import Sheet, Shutter
from calibrary.errors import InputError

__all__ = ["Settings"]


class Settings(Struct, frozen=True, kw_only=True):
    """Light, lens, sensor and file; the defaults are a good camera in good light.

    Attributes:
        sheet: the board as it really is.
        shutter: of the camera.
        blur_px: standard deviation of the point spread function.
        motion_px: (x, y) the way every point moves while the shutter is open; the truth is its middle.
        tones: light from black and from white print, 0 … 1 where the sensor saturates.
        vignetting: share of the light lost in the frame's corner.
        gamma: the file's value is light^(1/gamma).
        noise: standard deviation of the read noise, in grey levels of 8 bits as they stand in the file.
        shot_noise: standard deviation of the photon noise where the sensor saturates, in the same levels; it
            grows with the root of the light, which a gamma of 2.2 turns into nearly the same number anywhere.
        glare: light that a lamp's mirror image adds in its middle, somewhere on the board.
        texture: contrast of what stands behind the board.
        bits: 8 or 16 a pixel.
        quality: of the JPEG that the frame went through; None for none, as for 16 bits.

    Raises:
        InputError: a number makes no sense.
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
