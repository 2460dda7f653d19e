"""What ``extract`` costs: an image, a flight, a fleet of many cameras.

    python -m benchmarks.extract [--quick] [--images N] [--many N] [--cameras N] [--repeats R]

On the corpus of :mod:`benchmarks.corpus` in a temporary folder: 20-megapixel frames with 60 kB of metadata each. Beside
it run the minimal function of the document the project was created from, which reads two numbers of an image, and
exiftool. The page cache is warm where nothing else is said: a first pass reads every file.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import exifread
from PIL import Image as Picture

from benchmarks.corpus import forgotten, write_corpus
from benchmarks.table import Cost, at_most, compared, cost_of, in_turns, machine, show
from calibrary.evidence.context import Scene
from calibrary.evidence.identity import camera_key
from calibrary.evidence.weighing import evidence_of
from calibrary.jobs.extract.knowledge import Knowledge
from calibrary.jobs.images.observation import Image
from calibrary.jobs.images.reading import Question, Unit, read_unit
from calibrary.parsers.imagery import read_metadata
from calibrary.parsers.imagery.reader import read_source
from calibrary.parsers.imagery.source import open_source

GATE = """\
import resource, sys
from pathlib import Path
from calibrary.__main__ import main

code = main()
status = Path("/proc/self/status")
if status.exists():
    [peak] = [line.split()[1] for line in status.read_text().splitlines() if line.startswith("VmHWM")]
else:
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // (1024 if sys.platform == "darwin" else 1)
print(peak, file=sys.stderr)
sys.exit(code)
"""
"""The whole command, and then the most memory its process ever held, in KiB.

Not ru_maxrss where there is better: Linux counts into it what the process that started this one held.
"""

SENSOR_MM = (13.2, 8.8)
BARE_BYTES = 128 * 1024
DISTINCT = 2000
VARIOUS = 514
SHARED = 0.9
"""Of what a second process brings to plain arithmetic: 1.8 × where two cores are idle."""
Contestants = Mapping[str, Callable[[], object]]
NO_OTHERS: Contestants = {}


@dataclass(frozen=True, slots=True)
class Sizes:
    """How much of everything is done."""

    images: int
    many: int
    cameras: int
    repeats: int


QUICK = Sizes(images=1000, many=10_000, cameras=5000, repeats=3)
FULL = Sizes(images=1000, many=100_000, cameras=5000, repeats=7)


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


def bare(paths: Sequence[Path]) -> None:
    """Only open every file, and read its beginning."""
    for path in paths:
        with path.open("rb", buffering=0) as file:
            file.read(BARE_BYTES)


def one_image(paths: Sequence[Path], repeats: int) -> None:
    """What an image costs, in one process."""
    knowledge = Knowledge.load(None)
    unit = Unit(tuple(Image(path.name, str(path)) for path in paths))
    times = in_turns(
        {
            "read": lambda: read_unit(unit, question=Question()),
            "bare": lambda: bare(paths),
            "minimal": lambda: [minimal(path) for path in paths],
            "full": lambda: [full(path, knowledge) for path in paths],
        },
        repeats,
    )
    cpu = {name: [cost.cpu_s / len(paths) for cost in costs] for name, costs in times.items()}
    at_most("evidence of one local image", median(cpu["read"]) * 1e3, "ms", 0.3)
    compared("  the same", cpu["read"], cpu["bare"], scale=1e3, unit="ms", name="bare read of 128 kB")
    compared(
        "evidence and every estimate of one image, nothing shared",
        cpu["full"], cpu["minimal"], scale=1e3, unit="ms", name="the document's function", most=1.5,
    )  # fmt: skip


def beside_exiftool(
    what: str,
    folder: Path,
    paths: Sequence[Path],
    repeats: int,
    *,
    least: float,
    others: Contestants = NO_OTHERS,
) -> dict[str, list[Cost]]:
    """What the whole command costs, its start included, and what others cost in the same turns."""
    contestants: dict[str, Callable[[], object]] = {"one": lambda: gate(folder, "--workers", "1"), **others}
    exiftool = shutil.which("exiftool")
    if exiftool is not None:
        contestants["exiftool"] = lambda: run_exiftool(exiftool, paths)
    times = in_turns(contestants, repeats)
    cpu = {name: [cost.cpu_s for cost in costs] for name, costs in times.items()}
    if exiftool is None:
        show(what, f"{median(cpu['one']):.3g} s", "exiftool is not installed", limit=f"≥ {least:g} ×")
    else:
        compared(what, cpu["one"], cpu["exiftool"], scale=1, unit="s", name="exiftool -fast2", least=least)
    return times


def one_flight(folder: Path, paths: Sequence[Path], repeats: int) -> None:
    """A flight of one camera, the disk's cache warm and empty."""
    what, others = f"extract, {len(paths)} images", {"cold": lambda: cold(folder, paths)}
    times = beside_exiftool(f"{what}, one worker", folder, paths, repeats, least=20.0, others=others)
    wall = {name: median(cost.wall_s for cost in costs) for name, costs in times.items()}
    cold_cpu = median(cost.cpu_s for cost in times["cold"])
    show(
        f"{what}, the disk's cache empty",
        f"{wall['cold']:.3g} s of the clock, {cold_cpu:.3g} s of the processor",
        f"{wall['one']:.3g} s of the clock (cache warm)",
        ratio=f"{wall['cold'] / wall['one']:.3g} ×",
    )


