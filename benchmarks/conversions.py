"""Random conversions: is "exact" exact, and is every stated px what an independent projection finds?

    python -m benchmarks.conversions --count 10000 --seed 1

Each conversion draws a source format, a lens that it holds and a camera, writes and reads that file, and writes the
camera in a drawn target format, with a drawn limit and the user's word or without. What was written is then projected
by formulas that share no code with the package (tests/core/lens_models.py), and by pycolmap or cv2 for the files that
they read, over a grid that is not the one the verdict was measured on. The rays of pixels are calibrary's, but each is
checked: the formula of the source has to put it into its pixel.

A line for each kind of verdict, with how many there were and the largest deviation; exit code 1 if an "exact" is off by
more than 0.001 px, or a stated px by more than 5 % of itself and 0.001 px.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pycolmap

from calibrary import parsers
from calibrary.arrays import FloatArray
from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics
from calibrary.distortion import BrownConrady, Distortion, KannalaBrandt, NoDistortion, Rational, ThinPrism
from calibrary.errors import CalibraryError, InputError, UnsupportedModelError
from calibrary.parsers.format import Capacity, Fidelity, Format
from calibrary.records import replace
from tests.core.lens_models import LENS_MODELS
from tests.parsers.cameras import SPAN, STRENGTH, camera

LIMITS = (None, None, 0.5, 5.0, 1e9)
STEPS = (37, 31)
ANYWHERE, NEAR, CLIMB = 300, 300, 200
"""Points in the frame, about the axis and around the worst so far."""
EXACT_PX, SHARE = 0.001, 0.05
IN_CV2 = (NoDistortion, BrownConrady, Rational, ThinPrism)
CHECKED_PX = 1e-5
"""Largest distance of a ray's pixel by the source's own formula: calibrary's inverse is not trusted."""


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    draw = np.random.default_rng(arguments.seed)
    written = [record for record in parsers.formats() if record.capacity is not None]
    seen: Counter[str] = Counter()
    worst: dict[str, float] = {}
    wrong: list[str] = []
    slowest = (0.0, "")
    for number in range(arguments.count):
        source, target = (written[draw.integers(len(written))] for _ in range(2))
        made = _camera(draw, source)
        if made is None:
            seen["no such camera drawn"] += 1
            continue
        limit, word = LIMITS[draw.integers(len(LIMITS))], bool(draw.integers(2))
        began = time.process_time()
        try:
            data, verdict = parsers.encode([made], target, max_error_px=limit, drop_distortion=word)
        except UnsupportedModelError:
            seen["refused"] += 1
            slowest = max(
                slowest, (time.process_time() - began, f"{number}: {source.name} → {target.name}, refused")
            )
            continue
        slowest = max(slowest, (time.process_time() - began, f"{number}: {source.name} → {target.name}"))
        outcome = "unknown" if made.distortion is None else verdict.outcome.value
        seen[outcome] += 1
        stated = verdict.lost_px if verdict.outcome is Fidelity.K_ONLY else verdict.max_px
        found = _found(made, target, data, draw)
        if found is None:
            seen[f"{outcome}, no pixel to compare"] += 1
            continue
        allowed = EXACT_PX if verdict.outcome is Fidelity.EXACT else EXACT_PX + SHARE * found
        off = abs(found - stated)
        share = found if verdict.outcome is Fidelity.EXACT else off / max(found, EXACT_PX)
        worst[outcome] = max(worst.get(outcome, 0.0), share)
        if not off <= allowed:
            lens = made.distortion.model if made.distortion is not None else "unknown"
            wrong.append(f"{number}: {source.name} {lens} → {target.name}: {verdict}: found {found:.6g} px")
    for outcome, count in seen.most_common():
        unit = "px off at most" if outcome in {"exact", "unknown"} else "of the px found, at most"
        print(f"{count:6d}  {outcome}" + (f": {worst[outcome]:.3g} {unit}" if outcome in worst else ""))
    print(f"longest: {slowest[0]:.2f} s, {slowest[1]}")
    print(f"{len(wrong)} of {arguments.count} wrong")
    print("\n".join(wrong[:50]))
    return int(bool(wrong))


