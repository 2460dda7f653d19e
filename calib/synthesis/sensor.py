"""From light to pixels: blur and vignetting of the lens; noise, gamma and quantisation of the sensor; JPEG."""

from __future__ import annotations

import io
import math
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calibrary.calib.synthesis.settings import Settings

__all__ = ["expose", "jpeg_round_trip"]

Light: TypeAlias = NDArray[np.float32]
Pixels: TypeAlias = NDArray[np.uint8] | NDArray[np.uint16]


def expose(light: Light, settings: Settings, random: np.random.Generator) -> Pixels:
    """Return the pixels of the sensor before compression.

    Args:
        light: (H, W), 1 at saturation.
        settings: settings of lens and sensor.
        random: random generator of the noise.

    Returns:
        (H, W) uint8 or uint16.
    """
    image = _blurred(light, settings)
    if settings.vignetting:
        height, width = image.shape
        x = (np.arange(width, dtype=np.float32) + 0.5) / width * 2 - 1
        y = (np.arange(height, dtype=np.float32) + 0.5) / height * 2 - 1
        aspect = np.hypot(width, height)
        loss = (x * (width / aspect)) ** 2 + ((y * (height / aspect)) ** 2)[:, None]
        image *= 1 - np.float32(settings.vignetting) * loss
    np.clip(image, 0, 1, out=image)
    noise = (
        random.standard_normal(image.shape, dtype=np.float32)
        if settings.noise or settings.shot_noise
        else None
    )
    if noise is not None:
        noise *= _noise_levels(image, settings) / np.float32(255)
    np.power(image, np.float32(1 / settings.gamma), out=image)
    if noise is not None:
        image += noise
    np.clip(image, 0, 1, out=image)
    image *= np.float32(255 if settings.bits == 8 else 65535)
    np.rint(image, out=image)
    return image.astype(np.uint8) if settings.bits == 8 else image.astype(np.uint16)


def _noise_levels(image: Light, settings: Settings) -> Light | np.float32:
    """Return the standard deviation at each pixel, in 8-bit gray levels after gamma."""
    if not settings.shot_noise:
        return np.float32(settings.noise)
    # d(L^(1/γ)) = L^(1/γ − 1) dL / γ, and dL is proportional to √L.
    bright = np.maximum(image, np.float32(0.01)) ** np.float32(2 / settings.gamma - 1)
    return np.asarray(np.sqrt(np.float32(settings.noise**2) + np.float32(settings.shot_noise**2) * bright))


def _blurred(light: Light, settings: Settings) -> Light:
    import cv2

    # A copy, since the caller continues in place.
    image = np.array(light)
    if settings.blur_px > 0:
        half = max(1, math.ceil(4 * settings.blur_px))
        kernel = np.exp(-0.5 * (np.arange(-half, half + 1) / settings.blur_px) ** 2)
        kernel /= kernel.sum()
        cv2.sepFilter2D(image, cv2.CV_32F, kernel, kernel, dst=image, borderType=cv2.BORDER_REFLECT)
    if any(settings.motion_px):
        cv2.filter2D(image, cv2.CV_32F, _way(settings.motion_px), dst=image, borderType=cv2.BORDER_REFLECT)
    return image


def _way(motion_px: tuple[float, float]) -> Light:
    """Return the kernel of a uniform motion along ``motion_px``, centred, distributed over adjacent pixels."""
    dx, dy = motion_px
    half = math.ceil(max(abs(dx), abs(dy)) / 2) + 1
    steps = 8 * max(1, math.ceil(math.hypot(dx, dy)))
    along = (np.arange(steps) + 0.5) / steps - 0.5
    grid = np.arange(-half, half + 1)
    across = np.maximum(0, 1 - np.abs(grid[:, None] - along * dx))
    down = np.maximum(0, 1 - np.abs(grid[:, None] - along * dy))
    # filter2D correlates instead of convolving; the kernel is symmetric.
    return np.asarray(down @ across.T / steps, dtype=np.float32)


def jpeg_round_trip(pixels: NDArray[np.uint8], quality: int) -> NDArray[np.uint8]:
    """Compress pixels as a JPEG of this quality and decode them again."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "JPEG", quality=quality)
    return np.asarray(Image.open(stream))
