"""What the gate costs, as ratios from one run of this file on one machine.

    python benchmarks/extract.py [--quick] [--images N] [--pool N] [--many N] [--repeats R]

On the corpus of :mod:`corpus` in a temporary folder: 20-megapixel frames with 60 kB of metadata each.

* The cost of hearing everything an image says, next to the minimal function of the document the project was
  created from, which reads two numbers of it, and next to exiftool.
* Two workers next to one.
* Memory and time for a hundred thousand images, and the bytes that are read of one.

Repetitions are interleaved and the median counts. The page cache is warm: a first pass reads every file.
Nothing here fails on a slow machine; a goal is met or missed, and that is printed.
"""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

import exifread
from PIL import Image

from calibrary.evidence.collect import collect
from calibrary.evidence.context import Scene
from calibrary.evidence.identity import camera_key
from calibrary.jobs.extract.cameras import DEFAULT_SENSOR_MM, Sensor, group_cameras
from calibrary.jobs.extract.judging import judge
from calibrary.jobs.extract.knowledge import Knowledge
from calibrary.jobs.images.accumulator import undated
from calibrary.jobs.images.reading import gather
from calibrary.parsers.imagery import read_metadata
from calibrary.parsers.imagery.reader import read_source
from calibrary.parsers.imagery.source import open_source
from calibrary.policy import FLEET

if TYPE_CHECKING:
    from benchmarks.corpus import write_corpus
else:
    # A program's own folder is where Python looks first.
    from corpus import write_corpus

GATE = """\
import resource, sys, time
from pathlib import Path
from calibrary.cli.main import main

start = time.perf_counter()
code = main(sys.argv[1:])
seconds = time.perf_counter() - start
status = Path("/proc/self/status")
if status.exists():
    [peak] = [line.split()[1] for line in status.read_text().splitlines() if line.startswith("VmHWM")]
else:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // (1024 if sys.platform == "darwin" else 1)
print(seconds, peak)
sys.exit(code)
"""
"""The whole command, and then what it took in seconds and the most memory its process ever held, in KiB.

Not ru_maxrss where there is better: Linux counts into it what the process that started this one held.
"""

POLL_S = 0.02
DISTINCT = 2000
SUMS = 20_000_000


@dataclass(frozen=True, slots=True)
class Sizes:
    """How much of everything is done."""

    images: int
    pool: int
    many: int
    repeats: int


QUICK = Sizes(images=100, pool=6000, many=10_000, repeats=3)
FULL = Sizes(images=500, pool=60_000, many=100_000, repeats=3)


@dataclass(frozen=True, slots=True)
class Run:
    """One run of the whole gate in a process of its own.

    Attributes:
        seconds: of the command, from its arguments to its exit code.
        peak_mb: of its own process.
        others_mb: peak of each process it started, largest first; empty where they cannot be seen.
    """

    seconds: float
    peak_mb: float
    others_mb: tuple[float, ...]


def minimal(path: Path, sensor_mm: tuple[float, float]) -> tuple[float, float, float, float]:
    """K by the source document's formula: EXIF focal length over the sensor, against the decoder's size."""
    with path.open("rb") as file:
        tag = exifread.process_file(file, details=False)["EXIF FocalLength"]
    with Image.open(path) as image:
        width_px, height_px = image.size
    focal_mm = float(tag.values[0].num) / float(tag.values[0].den)
    fx = (focal_mm / sensor_mm[0]) * width_px
    fy = (focal_mm / sensor_mm[1]) * height_px
    return fx, fy, width_px / 2.0, height_px / 2.0


def full(path: Path, knowledge: Knowledge) -> float:
    """Everything one image says: facts, the known camera, the key, every estimate and what contradicts it."""
    metadata = read_metadata(path)
    known = knowledge.of(metadata)
    camera_key(metadata, known.camera.sub_camera if known.camera is not None else None)
    evidence = collect(Scene(metadata=metadata, known=known.camera, siblings=known.siblings))
    assert evidence.chosen is not None
    return evidence.chosen.intrinsics.fx


def as_the_gate(paths: Sequence[Path], folder: Path, knowledge: Knowledge) -> None:
    """The same by the gate's own way, which hears images that say the same only once."""
    gathered = gather(paths, folder, workers=1)
    sensor = Sensor(size_mm=DEFAULT_SENSOR_MM, given=False)
    for key, states in group_cameras(undated(gathered.states), knowledge).items():
        [camera] = judge(key, states, policy=FLEET, sensor=sensor)
        assert camera.calibration is not None


