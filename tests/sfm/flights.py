"""Simulated flights: what the images of a known camera would show, as tracks, with nothing rendered."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.lens_models import Solvable
from calibrary.calib.result import CalibrationResult, Flown
from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize, Intrinsics, Provenance
from calibrary.distortion import BrownConrady, KannalaBrandt
from calibrary.records import replace
from calibrary.rotations import rotation_matrix
from calibrary.sfm.tracks import Positions, Scene, Tracks

SIZE: ImageSize = (1500, 1000)
HEIGHT_M = 80.0
LATITUDE, LONGITUDE = 47.31642, 8.51234
DEGREES_PER_M = (1 / 75_612.1, 1 / 111_186.3)
"""East and north, there, 530 m above the WGS 84 ellipsoid."""
DOWN = np.diag([1.0, -1.0, -1.0])
"""World to camera of an image that looks straight down, its top to the north."""
CAMERA = Calibration(
    camera=CameraKey(make="Example", model="Flight One", image_size=SIZE),
    intrinsics=Intrinsics(fx=1123.0, fy=1123.8, cx=741.0, cy=507.0, image_size=SIZE),
    distortion=BrownConrady(k1=-0.08, k2=0.05, p1=3e-4, p2=-2e-4, k3=-0.012),
    grade=Grade.CALIBRATED,
    provenance=Provenance(kind="calibration-file"),
)
FISHEYE = replace(
    CAMERA,
    intrinsics=replace(CAMERA.intrinsics, fx=820.0, fy=820.4),
    distortion=KannalaBrandt(k1=-0.02, k2=0.004, k3=-0.002, k4=3e-4),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """How a flight is flown and what is wrong with what it shows.

    Attributes:
        relief: standard deviation of the ground's height, as a share of the flying height.
        heights: of its passes, in flying heights; each pass is flown once.
        cross: whether every other pass is flown across.
        oblique_deg: off the vertical, of every other pass.
        rows, columns: images of a pass.
        attitude_deg: standard deviation of roll and pitch.
        noise_px: of a coordinate.
        outliers: share of the observations.
        gps_m: standard deviation of the positions across and up; None for none.
        points: on the ground.
        late_s: from an exposure to its stated position, at ``speed``.
        lever_m: from the camera to the antenna, ahead and to the right.
        readout_s: of a rolling shutter, from the top row to the bottom one.
        height_scale: by which stated heights grow too fast.
        ripple_px: of a lens that no model has, rings and three lobes.
        speed: m/s, ahead.
    """

    relief: float = 0.0
    heights: tuple[float, ...] = (1.0,)
    cross: bool = False
    oblique_deg: float = 0.0
    rows: int = 4
    columns: int = 6
    attitude_deg: float = 2.0
    noise_px: float = 0.5
    outliers: float = 0.02
    gps_m: tuple[float, float] | None = (1.5, 2.5)
    points: int = 800
    late_s: float = 0.0
    lever_m: tuple[float, float] = (0.0, 0.0)
    readout_s: float = 0.0
    height_scale: float = 0.0
    ripple_px: float = 0.0
    speed: float = 10.0


def ground(plan: Plan, seed: int) -> FloatArray:
    """(P, 3) m, rolling as far as the plan's relief says."""
    random = np.random.default_rng((seed, 1))
    places = random.uniform(-110, 110, (plan.points, 2))
    waves = random.uniform(0.01, 0.06, (12, 2)) * random.choice((-1, 1), (12, 2))
    phase = random.uniform(0, 2 * math.pi, 12)
    height = np.sin(places @ waves.T + phase).sum(axis=1) / math.sqrt(6)
    return np.column_stack([places, height * plan.relief * HEIGHT_M])


