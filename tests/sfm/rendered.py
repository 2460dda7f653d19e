"""Flights rendered: every pixel's ray cast onto a textured height field, by a camera that is known exactly."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calibration import Calibration
from calibrary.records import replace
from calibrary.synthetic import Head, Position, description, packet, write_image
from tests.sfm.flights import (
    DEGREES_PER_M,
    HEIGHT_M,
    LATITUDE,
    LONGITUDE,
    Plan,
    antenna,
    courses,
    poses,
    rippled,
)

CELL_M = 0.12
"""Of the texture; of the heights it is a metre."""
HALF_M = 160.0
STEPS = 9
"""From the flying height down to the ground: each leaves at most a quarter of the error, far off the vertical."""
RTK_M = 0.1


class Country:
    """A textured height field, east and north within HALF_M of its middle.

    Attributes:
        heights: (N, N) m, by cells of a metre.
        texture: (M, M) 0 … 255, by cells of CELL_M.
    """

    def __init__(self, relief_m: float, seed: int) -> None:
        random = np.random.default_rng((seed, 7))
        size = round(2 * HALF_M / CELL_M)
        texture = np.full((size, size), 120.0, dtype=np.float64)
        # Noise of every size, as ground has it, and fields with edges between them.
        for octave in range(7):
            coarse = random.normal(0, 1, (size >> octave >> 1,) * 2)
            texture += cv2.resize(coarse, (size, size)) * (0.92 ** (6 - octave)) * 26
        fields = random.normal(0, 25, (14, 14))
        texture += cv2.resize(fields, (size, size), interpolation=cv2.INTER_NEAREST)
        self.texture = np.clip(texture, 0, 255)
        waves = random.uniform(0.015, 0.06, (10, 2)) * random.choice((-1, 1), (10, 2))
        phase = random.uniform(0, 2 * math.pi, 10)
        middles = np.arange(0.5, 2 * HALF_M) - HALF_M
        east, north = np.meshgrid(middles, middles)
        found = np.sin(east[..., None] * waves[:, 0] + north[..., None] * waves[:, 1] + phase).sum(axis=-1)
        self.heights = found / math.sqrt(5) * relief_m

    def height(self, east: FloatArray, north: FloatArray) -> FloatArray:
        """M."""
        return _bilinear(self.heights, (east + HALF_M), (north + HALF_M))

    def colour(self, east: FloatArray, north: FloatArray) -> FloatArray:
        """0 … 255."""
        return _bilinear(self.texture, (east + HALF_M) / CELL_M, (north + HALF_M) / CELL_M)


def _bilinear(grid: FloatArray, x: FloatArray, y: FloatArray) -> FloatArray:
    """Values between the cells' middles, which are at halves."""
    columns, rows = (x - 0.5).astype(np.float32), (y - 0.5).astype(np.float32)
    return np.asarray(cv2.remap(grid, columns, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


def render_flight(
    folder: Path,
    plan: Plan,
    camera: Calibration,
    seed: int,
    *,
    noise: float = 2.0,
    blur_px: float = 0.6,
    quality: int = 92,
    enlarged: int = 1,
    edited: int = 0,
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
        enlarged: by how much images are made larger than they are rendered, where only their size matters.
        edited: so many, evenly spread, were cut to their middle nine tenths and enlarged again by a viewer.
    """
    random = np.random.default_rng((seed, 9))
    country = Country(plan.relief * HEIGHT_M, seed)
    width, height = camera.intrinsics.image_size
    # A pixel shows at most a cell or two of the texture: one ray through its middle does.
    x, y = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    pixels = np.column_stack([x.ravel(), y.ravel()])
    ideal = pixels
    for _ in range(5 if plan.ripple_px else 0):
        ideal = pixels + ideal - rippled(camera, ideal, plan.ripple_px)
    rays = camera.unproject(ideal)
    moments = plan.readout_s * (y / height - 0.5)
    taken = camera.scaled((width * enlarged, height * enlarged))
    paths = []
    turns, centres = poses(plan, seed)
    course = courses(plan)
    places = antenna(plan, centres, course)
    for number, (turn, centre) in enumerate(zip(turns, centres, strict=True)):
        directions = (rays @ turn).reshape(height, width, 3)
        across = directions[..., :2] / np.minimum(directions[..., 2:], -0.05)
        start = centre[:2] + plan.speed * moments[..., None] * course[number, 0, :2]
        ground = np.zeros((height, width))
        for _ in range(STEPS):
            east, north = np.moveaxis(start + across * (ground - centre[2])[..., None], -1, 0)
            ground = country.height(east, north)
        seen = cv2.GaussianBlur(country.colour(east, north), (0, 0), blur_px)
        if enlarged > 1:
            seen = cv2.resize(seen, taken.intrinsics.image_size)
        is_edited = number in np.linspace(1, len(centres) - 2, edited).astype(int)
        if is_edited:
            cut = seen[height // 20 : height - height // 20, width // 20 : width - width // 20]
            seen = cv2.resize(cut, (width, height))
        grey = seen + random.normal(0, noise, seen.shape)
        image = np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[..., None], 3, axis=2)
        head = head_of(taken, plan, places[number], number, random)
        if is_edited:
            head = replace(head, exif={**head.exif, "Software": "Microsoft Windows Photo Viewer 10.0"})
        paths.append(write_image(folder / f"IMG_{number:04}.JPG", image, head, quality=quality))
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
            latitude_deg=LATITUDE + north * DEGREES_PER_M[1],
            longitude_deg=LONGITUDE + east * DEGREES_PER_M[0],
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