def cold(folder: Path, paths: Sequence[Path]) -> None:
    """The same, every byte of every file from the disk."""
    forgotten(paths)
    gate(folder, "--workers", "1")


def two_workers(folder: Path, images: int, repeats: int) -> None:
    """What a second process brings: time of the clock, which means something on an idle machine only."""
    times = in_turns(
        {
            "one": lambda: gate(folder, "--workers", "1"),
            "two": lambda: gate(folder, "--workers", "2"),
            "sums by one": lambda: sums(1),
            "sums by two": lambda: sums(2),
        },
        repeats,
    )
    wall = {name: [cost.wall_s for cost in costs] for name, costs in times.items()}
    gain = median(one / two for one, two in zip(wall["sums by one"], wall["sums by two"], strict=True))
    show("what a second process brings here at all: sums (clock)", f"{gain:.3g} ×")
    compared(
        f"extract, {images} images, two workers (clock)",
        wall["two"], wall["one"], scale=1, unit="s", name="one worker", least=round(SHARED * gain, 2),
    )  # fmt: skip


def sums(processes: int) -> None:
    """Arithmetic, shared out evenly: what two cores that do nothing else do twice as fast."""
    command = [sys.executable, "-c", f"sum(n * n for n in range({20_000_000 // processes}))"]
    started = [subprocess.Popen(command) for _ in range(processes)]
    assert not any(process.wait() for process in started)


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
    at_most(f"bytes read of a file of {paths[0].stat().st_size / 1e6:.0f} MB", max(taken) / 1e3, "kB", 256.0)


def memory(folder: Path, what: str, limit_mb: float) -> None:
    """The most that the command itself holds, its report printed as JSON."""
    peaks: list[float] = []
    cost = cost_of(lambda: peaks.append(gate(folder, "--workers", "1", "--json")))
    at_most(f"extract --json, {what}: memory", peaks[0], "MB", limit_mb)
    show(f"extract --json, {what}", f"{cost.cpu_s:.3g} s")


def gate(folder: Path, *flags: str) -> float:
    """Run ``calibrary extract`` in a process of its own; returns the most memory it held, in MB."""
    with tempfile.TemporaryDirectory() as out:
        command = [sys.executable, "-c", GATE, "extract", str(folder), "--recursive", *flags]
        command += ["--output-matrix", str(Path(out) / "K_matrix.npy")]
        done = subprocess.run(
            command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False
        )
    # 1: some camera has no valid K, as the made-up ones.
    assert done.returncode in {0, 1}, done.stderr
    return int(done.stderr.split()[-1]) / 1024


def measure(sizes: Sizes) -> None:
    """Write the corpora, then everything."""
    with tempfile.TemporaryDirectory(prefix="calibrary-bench-") as name:
        few, many, fleet = (Path(name) / part for part in ("few", "many", "fleet"))
        paths = write_corpus(few, sizes.images, distinct=sizes.images)
        bare(paths)
        one_image(paths, sizes.repeats)
        bytes_read(paths)
        one_flight(few, paths, sizes.repeats)
        various = Path(name) / "various"
        paths = write_corpus(various, sizes.images, distinct=sizes.images, cameras=VARIOUS)
        bare(paths)
        what = f"extract, {len(paths)} images of {VARIOUS} cameras, one worker"
        times = beside_exiftool(what, various, paths, sizes.repeats, least=15.0)
        each_s = median(cost.cpu_s for cost in times["one"]) / len(paths)
        at_most("  each file, its camera's share included", each_s * 1e3, "ms", 5.0)
        bare(write_corpus(many, sizes.many, distinct=DISTINCT)[:DISTINCT])
        two_workers(many, sizes.many, sizes.repeats)
        memory(many, f"{sizes.many} images", 200.0)
        write_corpus(fleet, sizes.cameras, distinct=sizes.cameras, cameras=sizes.cameras)
        memory(fleet, f"{sizes.cameras} cameras", 200.0)


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(description="What extract costs.")
    parser.add_argument("--quick", action="store_true", help="fewer images and repetitions")
    parser.add_argument("--images", type=int, metavar="N", help="for the cost of one image and of a flight")
    parser.add_argument("--many", type=int, metavar="N", help="for two workers against one, and for memory")
    parser.add_argument("--cameras", type=int, metavar="N", help="distinct ones, for memory")
    parser.add_argument("--repeats", type=int, metavar="R", help="of what is compared")
    arguments = parser.parse_args()
    base = QUICK if arguments.quick else FULL
    given = {name: getattr(arguments, name) or getattr(base, name) for name in Sizes.__slots__}
    if min(given.values()) < 1:
        parser.error("wanted numbers from 1 on")
    print(machine())
    measure(Sizes(**given))


if __name__ == "__main__":
    main()