def poses(plan: Plan, seed: int) -> tuple[FloatArray, FloatArray]:
    """(V, 3, 3) world to camera and (V, 3) m."""
    random = np.random.default_rng((seed, 2))
    turns, centres = [], []
    for number, share in enumerate(plan.heights):
        height = share * HEIGHT_M
        across, along = 0.4 * height, 0.28 * height
        for row in range(plan.rows):
            for column in range(plan.columns):
                east = (row - (plan.rows - 1) / 2) * across
                north = (column - (plan.columns - 1) / 2) * along
                heading = math.pi * (row % 2)
                if plan.cross and number % 2:
                    east, north, heading = north, east, heading + math.pi / 2
                tilt = math.radians(plan.oblique_deg) if number % 2 else 0.0
                # What an oblique image looks at stays where the others look.
                back = height * math.tan(tilt)
                place = np.array([east - back * math.sin(heading), north - back * math.cos(heading), height])
                roll, pitch = np.radians(random.normal(0, plan.attitude_deg, 2))
                turn = (
                    rotation_matrix(np.array([-tilt + pitch, roll, 0.0]))
                    @ DOWN
                    @ rotation_matrix(np.array([0, 0, heading + random.normal(0, 0.03)]))
                )
                turns.append(turn)
                centres.append(place + random.normal(0, 0.02 * height, 3) * (1, 1, 0.4))
    return np.stack(turns), np.stack(centres)


def courses(plan: Plan) -> FloatArray:
    """(V, 2, 3) unit vectors ahead and to the right of each image's course over the ground."""
    headings = [
        math.pi * (row % 2) + (math.pi / 2 if plan.cross and number % 2 else 0.0)
        for number in range(len(plan.heights))
        for row in range(plan.rows)
        for _ in range(plan.columns)
    ]
    return np.array([[(math.sin(h), math.cos(h), 0.0), (math.cos(h), -math.sin(h), 0.0)] for h in headings])


def rippled(camera: Calibration, pixels: FloatArray, ripple_px: float) -> FloatArray:
    """What a lens shows that departs from its model by rings and three lobes."""
    K = camera.intrinsics
    x, y = (pixels - (K.cx, K.cy)).T / K.fx
    radius, angle = np.hypot(x, y), np.arctan2(y, x)
    outward = ripple_px * (np.sin(9 * radius + 1) + 0.8 * np.cos(3 * angle + 1) * radius)
    return np.asarray(pixels + outward[:, None] * np.column_stack([np.cos(angle), np.sin(angle)]))


def shown(
    plan: Plan,
    camera: Calibration,
    turn: FloatArray,
    centre: FloatArray,
    points: FloatArray,
    ahead: FloatArray,
) -> FloatArray:
    """(P, 2) px of all points: each row at its own moment, the camera flying on."""
    height, seen = camera.intrinsics.image_size[1], camera.project((points - centre) @ turn.T)
    with np.errstate(invalid="ignore"):
        for _ in range(4 if plan.readout_s else 0):
            moment = plan.readout_s * (seen[:, 1:] / height - 0.5)
            seen = camera.project((points - centre - plan.speed * ahead * np.nan_to_num(moment)) @ turn.T)
        return rippled(camera, seen, plan.ripple_px) if plan.ripple_px else seen