def cost_per_image(paths: Sequence[Path], folder: Path, repeats: int) -> None:
    """Full evidence next to the minimal function and to exiftool, on the same files."""
    knowledge = Knowledge.load(None)
    exiftool = shutil.which("exiftool")
    contestants: dict[str, Callable[[], object]] = {
        "minimal": lambda: [minimal(path, DEFAULT_SENSOR_MM) for path in paths],
        "full": lambda: [full(path, knowledge) for path in paths],
        "gate": lambda: as_the_gate(paths, folder, knowledge),
    }
    if exiftool is not None:
        contestants["exiftool"] = lambda: run_exiftool(exiftool, paths)
    times = interleaved(contestants, repeats)
    each = {name: f"{median(seconds) / len(paths) * 1e3:.3f} ms" for name, seconds in times.items()}
    print(f"\nOne image, of {len(paths)}, by one process; median of {repeats} interleaved repetitions")
    row("minimal function: exifread, Pillow's size, arithmetic", each["minimal"])
    row("full evidence: EXIF, XMP, catalogue, key, estimates", each["full"])
    row("  against the minimal function", *ratio(times["full"], times["minimal"]), at_most=1.5)
    row("the gate's way: equal images are heard once", each["gate"])
    row("  against the minimal function", *ratio(times["gate"], times["minimal"]), at_most=1.5)
    if exiftool is None:
        print("  exiftool -json -fast2: skipped, it is not installed (Debian: libimage-exiftool-perl)")
        return
    row("exiftool -json -fast2, all files in one process", each["exiftool"])
    row("  full evidence is faster by", *ratio(times["exiftool"], times["full"]), at_least=10.0)


def run_exiftool(exiftool: str, paths: Sequence[Path]) -> None:
    """One process for all files."""
    names = "".join(f"{path}\n" for path in paths)
    command = [exiftool, "-json", "-fast2", "-q", "-@", "-"]
    subprocess.run(command, input=names, text=True, stdout=subprocess.DEVNULL, check=True)


def bytes_read(paths: Sequence[Path]) -> None:
    """What reading the evidence of one file takes of it."""
    taken = []
    for path in paths:
        with open_source(path) as source:
            read_source(source)
            taken.append(source.bytes_read)
    print(f"\nBytes read of one file of {paths[0].stat().st_size / 1e6:.1f} MB, over {len(paths)} files")
    row("at most", f"{max(taken) / 1e3:.1f} kB", max(taken) / 1e3, at_most=256.0)


def two_workers(folder: Path, images: int, repeats: int) -> None:
    """The whole command with one worker and with two, each time in a new process, starting them included."""
    contestants: dict[str, Callable[[], object]] = {
        "one": lambda: gate(folder, "--workers", "1"),
        "two": lambda: gate(folder, "--workers", "2"),
        "sums by one": lambda: sums(1),
        "sums by two": lambda: sums(2),
    }
    times = interleaved(contestants, repeats)
    print(f"\nThe whole command on {images} images; median of {repeats} interleaved repetitions")
    row("1 worker", f"{median(times['one']):.2f} s")
    row("2 workers", f"{median(times['two']):.2f} s")
    row("  two are faster by", *ratio(times["one"], times["two"]), at_least=1.7)
    row("  what two processes gain here at all", ratio(times["sums by one"], times["sums by two"])[0])


def sums(processes: int) -> None:
    """A second of arithmetic, shared out evenly: what two cores that do nothing else do twice as fast."""
    command = [sys.executable, "-c", f"sum(n * n for n in range({SUMS // processes}))"]
    started = [subprocess.Popen(command) for _ in range(processes)]
    assert not any(process.wait() for process in started)


def memory(folders: dict[int, Path]) -> None:
    """The whole command on more and more images."""
    print("\nMemory of the whole command, peak resident set of each process")
    for images, folder in folders.items():
        run = gate(folder)
        row(f"{images} images, {images / run.seconds:.0f} a second", f"{run.seconds:.1f} s")
        row("  the command itself", f"{run.peak_mb:.0f} MB", run.peak_mb, at_most=200.0)
        if run.others_mb:
            print(f"  each of its workers: {', '.join(f'{mb:.0f} MB' for mb in run.others_mb)}")
        else:
            print("  its workers: not measured, there is no /proc here")


