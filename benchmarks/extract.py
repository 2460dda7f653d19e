"""What ``extract`` costs: an image, a flight, a flight that was resized, a fleet of many cameras.

    python -m benchmarks.extract [--images N] [--repeats R]

On the corpus of :mod:`benchmarks.corpus` in a temporary folder: 20-megapixel frames with 60 kB of metadata each. Beside
it run the minimal function of the document the project was created from, which reads two numbers of an image, and
exiftool. The page cache is warm: a first pass reads every file.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median

import exifread
from PIL import Image as Picture

from benchmarks.corpus import write_corpus
from benchmarks.table import compared, in_turns, machine, show
from calibrary.evidence.context import Scene
from calibrary.evidence.identity import camera_key
from calibrary.evidence.weighing import evidence_of
from calibrary.jobs.extract.knowledge import Knowledge
from calibrary.parsers.imagery import read_metadata

SENSOR_MM = (13.2, 8.8)
VARIOUS = 514
RESIZED = (2736, 1824)


def minimal(path: Path) -> float:
    """Fx by the source document's formula: EXIF focal length over the sensor, against the decoder's size."""
    with path.open("rb") as file:
        tag = exifread.process_file(file, details=False)["EXIF FocalLength"]
    with Picture.open(path) as image:
        width_px, _ = image.size
    return float(tag.values[0].num) / float(tag.values[0].den) / SENSOR_MM[0] * width_px


def full(path: Path, knowledge: Knowledge) -> float:
    """Everything one image says: facts, the known camera, the key, every estimate and what contradicts it."""
    metadata = read_metadata(path)
    known = knowledge.of(metadata)
    camera_key(metadata, known.camera.sub_camera if known.camera is not None else None)
    evidence = evidence_of(Scene(metadata=metadata, known=known.camera, siblings=known.siblings))
    assert evidence.chosen is not None
    return evidence.chosen.intrinsics.fx


def one_image(paths: Sequence[Path], repeats: int) -> None:
    """What an image costs, in one process."""
    knowledge = Knowledge.load(None)
    times = in_turns(
        {
            "minimal": lambda: [minimal(path) for path in paths],
            "full": lambda: [full(path, knowledge) for path in paths],
        },
        repeats,
    )
    cpu = {name: [cost.cpu_s / len(paths) for cost in costs] for name, costs in times.items()}
    compared(
        "evidence and every estimate of one image, nothing shared",
        cpu["full"], cpu["minimal"], scale=1e3, unit="ms", name="the document's function", most=1.5,
    )  # fmt: skip


def one_flight(
    what: str, folder: Path, paths: Sequence[Path], repeats: int, *, least: float, most: float | None = None
) -> None:
    """What the whole command costs, its start included, beside exiftool and a loop of the document's function."""
    contestants: dict[str, Callable[[], object]] = {
        "ours": lambda: extract(folder),
        "loop": lambda: [minimal(path) for path in paths],
    }
    exiftool = shutil.which("exiftool")
    if exiftool is not None:
        contestants["exiftool"] = lambda: run_exiftool(exiftool, paths)
    times = in_turns(contestants, repeats)
    cpu = {name: [cost.cpu_s for cost in costs] for name, costs in times.items()}
    if exiftool is None:
        show(what, f"{median(cpu['ours']):.3g} s", "exiftool is not installed", limit=f"≥ {least:g} ×")
    else:
        compared(what, cpu["ours"], cpu["exiftool"], scale=1, unit="s", name="exiftool -fast2", least=least)
    loop = "a loop of the document's function"
    compared(f"{what}, beside a loop", cpu["ours"], cpu["loop"], scale=1, unit="s", name=loop, most=most)


def run_exiftool(exiftool: str, paths: Sequence[Path]) -> None:
    """One process for all files."""
    names = "".join(f"{path}\n" for path in paths)
    command = [exiftool, "-json", "-fast2", "-q", "-@", "-"]
    subprocess.run(command, input=names, text=True, stdout=subprocess.DEVNULL, check=True)


def extract(folder: Path) -> None:
    """Run ``calibrary extract`` in a process of its own."""
    with tempfile.TemporaryDirectory() as out:
        command = [sys.executable, "-m", "calibrary", "extract", str(folder), "--recursive", "--workers", "1"]
        command += ["--output-matrix", str(Path(out) / "K_matrix.npy")]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    # 1: some camera has no valid K, as the made-up ones.
    assert done.returncode in {0, 1}, done.stderr


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(description="What extract costs.")
    parser.add_argument("--images", type=int, default=1000, metavar="N", help="of a flight")
    parser.add_argument("--repeats", type=int, default=7, metavar="R", help="of what is compared")
    given = parser.parse_args()
    print(machine())
    with tempfile.TemporaryDirectory(prefix="calibrary-bench-") as name:
        whole, resized, various = (Path(name) / part for part in ("whole", "resized", "various"))
        what = f"extract, {given.images} images"
        paths = write_corpus(whole, given.images)
        one_image(paths, given.repeats)
        one_flight(what, whole, paths, given.repeats, least=20.0)
        paths = write_corpus(resized, given.images, size=RESIZED)
        one_flight(f"{what}, resized", resized, paths, given.repeats, least=20.0, most=4.0)
        paths = write_corpus(various, given.images, cameras=VARIOUS)
        one_flight(f"{what} of {VARIOUS} cameras", various, paths, given.repeats, least=15.0)


if __name__ == "__main__":
    main()
