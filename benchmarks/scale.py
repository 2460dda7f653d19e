"""What reading heads over a network costs, and what very many images take in memory.

    python -m benchmarks.scale [--samples DIR] [--images N] [--table N]

* Requests and bytes of each image of a folder, as a server would be asked for them.
* Images a second, and CPU time an image, from a web server in another process of this machine: without latency, and
  with 20 ms of it, one at a time and 32 at a time.
* The most memory that the table of very many images takes, with the interpreter around it.

Nothing here fails on a slow machine.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from statistics import median

import numpy as np

from benchmarks.table import at_least, at_most, compared, show
from calibrary.errors import InputError
from calibrary.jobs.images import reading
from calibrary.jobs.images.accumulator import IdTable
from calibrary.jobs.images.folders import find_images
from calibrary.jobs.images.observation import Image
from calibrary.jobs.images.ranged import First, opened
from calibrary.jobs.images.reading import Unit
from calibrary.parsers.imagery.reader import read_source

ROOT = Path(__file__).resolve().parents[1]
SERVE = """\
import sys, time
sys.path.insert(0, sys.argv[1])
from tests.jobs.extract.fleet import DEWARP, P4R, picture
from tests.jobs.images.servers import site
from pathlib import Path
from tempfile import TemporaryDirectory
with TemporaryDirectory() as folder, site() as found:
    head = picture(Path(folder) / "a.jpg", dewarp=DEWARP, **P4R).read_bytes()
    found.files["a.jpg"] = head + bytes(4 << 20)
    found.delay_s = float(sys.argv[2])
    print(found.url, flush=True)
    sys.stdin.read()
"""
DELAY_S = 0.02
GET_USD, LIST_USD, VCPU_HOUR_USD = 0.4e-6, 5e-6, 0.04
"""List prices of S3 for a GET and for a LIST of 1000 keys; that of a processor is assumed."""
PIECE = 10_000


class Counted:
    """A file as a store of one, with the bytes of each request."""

    def __init__(self, path: Path) -> None:
        self._data = path.read_bytes()
        self.requests: list[int] = []

    def first(self, _key: str, size: int) -> First:
        """As of a store."""
        self.requests.append(min(size, len(self._data)))
        return First(self._data[:size], len(self._data), None)

    def part(self, _key: str, start: int, end: int, _version: str | None) -> bytes:
        """As of a store."""
        self.requests.append(end - start)
        return self._data[start:end]

    def listed(self, prefix: str) -> Iterator[str]:
        """As of a store."""
        yield prefix


def requests(folder: Path) -> None:
    """What each image of a folder takes."""
    counts, sizes = [], []
    for path in find_images(folder, recursive=True):
        store = Counted(path)
        with suppress(InputError), opened(store, "", path.name) as source:
            read_source(source)
        counts.append(len(store.requests))
        sizes.append(sum(store.requests))
        print(
            f"{counts[-1]:3} requests {sizes[-1] / 1024:7.0f} kB of {path.stat().st_size / 1024:7.0f}  {path.name}"
        )
    if counts:
        at_most("requests of an image, median", median(counts), "requests", 3.0)
        at_most("bytes of an image, median", median(sizes) / 1024, "kB", 130.0)
        at_most("requests of an image, most", max(counts), "requests", 8.0)


@contextmanager
def served(delay_s: float, program: str = SERVE) -> Iterator[str]:
    """A web server in another process."""
    command = [sys.executable, "-W", "ignore", "-c", program, str(ROOT), str(delay_s)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as server:
        assert server.stdout is not None
        yield server.stdout.readline().strip()


def network(count: int) -> None:
    """Images a second from a web server."""
    rates: list[float] = []
    for delay_s, at_once, images in ((0.0, 32, count), (DELAY_S, 1, count // 10), (DELAY_S, 32, count)):
        reading.AT_ONCE = at_once
        with served(delay_s) as url:
            unit = Unit(tuple(Image(str(n), f"{url}/a.jpg?{n}") for n in range(images)))
            wall, cpu = time.perf_counter(), time.process_time()
            reading.read_unit(unit, question=reading.Question())
            wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        latency = f"web server, {delay_s * 1000:.0f} ms of latency, {at_once} at a time (clock)"
        rates.append(images / wall)
        if delay_s:
            show(latency, f"{rates[-1]:.0f} images/s")
        else:
            at_least("web server on this machine, of the processor", images / cpu, "images/s", 500.0)
            parts = (1e9 * GET_USD, 1e6 * LIST_USD, 1e9 * cpu / images / 3600 * VCPU_HOUR_USD)
            said = " + ".join(f"${part:.0f}" for part in parts)
            show("  10⁹ images, one request each: GET, LIST, processor", f"{said} = ${sum(parts):.0f}")
    one, many = rates[1:]
    compared(
        "  one image at a time against 32",
        [1 / many],
        [1 / one],
        scale=1e3,
        unit="ms",
        name="one",
        least=10.0,
    )


def memory(count: int) -> None:
    """The most that the table of so many images takes."""
    random, table = np.random.default_rng(1), IdTable()
    for _ in range(count // PIECE):
        packed = np.frombuffer(random.bytes(16 * PIECE), dtype=np.uint8).reshape(PIECE, 16).copy()
        packed[:, 12] %= 50
        packed[:, 13:] = 0
        table.merge(IdTable.from_bytes(packed.tobytes()), [*range(50)])
    counted, _ = table.counts([*range(50)])
    status = Path("/proc/self/status")
    peak = [line.split()[1] for line in status.read_text().splitlines() if line.startswith("VmHWM")]
    at_most(f"memory of the table of {counted.sum()} images", int(peak[0]) / 1024, "MB", 300.0)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--samples", type=Path, help="a folder of images whose requests are counted")
    parser.add_argument("--images", type=int, default=1000, help="read from the web server (default: 1000)")
    parser.add_argument(
        "--table", type=int, default=1_000_000, help="images in the table (default: 1 000 000)"
    )
    arguments = parser.parse_args()
    memory(arguments.table)
    if arguments.samples is not None:
        requests(arguments.samples)
    if arguments.images:
        network(arguments.images)


if __name__ == "__main__":
    main()
