"""What a flight costs against COLMAP's own pipeline on the same images: processor time and memory.

    python -m benchmarks.flight_cost [FOLDER] [--images N] [--rounds N]

Without FOLDER twelve images of 20 megapixels are rendered. Every program runs in a process of its own, in turn, so that
the load of the machine meets all of them: ``--verify``'s look, ``calibrate flight``, and what
``colmap automatic_reconstructor`` does through pycolmap with its defaults: features at up to 3200 px, every pair,
incremental mapping.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path

# The matrices are small: threads of BLAS cost more than they save, several times over on a busy machine.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from PIL import Image

from benchmarks.table import compared
from calibrary.calibration import Calibration, Intrinsics
from calibrary.jobs.calibrate.flight_images import FlightOptions, solve_images
from calibrary.jobs.calibrate.frames import Told
from calibrary.jobs.verify.look import look
from calibrary.records import replace
from tests.sfm.flights import CAMERA, Plan
from tests.sfm.rendered import render_flight

RENDERED = (1368, 912)
ENLARGED = 4
MB = 1024


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", nargs="?", type=Path, metavar="FOLDER")
    parser.add_argument("--images", type=int, default=12, help="the first so many")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--run", choices=PROGRAMS, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.run is not None:
        PROGRAMS[given.run](sorted(given.folder.iterdir())[: given.images])
        return
    with tempfile.TemporaryDirectory() as temporary:
        folder = given.folder or _rendered(Path(temporary))
        costs: dict[str, list[float]] = {name: [] for name in PROGRAMS}
        for _ in range(given.rounds):
            for name, found in costs.items():
                found.append(_cpu_of(name, folder, given.images))
    for name in OURS:
        compared(
            f"{name}, {given.images} images", costs[name], costs[PEER], scale=1, unit="s", name=PEER, most=1.0
        )


def _cpu_of(name: str, folder: Path, images: int) -> float:
    """Seconds of a program in a process of its own; what it says of itself, and its memory, go to standard error."""
    arguments = [
        sys.executable,
        "-m",
        "benchmarks.flight_cost",
        str(folder),
        f"--images={images}",
        f"--run={name}",
    ]
    process = subprocess.Popen(arguments, stdout=sys.stderr)
    _, status, used = os.wait4(process.pid, 0)
    assert status == 0, name
    print(f"  {name}: peak {used.ru_maxrss / MB:.0f} MB", file=sys.stderr)
    return used.ru_utime + used.ru_stime


def _rendered(folder: Path) -> Path:
    plan = Plan(relief=0.06, heights=(1.0, 1.5), cross=True, rows=2, columns=3)
    render_flight(folder / "flight", plan, CAMERA.scaled(RENDERED), 0, noise=3.0, enlarged=ENLARGED)
    return folder / "flight"


def _camera(path: Path) -> Calibration:
    """A usual K of the images' size."""
    with Image.open(path) as image:
        width, height = size = image.size
    K = Intrinsics(fx=0.75 * width, fy=0.75 * width, cx=width / 2, cy=height / 2, image_size=size)
    return replace(CAMERA, intrinsics=K)


def _look(paths: Sequence[Path]) -> None:
    seen = look(paths, _camera(paths[0]))
    print(f"  {seen.reason or seen.found}")


def _flight(paths: Sequence[Path]) -> None:
    result, _ = solve_images(paths, Told(), FlightOptions()).calibrated(Told())
    print(f"  fx {result.calibration.intrinsics.fx:.1f} px, {len(result.rms_by_view)} images")


def _colmap(paths: Sequence[Path]) -> None:
    import pycolmap  # noqa: PLC0415  this process alone needs it

    with tempfile.TemporaryDirectory() as folder:
        database, images = Path(folder) / "database.db", Path(folder) / "images"
        images.mkdir()
        for path in paths:
            (images / path.name).symlink_to(path.resolve())
        pycolmap.extract_features(
            database, images, camera_mode=pycolmap.CameraMode.SINGLE, device=pycolmap.Device.cpu
        )
        pycolmap.match_exhaustive(database, device=pycolmap.Device.cpu)
        models = pycolmap.incremental_mapping(database, images, Path(folder) / "out")
        for model in models.values():
            focal = next(iter(model.cameras.values())).params[0]
            print(f"  fx {focal:.1f} px, {model.num_reg_images()} images")


PEER = "pycolmap's defaults"
OURS: dict[str, Callable[[Sequence[Path]], None]] = {"--verify": _look, "calibrate flight": _flight}
PROGRAMS = {**OURS, PEER: _colmap}


if __name__ == "__main__":
    main()