def _camera(draw: np.random.Generator, source: Format) -> Calibration | None:
    """A camera as a file of the source has it, None if what was drawn is none."""
    capacity = source.capacity or Capacity(models=())
    width, height = (int(side) for side in draw.integers(320, 9000, 2))
    fx = max(width, height) * draw.uniform(0.5, 3.0)
    intrinsics = Intrinsics(
        fx=fx,
        fy=fx * draw.uniform(0.98, 1.02) if capacity.two_focals else fx,
        cx=width * (0.5 + (draw.uniform(-0.04, 0.04) if capacity.off_centre else 0.0)),
        cy=height * (0.5 + (draw.uniform(-0.04, 0.04) if capacity.off_centre else 0.0)),
        skew=fx * draw.choice([0.0, 1e-6, 1e-3]) if capacity.skew else 0.0,
        image_size=(width, height),
    )
    try:
        made = replace(
            camera(_lens(draw, capacity)),
            camera=CameraKey(image_size=(width, height)),
            intrinsics=intrinsics,
            grade=Grade.CALIBRATED,
        )
        data, _ = parsers.encode([made], source)
        size = (width, height) if source.needs_image_size else None
        [read] = parsers.decode(data, name=f"x{source.suffixes[0]}", format=source, image_size=size)
    except InputError:
        return None
    return replace(read, grade=Grade.CALIBRATED)


def _lens(draw: np.random.Generator, capacity: Capacity) -> Distortion | None:
    if not capacity.models or draw.random() < 0.1:
        return None
    model = capacity.models[draw.integers(len(capacity.models))]
    strength = (0.3 if model is KannalaBrandt else 1.0) * 10.0 ** draw.uniform(-4, 0)
    spans = {name: (-strength * most, strength * most) for name, most in STRENGTH.items()} | SPAN
    kept = draw.integers(1, len(model.names()) + 1) if model.names() else 0
    return model(
        **{
            name: float(draw.uniform(*spans[name])) if at < kept or name in SPAN else 0.0
            for at, name in enumerate(model.names())
        }
    )


def _found(made: Calibration, target: Format, data: bytes, draw: np.random.Generator) -> float | None:
    """The largest distance between the projections of source and file over the frame, None without a common ray."""
    K = made.intrinsics
    size = K.image_size
    [copy] = parsers.decode(
        data,
        name=f"x{target.suffixes[0]}",
        format=target,
        image_size=size if target.needs_image_size else None,
    )
    lost = copy.distortion is None and made.distortion is not None
    u, v = np.meshgrid(*(np.linspace(0.0, side, steps) for side, steps in zip(size, STEPS, strict=True)))
    near = max(size) * 2.0 ** draw.uniform(-14, -1, NEAR)
    angle = draw.uniform(0.0, 2 * math.pi, NEAR)
    pixels = np.vstack(
        [
            np.column_stack([u.ravel(), v.ravel()]),
            draw.uniform(size=(ANYWHERE, 2)) * size,
            np.column_stack([K.cx + near * np.cos(angle), K.cy + near * np.sin(angle)]),
        ]
    )
    worst, at = -1.0, np.zeros(2)
    for round_ in range(4):
        inside = ((pixels >= 0) & (pixels <= size)).all(axis=1)
        seen, apart = _apart(made, copy, target, data, pixels[inside])
        # Beyond a pinhole's half space nothing is lost that could be counted.
        apart = np.where(np.isfinite(apart), apart, -1.0 if lost else np.inf)
        if len(apart) and apart.max() > worst:
            worst, at = float(apart.max()), seen[apart.argmax()]
        if worst < 0 or not math.isfinite(worst):
            break
        pixels = at + draw.normal(size=(CLIMB, 2)) * np.array(size) / STEPS[0] * 0.5 / 3.0**round_
    return worst if worst >= 0 else None


