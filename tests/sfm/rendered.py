"""Flights rendered: every pixel's ray cast onto a textured height field, by a camera that is known exactly."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calibration import Calibration
from calibrary.synthetic import Head, Position, description, packet, write_image
from tests.sfm.flights import HEIGHT_M, Plan, poses

CELL_M = 0.12
HALF_M = 150.0
STEPS = 4
RTK_M = 0.1
LATITUDE, LONGITUDE = 47.31642, 8.51234
METRES_PER_DEGREE = 111_320.0


class Country:
    """A textured height field.

    Attributes:
        heights: (N, N) m, on a coarse grid.
        texture: (M, M) 0 … 255.
    """

    def __init__(self, relief_m: float, seed: int) -> None:
        random = np.random.default_rng((seed, 7))
        self.relief_m = relief_m
        size = round(2 * HALF_M / CELL_M)
        texture = np.zeros((size, size))
        # Noise of every size, as ground has it, and fields with edges between them.
        for octave in range(7):
            cells = max(4, size >> octave >> 1)
            coarse = random.normal(0, 1, (cells + 2, cells + 2))
            at = np.linspace(0, cells, size, endpoint=False)
            texture += _bilinear(coarse, at[:, None], at[None, :]) * (0.92 ** (6 - octave)) * 26
        fields = random.normal(0, 25, (14, 14))
        at = (np.arange(size) * 14 // size).astype(int)
        self.texture = np.clip(texture + fields[at][:, at] + 120, 0, 255)
        self.waves = random.uniform(0.015, 0.06, (10, 2)) * random.choice((-1, 1), (10, 2))
        self.phase = random.uniform(0, 2 * math.pi, 10)

    def height(self, east: FloatArray, north: FloatArray) -> FloatArray:
        """M."""
        if not self.relief_m:
            return np.zeros_like(east)
        found = sum(
            np.sin(a * east + b * north + phase)
            for (a, b), phase in zip(self.waves.tolist(), self.phase.tolist(), strict=True)
        )
        return np.asarray(found / math.sqrt(5) * self.relief_m)

    def colour(self, east: FloatArray, north: FloatArray) -> FloatArray:
        """0 … 255."""
        return _bilinear(self.texture, (north + HALF_M) / CELL_M, (east + HALF_M) / CELL_M)


def _on_ground(
    centre: FloatArray, directions: FloatArray, reach: FloatArray
) -> tuple[FloatArray, FloatArray]:
    return centre[0] + reach * directions[:, 0], centre[1] + reach * directions[:, 1]


def _bilinear(grid: FloatArray, rows: FloatArray, columns: FloatArray) -> FloatArray:
    rows, columns = np.clip(rows, 0, grid.shape[0] - 1.001), np.clip(columns, 0, grid.shape[1] - 1.001)
    r, c = rows.astype(np.intp), columns.astype(np.intp)
    y, x = rows - r, columns - c
    top = grid[r, c] * (1 - x) + grid[r, c + 1] * x
    return np.asarray(top * (1 - y) + (grid[r + 1, c] * (1 - x) + grid[r + 1, c + 1] * x) * y)


def render_flight(
    folder: Path,
    plan: Plan,
    camera: Calibration,
    seed: int,
    *,
    noise: float = 2.0,
    blur_px: float = 0.6,
    quality: int = 92,
) -> list[Path]:
    """Write the flight's images with what a camera states in them.

    Args:
        folder: it is made.
        plan: how it is flown; noise and outliers are the matcher's own.
        camera: which takes the images.
        seed: of the country and of the flight.
        noise: standard deviation of a pixel, of 255.
        blur_px: standard deviation.
        quality: of the JPEG.
    """
    random = np.random.default_rng((seed, 9))
    country = Country(plan.relief * HEIGHT_M, seed)
    width, height = camera.intrinsics.image_size
    # A pixel shows at most a cell or two of the texture: one ray through its middle does.
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    rays = camera.unproject(np.column_stack([x.ravel(), y.ravel()]))
    paths = []
    for number, (turn, centre) in enumerate(zip(*poses(plan, seed), strict=True)):
        directions = rays @ turn
        down = np.minimum(directions[:, 2], -0.05)
        reach = -centre[2] / down
        for _ in range(STEPS):
            ground = country.height(*_on_ground(centre, directions, reach))
            reach = (ground - centre[2]) / down
        seen = country.colour(*_on_ground(centre, directions, reach))
        grey = _blurred(seen.reshape(height, width), blur_px) + random.normal(0, noise, (height, width))
        pixels = np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[..., None], 3, axis=2)
        paths.append(
            write_image(
                folder / f"IMG_{number:04}.JPG",
                pixels,
                head_of(camera, plan, centre, number, random),
                quality=quality,
            )
        )
    return paths


def head_of(
    camera: Calibration, plan: Plan, centre: FloatArray, number: int, random: np.random.Generator
) -> Head:
    """What the camera states in an image: an RTK receiver its standard deviations too."""
    position, xmp = None, None
    if plan.gps_m is not None:
        across, up = plan.gps_m
        if across < RTK_M:
            said = {"RtkStdLon": f"{across:.5f}", "RtkStdLat": f"{across:.5f}", "RtkStdHgt": f"{up:.5f}"}
            xmp = packet(
                [description(about="", attributes={f"drone-dji:{name}": text for name, text in said.items()})]
            )
        east, north, above = centre + random.normal(0, 1, 3) * (across, across, up)
        position = Position(
            latitude_deg=LATITUDE + north / METRES_PER_DEGREE,
            longitude_deg=LONGITUDE + east / (METRES_PER_DEGREE * math.cos(math.radians(LATITUDE))),
            altitude_m=450.0 + above,
        )
    width, height = camera.intrinsics.image_size
    return Head(
        exif={
            "Make": camera.camera.make or "Example",
            "Model": camera.camera.model or "Flight One",
            "DateTimeOriginal": f"2024:05:17 09:{30 + number // 60:02}:{number % 60:02}",
            "FocalLength": (88, 10),
            "ExifImageWidth": width,
            "ExifImageHeight": height,
        },
        position=position,
        xmp=xmp,
    )


def _blurred(image: FloatArray, sigma: float) -> FloatArray:
    reach = math.ceil(3 * sigma)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) / max(sigma, 1e-6)) ** 2)
    kernel /= kernel.sum()
    for axis in (0, 1):
        image = sum(
            (
                share * np.roll(image, step, axis=axis)
                for step, share in zip(range(-reach, reach + 1), kernel, strict=True)
            ),
            np.zeros_like(image),
        )
    return image