def gate(folder: Path, *flags: str) -> Run:
    """Run ``calibrary extract`` in a process of its own and watch it."""
    with tempfile.TemporaryDirectory() as out:
        command = [sys.executable, "-c", GATE, "extract", "--image-dir", str(folder), "--recursive", *flags]
        command += ["--output-matrix", str(Path(out) / "K_matrix.npy")]
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
        peaks: dict[int, int] = {}
        done = threading.Event()
        watcher = threading.Thread(target=watch, args=(process.pid, peaks, done))
        watcher.start()
        printed, told = process.communicate()
        done.set()
        watcher.join()
    assert process.returncode == 0, told
    peaks.pop(process.pid, None)
    others = tuple(sorted((kib / 1024 for kib in peaks.values()), reverse=True))
    seconds, peak = printed.split()
    return Run(seconds=float(seconds), peak_mb=int(peak) / 1024, others_mb=others)


def watch(session: int, peaks: dict[int, int], done: threading.Event) -> None:
    """Note down the peak resident set, in KiB, of every process of a session until ``done``."""
    while not done.wait(POLL_S):
        for pid in members(session):
            try:
                status = Path(f"/proc/{pid}/status").read_text()
            except OSError:
                continue
            for line in status.splitlines():
                if line.startswith("VmHWM"):
                    peaks[pid] = int(line.split()[1])


def members(session: int) -> Iterator[int]:
    """The processes of a session, where there is a /proc to see them in."""
    if not os.path.isdir("/proc"):  # noqa: PTH112  fifty times a second, beside what is measured
        return
    for name in os.listdir("/proc"):  # noqa: PTH208  as above
        try:
            if name.isdecimal() and os.getsid(int(name)) == session:
                yield int(name)
        except OSError:
            continue


def interleaved(contestants: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, list[float]]:
    """Seconds of every contestant, in turns, so that a busy moment hits them all."""
    times: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(repeats):
        for name, act in contestants.items():
            start = time.perf_counter()
            act()
            times[name].append(time.perf_counter() - start)
    return times


def ratio(these: list[float], those: list[float]) -> tuple[str, float]:
    """The median of the ratios of repetitions side by side, as text with its range, and as a number."""
    ratios = [a / b for a, b in zip(these, those, strict=True)]
    return f"{median(ratios):.2f} × ({min(ratios):.2f} … {max(ratios):.2f})", median(ratios)


def row(
    what: str,
    shown: str,
    measured: float | None = None,
    *,
    at_most: float | None = None,
    at_least: float | None = None,
) -> None:
    """One line of the table; one with a goal says whether it is met."""
    verdict = ""
    if measured is not None and at_most is not None:
        verdict = f"at most {at_most:g}: {'met' if measured <= at_most else 'MISSED'}"
    elif measured is not None and at_least is not None:
        verdict = f"at least {at_least:g}: {'met' if measured >= at_least else 'MISSED'}"
    print(f"  {what:54} {shown:>24}  {verdict}".rstrip(), flush=True)


def measure(sizes: Sizes) -> None:
    """Write the corpora, read them once, and print everything."""
    print(f"Python {platform.python_version()}, {os.cpu_count()} cores, {platform.system()}", end="")
    print(f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "")
    with tempfile.TemporaryDirectory(prefix="calibrary-bench-") as name:
        folders = {images: Path(name) / str(images) for images in (sizes.pool, sizes.many)}
        start = time.perf_counter()
        paths = {
            images: write_corpus(folder, images, distinct=DISTINCT) for images, folder in folders.items()
        }
        print(f"{sum(map(len, paths.values()))} frames written in {time.perf_counter() - start:.1f} s")
        few = paths[sizes.pool][: sizes.images]
        for listed in paths.values():
            # Behind these stand links to the same files.
            gather(listed[:DISTINCT], Path(name))
        cost_per_image(few, Path(name), sizes.repeats)
        bytes_read(few)
        two_workers(folders[sizes.pool], sizes.pool, sizes.repeats)
        memory(folders)


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(description="What the gate costs, as ratios from one run.")
    parser.add_argument("--quick", action="store_true", help="a small run, to see that everything runs")
    parser.add_argument("--images", type=int, metavar="N", help="for the cost of one image")
    parser.add_argument("--pool", type=int, metavar="N", help="for two workers against one")
    parser.add_argument("--many", type=int, metavar="N", help="for memory")
    parser.add_argument("--repeats", type=int, metavar="R", help="of what is compared")
    arguments = parser.parse_args()
    base = QUICK if arguments.quick else FULL
    given = {name: getattr(arguments, name) or getattr(base, name) for name in Sizes.__slots__}
    if min(given.values()) < 1 or given["images"] > given["pool"]:
        parser.error("wanted numbers from 1 on, and no more --images than --pool")
    if arguments.quick:
        print("A quick run, to see that everything runs: too small for some of the goals.")
    measure(Sizes(**given))


if __name__ == "__main__":
    main()
