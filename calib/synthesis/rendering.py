"""Rendering of board images by a known camera: light of board and backdrop, then lens, sensor and JPEG."""

from __future__ import annotations

import io
import math
from collections.abc import Iterator
from functools import lru_cache
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from calibrary.arrays import FloatArray
from calibrary.calib.artwork import Artwork, Box, artwork, paper, paper_rim
from calibrary.calib.board import Board
from calibrary.calib.synthesis.settings import Settings
from calibrary.calib.synthesis.sheet import Pose, Sheet, Shutter, seen_points
from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize, Intrinsics, Provenance
from calibrary.distortion import Distortion

Pixels: TypeAlias = NDArray[np.uint8] | NDArray[np.uint16]
Light: TypeAlias = NDArray[np.float32]


def render(board: Board, calibration: Calibration, pose: Pose, settings: Settings, seed: int) -> Pixels:
    """Render an image as a reader of the file sees it.

    Args:
        board: the board.
        calibration: the true camera; any distortion model.
        pose: pose of the board.
        settings: light, lens, sensor and file.
        seed: seed of backdrop, glare and noise; the same arguments give the same image.

    Returns:
        (H, W) uint8 or uint16, gray. Its corners are those of :func:`seen_corners`.
    """
    pixels = render_raw(board, calibration, pose, settings, seed)
    if settings.quality is None or pixels.dtype != np.uint8:
        return pixels
    return jpeg_round_trip(pixels.astype(np.uint8, copy=False), settings.quality)


def render_raw(board: Board, calibration: Calibration, pose: Pose, settings: Settings, seed: int) -> Pixels:
    """Render the image before compression."""
    frame = light(board, calibration, pose, settings, seed)
    return expose(frame, settings, np.random.default_rng([seed, 2]))


Window: TypeAlias = tuple[slice, slice]

STRIP_PIXELS = 1 << 18
"""Pixels processed at a time, so that the intermediate arrays stay in the processor's cache."""
SAMPLES = 4
"""Number of sampling boxes along each side of a pixel that an edge crosses."""
REACH = 2.0
"""A pixel has a uniform tone if this distance around it, in pixel widths, does."""