def fly(
    plan: Plan, seed: int, camera: Calibration = CAMERA, model: Solvable = Solvable.BROWN
) -> tuple[Tracks, Scene]:
    """What the images show, and a scene to start from: everything near the truth but for a lens without distortion."""
    random = np.random.default_rng((seed, 3))
    size = camera.intrinsics.image_size
    points = ground(plan, seed)
    (turns, centres), course = poses(plan, seed), courses(plan)
    image, point, pixels = [], [], []
    for at, (turn, centre) in enumerate(zip(turns, centres, strict=True)):
        inside = (points - centre) @ turn.T
        seen = shown(plan, camera, turn, centre, points, course[at, 0])
        with np.errstate(invalid="ignore"):
            rows = np.flatnonzero(((seen > 2) & (seen < np.array(size) - 2)).all(axis=1) & (inside[:, 2] > 0))
        # A detector finds a point again in most of the images that show it, not in all.
        rows = rows[random.random(len(rows)) < 0.75]
        image.append(np.full(len(rows), at))
        point.append(rows)
        pixels.append(seen[rows])
    px = np.concatenate(pixels)
    px = px + random.normal(0, plan.noise_px, px.shape)
    wrong = random.random(len(px)) < plan.outliers
    px[wrong] += random.normal(0, 12, (int(wrong.sum()), 2))
    order = np.argsort(np.concatenate(point), kind="stable")
    positions = None
    if plan.gps_m is not None:
        std = np.array([plan.gps_m[0], plan.gps_m[0], plan.gps_m[1]])
        drift = random.normal(0, 3 * std)
        positions = Positions(
            places=antenna(plan, centres, course) + drift + random.normal(0, 1, centres.shape) * std,
            # As an ordinary receiver, which states none, is taken to be; RTK states its own.
            std=np.tile(np.where(std < 0.1, std, (3.0, 3.0, 5.0)), (len(centres), 1)),
        )
    tracks = Tracks(
        names=tuple(f"IMG_{at:04}.JPG" for at in range(len(turns))),
        image_size=size,
        image=np.concatenate(image)[order],
        point=np.concatenate(point)[order],
        pixels=px[order],
        positions=positions,
    )
    focal = camera.intrinsics.fx * random.uniform(0.97, 1.03)
    start = np.zeros(len(model.parameters))
    start[:4] = focal, focal, size[0] / 2, size[1] / 2
    scene = Scene(
        model=model,
        parameters=start,
        rotations=np.stack([rotation_matrix(by) for by in random.normal(0, 0.005, (len(turns), 3))]) @ turns,
        centres=centres + random.normal(0, 0.5, centres.shape),
        points=points + random.normal(0, 0.5, points.shape),
    )
    return tracks.only(np.ones(len(px), dtype=np.bool_)), scene


def antenna(plan: Plan, centres: FloatArray, course: FloatArray) -> FloatArray:
    """(V, 3) where a receiver says that the images were taken, but for its noise."""
    ahead = plan.lever_m[0] + plan.speed * plan.late_s
    places = centres + ahead * course[:, 0] + plan.lever_m[1] * course[:, 1]
    return np.asarray(places * (1.0, 1.0, 1.0 + plan.height_scale))


PLANS = {
    "flat, one height": Plan(),
    "flat, cross strips": Plan(heights=(1.0, 1.0), cross=True, rows=3, columns=5),
    "relief, one height": Plan(relief=0.06),
    "two heights, relief": Plan(relief=0.06, heights=(1.0, 1.5), cross=True, rows=3, columns=5),
    "two heights, flat, RTK": Plan(heights=(1.0, 1.5), cross=True, rows=3, columns=5, gps_m=(0.02, 0.03)),
    "oblique, flat": Plan(heights=(1.0, 1.0), cross=True, oblique_deg=30.0, rows=3, columns=5),
    "oblique, relief, no GPS": Plan(
        relief=0.04, heights=(1.0, 1.1), cross=True, oblique_deg=30.0, rows=3, columns=5, gps_m=None
    ),
    "oblique, noise 0.8, 8 % out": Plan(
        relief=0.03,
        heights=(1.0, 1.2),
        cross=True,
        oblique_deg=30.0,
        rows=3,
        columns=5,
        noise_px=0.8,
        outliers=0.08,
    ),
    "oblique, two heights, 3000 points": Plan(
        relief=0.03, heights=(1.0, 1.4), cross=True, oblique_deg=30.0, rows=3, columns=5, points=3000
    ),
}
"""The first two determine no focal length."""


def flown_of(result: CalibrationResult) -> Flown:
    """Return what a flight's result says besides."""
    assert result.flown is not None
    return result.flown
