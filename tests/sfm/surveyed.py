"""Ground control of simulated flights: surveyed points of the ground, and clicks on them in the images."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calibrary.calibration import SourceFile
from calibrary.sfm.geodesy import LocalFrame
from calibrary.sfm.survey import Mark, Survey
from tests.sfm.flights import CAMERA, DEGREES_PER_M, LATITUDE, LONGITUDE, Plan, ground, poses

HEIGHT = 450.0
FRAME = LocalFrame(longitude_deg=LONGITUDE, latitude_deg=LATITUDE, height_m=HEIGHT)
"""The frame that simulated flights are flown in."""
DATUM = (0.4, -0.3, 47.0)
"""M east, north and up of the points' datum and heights from the positions'."""


def survey(
    plan: Plan,
    seed: int,
    *,
    points: int = 6,
    marks: int = 6,
    std_m: float = 0.03,
    mark_px: float = 1.0,
    datum: tuple[float, float, float] = DATUM,
    wrong: float = 0.0,
) -> Survey:
    """What was surveyed and marked in a flight of :func:`tests.sfm.flights.fly`.

    Args:
        plan: of the flight.
        seed: of the flight.
        points: around the middle of the ground, spread.
        marks: of each point, in as many images.
        std_m: their true standard deviation, which is stated too.
        mark_px: the same of the marks.
        datum: m by which the points' frame is off the positions'.
        wrong: share of the marks that are some 40 px off.
    """
    random = np.random.default_rng((seed, 9))
    cloud, (turns, centres) = ground(plan, seed), poses(plan, seed)
    angle = 2 * np.pi * np.arange(points) / points
    wanted = (
        np.column_stack([45 * np.cos(angle), 40 * np.sin(angle)])
        * np.where(np.arange(points) % 2, 1, 0.5)[:, None]
    )
    chosen = [int(np.argmin(np.linalg.norm(cloud[:, :2] - at, axis=1))) for at in wanted]
    places = cloud[chosen] + random.normal(0, std_m, (points, 3)) + datum
    found: list[Mark] = []
    for point, at in enumerate(chosen):
        inside = np.einsum("vij,vj->vi", turns, cloud[at] - centres)
        seen = CAMERA.project(inside)
        size = np.array(CAMERA.intrinsics.image_size)
        with np.errstate(invalid="ignore"):
            images = np.flatnonzero(((seen > 5) & (seen < size - 5)).all(axis=1) & (inside[:, 2] > 0))
        for image in random.permutation(images)[:marks].tolist():
            off = mark_px if random.random() >= wrong else 40.0
            x, y = np.clip(seen[image] + random.normal(0, off, 2), 0, size).tolist()
            found.append(Mark(point=point, image=f"IMG_{image:04}.JPG", pixel=(x, y), line=2 + len(found)))
    degrees = places * (*DEGREES_PER_M, 1.0) + (LONGITUDE, LATITUDE, HEIGHT)
    return Survey(
        names=tuple(f"GCP{at + 1}" for at in range(points)), places=degrees, is_local=False, marks=tuple(found),
        file=SourceFile(name="gcp_list.txt", sha256="0" * 64), std_m=std_m, mark_px=mark_px,
    )  # fmt: skip


def write_gcp_list(path: Path, given: Survey, head: str = "EPSG:4326") -> Path:
    """The file as WebODM writes it."""
    rows = [head]
    for mark in given.marks:
        place = " ".join(f"{value:.9f}" for value in given.places[mark.point].tolist())
        rows.append(
            f"{place} {mark.pixel[0] - 0.5:.3f} {mark.pixel[1] - 0.5:.3f} {mark.image} {given.names[mark.point]}"
        )
    path.write_text("\n".join(rows) + "\n")
    return path