class _Plane(Struct, frozen=True, kw_only=True):
    """The printed sheet in one pose; maps directions to mm on the sheet."""

    board: Board
    pose: Pose
    sheet: Sheet

    def hit(self, rays: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the intersections of directions, (…, 3) in the camera frame, with the sheet, in nominal mm."""
        rotation = self.pose.matrix
        ox, oy, oz = -rotation.T @ np.array(self.pose.translation_mm)
        dx, dy, dz = np.moveaxis(rays @ rotation, -1, 0)
        with np.errstate(all="ignore"):
            reach = self._reach((ox, oy, oz), (dx, dy, dz))
            reach[~(reach > 0)] = np.nan
            sx, sy = self.sheet.stretch
            return (ox + reach * dx) / sx, (oy + reach * dy) / sy

    def _reach(
        self, origin: tuple[float, float, float], ray: tuple[FloatArray, FloatArray, FloatArray]
    ) -> FloatArray:
        """Return the distance along each direction: the root of a quadratic, which includes the case of a plane."""
        (ox, oy, oz), (dx, dy, dz) = origin, ray
        a, b = self.sheet.warp_mm
        if a == b == 0:
            return np.asarray(-oz / dz)
        (u0, du), (v0, dv) = self.sheet.unit_axes(self.board)
        pu, qu, pv, qv = (ox - u0) / du, dx / du, (oy - v0) / dv, dy / dv
        square = a * qu**2 + b * qv**2
        linear = 2 * (a * pu * qu + b * pv * qv) + dz
        constant = a * pu**2 + b * pv**2 + oz - a - b
        root = np.sqrt(linear**2 - 4 * square * constant)
        return np.asarray(-2 * constant / (linear + np.copysign(root, linear)))


def light(board: Board, calibration: Calibration, pose: Pose, settings: Settings, seed: int) -> Light:
    """Return the light in the image before lens blur.

    Args:
        board: the board.
        calibration: the true camera.
        pose: pose of the board.
        settings: tones, texture, glare, sheet and shutter are used.
        seed: seed of backdrop and glare.

    Returns:
        (H, W), 1 at saturation.
    """
    size = calibration.intrinsics.image_size
    plane = _Plane(board=board, pose=pose, sheet=settings.sheet)
    outline = _outline(plane, calibration, settings.shutter)
    frame = backdrop(size, settings, np.random.default_rng([seed, 0]))
    glare = lamp(size, outline, settings.glare, np.random.default_rng([seed, 1]))
    art, sheet_box = artwork(board), paper(board)
    for window in _strips(_window(outline, size)):
        x, y = plane.hit(_rays(calibration, settings.shutter, window))
        mirrored = glare[window] if glare is not None else None
        frame[window] = _shade(art, sheet_box, (x, y), settings.tones, (frame[window], mirrored))
    unseen = _unseen(calibration.intrinsics, calibration.distortion)
    if unseen is not None:
        frame[unseen] = 0
    return frame


def _outline(plane: _Plane, calibration: Calibration, shutter: Shutter) -> FloatArray:
    rim = paper_rim(plane.board) * (*plane.sheet.stretch, 1.0)
    rim[:, 2] = plane.sheet.height(plane.board, rim[:, 0], rim[:, 1])
    return seen_points(plane.pose.camera_points(rim), calibration, shutter)


def _window(outline: FloatArray, size: ImageSize) -> tuple[int, int, int, int]:
    """Return (left, top, right, bottom) of the pixels that may show the sheet; all pixels if its outline is unknown."""
    width, height = size
    if not np.isfinite(outline).all():
        return 0, 0, width, height
    # Between two points of the outline, the edge may be slightly further out.
    margin = 8 + 0.01 * max(size)
    left, top = np.clip(np.floor(outline.min(axis=0) - margin), 0, size)
    right, bottom = np.clip(np.ceil(outline.max(axis=0) + margin), 0, size)
    return int(left), int(top), int(right), int(bottom)


def _strips(box: tuple[int, int, int, int]) -> Iterator[Window]:
    left, top, right, bottom = box
    if right <= left or bottom <= top:
        return
    strips = -(-(bottom - top) * (right - left) // STRIP_PIXELS)
    # Strips of similar height, since a strip of a single row has no vertical gradient.
    edges = np.linspace(top, bottom, min(strips, (bottom - top + 1) // 2) + 1).astype(int)
    for start, stop in pairwise(edges.tolist()):
        yield slice(start, stop), slice(left, right)


@lru_cache(maxsize=1)
def _camera_rays(intrinsics: Intrinsics, distortion: Distortion | None) -> NDArray[np.float32]:
    """Return unit directions of the pixel centres, (H, W, 3); float32 has an error of 2·10⁻⁴ px at 20 megapixels."""
    camera = Calibration(
        camera=CameraKey(),
        intrinsics=intrinsics,
        distortion=distortion,
        grade=Grade.CALIBRATED,
        provenance=Provenance(kind="synthesis"),
    )
    width, height = intrinsics.image_size
    rays = np.empty((height, width, 3), dtype=np.float32)
    columns = np.arange(width) + 0.5
    for window in _strips((0, 0, width, height)):
        rows = np.arange(window[0].start, window[0].stop) + 0.5
        pixels = np.column_stack([np.tile(columns, len(rows)), np.repeat(rows, width)])
        rays[window] = camera.unproject(pixels).reshape(len(rows), width, 3)
    return rays


@lru_cache(maxsize=1)
def _unseen(intrinsics: Intrinsics, distortion: Distortion | None) -> NDArray[np.bool_] | None:
    """Return the pixels without a direction, (H, W), as around a fisheye's circle; None if there are none."""
    unseen = np.isnan(_camera_rays(intrinsics, distortion)[..., 0])
    return unseen if unseen.any() else None


def _rays(calibration: Calibration, shutter: Shutter, window: Window) -> FloatArray:
    """Return the directions of a window's pixels in the camera frame of the middle row."""
    rays = _camera_rays(calibration.intrinsics, calibration.distortion)[window].astype(np.float64)
    if shutter.is_rolling:
        rows = np.arange(window[0].start, window[0].stop, dtype=np.float64) + 0.5
        turns = shutter.turns(rows, calibration.intrinsics.image_size[1])
        rays = rays @ turns.transpose(0, 2, 1)
    return rays


def _shade(
    art: Artwork,
    sheet_box: Box,
    at: tuple[FloatArray, FloatArray],
    tones: tuple[float, float],
    around: tuple[Light, Light | None],
) -> Light:
    """Return the light of each pixel of a window, with centres at ``at`` on the sheet.

    ``around`` is the light from behind the sheet, and the light that the sheet reflects.
    """
    behind, mirrored = around
    x, y = at
    (xr, xc), (yr, yc) = _slopes(x), _slopes(y)
    width, height = np.hypot(xr, xc), np.hypot(yr, yc)
    visible = np.isfinite(width) & np.isfinite(height)
    on_sheet = visible & (x > sheet_box[0] - width) & (x < sheet_box[2] + width)
    on_sheet &= (y > sheet_box[1] - height) & (y < sheet_box[3] + height)
    shaded = behind.copy()
    index = np.flatnonzero(on_sheet)
    if not len(index):
        return shaded
    x, y, width, height, xr, xc, yr, yc = (
        values.ravel()[index] for values in (x, y, width, height, xr, xc, yr, yc)
    )
    dark = art.tone(x, y, REACH * width, REACH * height)
    sheet = _inside(sheet_box, x, y, REACH * width, REACH * height)
    mixed = np.flatnonzero(np.isnan(dark) | (sheet < 1 - 1e-9))
    if len(mixed):
        dark[mixed], sheet[mixed] = _integrate(
            art, sheet_box, *(values[mixed] for values in (x, y, xr, xc, yr, yc))
        )
    black, white = tones
    flat = shaded.ravel()
    reflected = white + (black - white) * dark
    if mirrored is not None:
        reflected += mirrored.ravel()[index]
    flat[index] = sheet * reflected + (1 - sheet) * flat[index]
    return shaded


def _slopes(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the gradients in mm per pixel, along rows and along columns."""
    with np.errstate(invalid="ignore"):
        down = np.gradient(values, axis=0) if values.shape[0] > 1 else np.full_like(values, np.nan)
        along = np.gradient(values, axis=1) if values.shape[1] > 1 else np.full_like(values, np.nan)
    return down, along


def _integrate(
    art: Artwork,
    sheet_box: Box,
    x: FloatArray,
    y: FloatArray,
    xr: FloatArray,
    xc: FloatArray,
    yr: FloatArray,
    yc: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the mean darkness and the share of paper of pixels that are not uniform."""
    width, height = np.hypot(xr, xc) / SAMPLES, np.hypot(yr, yc) / SAMPLES
    dark, sheet = np.zeros_like(x), np.zeros_like(x)
    offsets = (np.arange(SAMPLES) + 0.5) / SAMPLES - 0.5
    for row in offsets:
        for column in offsets:
            sx, sy = x + row * xr + column * xc, y + row * yr + column * yc
            dark += art.darkness(sx, sy, width, height)
            sheet += _inside(sheet_box, sx, sy, width, height)
    return dark / SAMPLES**2, sheet / SAMPLES**2


def _inside(box: Box, x: FloatArray, y: FloatArray, width: FloatArray, height: FloatArray) -> FloatArray:
    """Return the share of each axis-parallel box that is inside one large box."""
    left, top, right, bottom = box
    across = np.minimum(x + width / 2, right) - np.maximum(x - width / 2, left)
    down = np.minimum(y + height / 2, bottom) - np.maximum(y - height / 2, top)
    return np.asarray(np.clip(across / width, 0, 1) * np.clip(down / height, 0, 1))


OCTAVES = (6, 17, 61, 211)
"""Number of blobs across the image, per layer of the backdrop."""
LAMP_SIZE = 0.12
"""Standard deviation of a lamp's reflection, as a share of the board's width in the image."""


def backdrop(size: ImageSize, settings: Settings, random: np.random.Generator) -> Light:
    """Return the light from behind the board, (H, W): blobs of several sizes, like a room out of focus."""
    import cv2

    width, height = size
    picture = np.full((height, width), 0.25, dtype=np.float32)
    for number, blobs in enumerate(OCTAVES):
        rows = max(2, round(blobs * height / width))
        layer = random.random((rows, blobs), dtype=np.float32) - np.float32(0.5)
        strength = np.float32(settings.texture * 0.6 / (number + 1))
        if settings.texture:
            picture += strength * cv2.resize(layer, size, interpolation=cv2.INTER_CUBIC)
    return np.asarray(np.maximum(picture, np.float32(0.01)), dtype=np.float32)


def lamp(
    size: ImageSize, outline: NDArray[np.float64], strength: float, random: np.random.Generator
) -> Light | None:
    """Return the light, (H, W), of a lamp's reflection on the board with the given outline, (M, 2) px."""
    shift = random.uniform(-0.25, 0.25, 2)
    if not strength or not np.isfinite(outline).all():
        return None
    low, high = outline.min(axis=0), outline.max(axis=0)
    centre = (low + high) / 2 + shift * (high - low)
    radius = LAMP_SIZE * (high - low)[0]
    x = np.exp(-0.5 * ((np.arange(size[0]) + 0.5 - centre[0]) / radius) ** 2)
    y = np.exp(-0.5 * ((np.arange(size[1]) + 0.5 - centre[1]) / radius) ** 2)
    return np.asarray(strength * y[:, None] * x, dtype=np.float32)


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
