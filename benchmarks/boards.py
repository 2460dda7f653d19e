"""Real sets of a board, as a user calibrates them, beside OpenCV and beside what their owners published.

    python -m benchmarks.boards FOLDER [--published TABLE.csv] [--only WORD]

FOLDER has a folder of frames for each set. ``calibrary calibrate`` runs on each as a program, with nothing named.
OpenCV gets the same corners, and the lens model that was chosen (Brown's, rational, fisheye). A line of TABLE states
`set`, `fx`, `sigma` (empty where the owner states none) and `source`. Wanted: no set further than 3 σ of both from what
is published, and an answer that can be acted upon for 60 % of them. OpenCV's σ has nothing but noise in it.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import resource
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

FRAMES = {".bmp", ".jpg", ".jpeg", ".pgm", ".png", ".tif", ".tiff"}
FLAGS = {"brown": 0, "rational": cv2.CALIB_RATIONAL_MODEL}


class Published(NamedTuple):
    """What the owner of a set says of fx, in px; sigma is nan where the owner states none."""

    fx: float
    sigma: float
    source: str


def published(table: Path | None) -> dict[str, Published]:
    """What is published, by set."""
    if table is None:
        return {}
    with table.open(newline="", encoding="utf-8") as lines:
        return {
            row["set"]: Published(float(row["fx"]), float(row["sigma"] or "nan"), row["source"])
            for row in csv.DictReader(lines)
        }


def calibrated(frames: list[Path], corners: Path) -> tuple[dict[str, Any] | str, float]:
    """What the program says of a set, or its refusal, and its CPU time in seconds."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    program = Path(sys.executable).with_name("calibrary")
    done = subprocess.run(
        [program, "calibrate", *frames, "--json", "--corners", corners],
        capture_output=True,
        text=True,
        check=False,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return (json.loads(done.stdout) if done.stdout else done.stderr.strip()), spent


def by_opencv(answer: dict[str, Any], corners: Path) -> str:
    """OpenCV's fx ± σ of the corners that counted, or that it fails."""
    kept = json.loads(corners.read_text(encoding="utf-8"))
    columns = kept["board"]["columns"]
    counted = {view["name"] for view in answer["views"] if not view["without"]}
    objects: list[Any] = []
    images: list[Any] = []
    for view in kept["views"]:
        if view["name"] in counted:
            ids = np.array(view["ids"])
            objects.append(np.c_[ids % columns, ids // columns, 0 * ids].astype(np.float32)[None])
            images.append(np.c_[view["x"], view["y"]].astype(np.float32)[None] - np.float32(0.5))
    size: tuple[int, int] = tuple(kept["image_size"])
    try:
        if answer["model"] == "fisheye":
            free = cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW
            return f"{cv2.fisheye.calibrate(objects, images, size, np.eye(3), np.zeros(4), flags=free)[1][0, 0]:.1f}"
        _, found, _, _, _, std, _, _ = cv2.calibrateCameraExtended(
            objects, images, size, np.eye(3), np.zeros(8), flags=FLAGS[answer["model"]]
        )
    except cv2.error:
        return "fails"
    return f"{found[0, 0]:.1f} ± {std[0, 0]:.1f}"


def line(name: str, answer: dict[str, Any], corners: Path, known: Published | None, spent: float) -> str:
    """A set that was solved, as a line of the table."""
    fx, uses = answer["calibration"]["intrinsics"]["fx"], answer["uses"]
    sigma = fx * uses["sigma_focal"]
    use = next((check["use"] for check in uses["checks"] if check["holds"]), "none")
    row = f"{name:<17}{use:<7}{len(answer['views']):>5}  {answer['model']:<9}{fx:8.1f} ± {sigma:<5.1f}"
    row += f"{uses['share']:7.0%}{uses['radius_px']:7.0f}  {by_opencv(answer, corners):<16}"
    if known:
        both = math.hypot(sigma, 0.0 if math.isnan(known.sigma) else known.sigma)
        row += f"{known.fx:8.1f} ± {known.sigma:<5.1f}{abs(fx - known.fx) / both:5.1f}"
    else:
        row += " " * 21
    return f"{row}{spent:7.1f}"


def main() -> int:
    """Solve every set and print the table; 1 if a published value is missed or too few sets are of use."""
    parser = argparse.ArgumentParser(description="Real sets of a board, beside OpenCV and what is published.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--published", type=Path)
    parser.add_argument("--only", default="")
    arguments = parser.parse_args()
    known = published(arguments.published)
    print(
        f"{'set':<17}{'use':<7}{'views':>5}  {'lens':<9}{'fx ± σ κ':>16}{'proven':>7}{'to px':>7}  {'OpenCV':<16}"
        f"{'published':>16}{'z':>5}{'CPU s':>7}"
    )
    solved = of_use = far = 0
    with tempfile.TemporaryDirectory() as scratch:
        for folder in sorted(
            path for path in arguments.folder.iterdir() if path.is_dir() and arguments.only in path.name
        ):
            frames = sorted(path for path in folder.iterdir() if path.suffix.lower() in FRAMES)
            corners = Path(scratch) / f"{folder.name}.json"
            answer, spent = calibrated(frames, corners)
            solved += 1
            if isinstance(answer, str):
                print(f"{folder.name:<17}{answer}")
                continue
            print(line(folder.name, answer, corners, known.get(folder.name), spent), flush=True)
            of_use += any(check["holds"] for check in answer["uses"]["checks"])
            if one := known.get(folder.name):
                fx = answer["calibration"]["intrinsics"]["fx"]
                sigma = fx * answer["uses"]["sigma_focal"]
                far += abs(fx - one.fx) > 3 * math.hypot(sigma, 0.0 if math.isnan(one.sigma) else one.sigma)
    print(f"{of_use} of {solved} may be acted upon, {far} beyond 3 σ of what is published")
    return int(far > 0 or of_use < 0.6 * solved)


if __name__ == "__main__":
    raise SystemExit(main())