def _apart(
    made: Calibration, copy: Calibration, target: Format, data: bytes, pixels: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Those of some pixels that have a ray, and how far from each the file puts its ray."""
    source = made if made.distortion is not None else replace(made, distortion=NoDistortion())
    rays = source.unproject(pixels)
    seen = np.isfinite(rays).all(axis=1)
    pixels, rays = pixels[seen], rays[seen]
    seen = np.isfinite(source.project(rays)).all(axis=1)
    pixels, rays = pixels[seen], rays[seen]
    if not len(rays):
        return pixels, np.empty(0)
    if not _is_in(source, rays, pixels):
        raise AssertionError(f"the rays of {source.distortion} are not those of its formula")
    return pixels, np.linalg.norm(_projected(copy, target, data, rays) - pixels, axis=1)


def _projected(copy: Calibration, target: Format, data: bytes, rays: FloatArray) -> FloatArray:
    """Where a program that reads the file puts the rays, in the canonical origin."""
    lens = copy.distortion
    if target.name in {"colmap_text", "colmap_binary"}:
        return _by_pycolmap(target, data, rays)
    if isinstance(lens, IN_CV2) and not copy.intrinsics.skew and (rays[:, 2] > 0).all():
        K, coefficients = copy.to_opencv()
        there = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), K, coefficients)[0][:, 0]
        return np.asarray(there, dtype=np.float64) + 0.5
    lens = lens if lens is not None else NoDistortion()
    formula = LENS_MODELS[lens.model]
    if formula.projects is None:
        there = copy.project(rays)
        inside = np.isfinite(there).all(axis=1)
        if not _is_in(copy, rays[inside], there[inside]):
            raise AssertionError(f"the rays of {lens} are not those of its formula")
        return there
    with np.errstate(all="ignore"):
        seen = formula.projects(SimpleNamespace(**lens.coefficients), rays)
    there = _on_sensor(copy.intrinsics, seen)
    return np.where(rays[:, 2:] > 0, there, np.nan) if isinstance(lens, NoDistortion) else there


def _by_pycolmap(target: Format, data: bytes, rays: FloatArray) -> FloatArray:
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        suffix = ".txt" if target.name == "colmap_text" else ".bin"
        (place / f"cameras{suffix}").write_bytes(data)
        empty = b"" if suffix == ".txt" else bytes(8)
        for name in ("images", "points3D", "rigs", "frames"):
            (place / f"{name}{suffix}").write_bytes(empty)
        [held] = pycolmap.Reconstruction(folder).cameras.values()
    return np.array(
        [there if (there := held.img_from_cam(ray)) is not None else [np.nan] * 2 for ray in rays]
    )


def _on_sensor(K: Intrinsics, seen: FloatArray) -> FloatArray:
    return np.column_stack([K.fx * seen[:, 0] + K.skew * seen[:, 1] + K.cx, K.fy * seen[:, 1] + K.cy])


def _is_in(camera: Calibration, rays: FloatArray, pixels: FloatArray) -> bool:
    """Whether the formula of the camera's lens connects each ray with its pixel."""
    K, lens = camera.intrinsics, camera.distortion or NoDistortion()
    formula, c = LENS_MODELS[lens.model], SimpleNamespace(**lens.coefficients)
    if formula.projects is not None:
        there = _on_sensor(K, formula.projects(c, rays))
        return bool((np.linalg.norm(there - pixels, axis=1) < CHECKED_PX).all())
    y = (pixels[:, 1] - K.cy) / K.fy
    seen = np.column_stack([(pixels[:, 0] - K.cx - K.skew * y) / K.fx, y])
    made = formula.corrects(c, seen) if formula.corrects is not None else seen
    own = made if made.shape[1] == 3 else np.column_stack([made, np.ones(len(made))])
    own = own / np.linalg.norm(own, axis=1)[:, None]
    apart = np.linalg.norm(own - rays / np.linalg.norm(rays, axis=1)[:, None], axis=1)
    return bool((apart * max(K.fx, K.fy) < CHECKED_PX).all())


if __name__ == "__main__":
    try:
        sys.exit(main())
    except CalibraryError as error:
        sys.exit(str(error))
