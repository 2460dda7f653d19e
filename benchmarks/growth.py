"""How cost grows with number: of images, cameras, entries of a registry; a bucket, and a cluster that loses a worker.

    python -m benchmarks.growth PART … [--most N]

Numbers are tenfold from one to the next, and the last row of each is the exponent between the last two: 1 is in
proportion. What a command takes for its start is subtracted where even the smaller number takes twice as long.

* ``images``: ``extract`` of one camera. ``cameras``: of one camera for every ten images.
* ``registry``: a check that knows no entry from before; list, check and resolve once it does.
* ``table``: the most memory for the images of one run.
* ``bucket``: so many objects of an S3 server that takes 20 ms for each request.
* ``cluster``: two workers of Dask, one of which is killed, and whether the result is that of one process.

Nothing here fails on a slow machine.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from functools import partial
from importlib import import_module
from math import log10
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory

from benchmarks import registry_entries
from benchmarks.corpus import write_corpus
from benchmarks.extract import bare, gate
from benchmarks.scale import DELAY_S, ROOT, served
from benchmarks.table import SEPARATOR, at_most, cost_of, machine, show
from calibrary import open_registry
from calibrary.jobs.extract.run import run
from calibrary.jobs.images import reading
from calibrary.jobs.images.listing import Listing

S3 = """\
import socket, sys, threading, time
sys.path.insert(0, sys.argv[1])
from tests.jobs.extract.fleet import DEWARP, P4R, picture
from moto.s3.models import s3_backends
from moto.server import DomainDispatcherApplication, create_backend_app
from werkzeug.serving import make_server
from pathlib import Path
from tempfile import TemporaryDirectory
with TemporaryDirectory() as folder:
    head = picture(Path(folder) / "a.jpg", dewarp=DEWARP, **P4R).read_bytes() + bytes(64 << 10)
store = s3_backends["123456789012"]["aws"]
store.create_bucket("fleet", "us-east-1")
for n in range({count}):
    store.put_object("fleet", f"{{n:06}}.jpg", head)
app = DomainDispatcherApplication(create_backend_app)
def slow(environ, start):
    time.sleep(float(sys.argv[2]))
    return app(environ, start)
import logging
logging.getLogger("werkzeug").setLevel(logging.ERROR)
server = make_server("127.0.0.1", 0, slow, threaded=True)
threading.Thread(target=server.serve_forever, daemon=True).start()
print(f"http://127.0.0.1:{{server.server_port}}", flush=True)
sys.stdin.read()
"""
"""What such a server is, as a program."""


def grows(
    measure: str, least: int, most: int, cost: Callable[[int], float], unit: str = "s", start: float = 0.0
) -> None:
    """Rows of the cost of numbers, and how the last tenfold grew."""
    costs = []
    while least <= most:
        costs.append(cost(least))
        show(f"{measure}: {least}", f"{costs[-1]:.3g} {unit}")
        least *= 10
    if len(costs) > 1:
        begun = start if costs[-2] > 2 * start else 0.0
        before, after = (one - begun for one in costs[-2:])
        at_most(f"{measure}: exponent of growth", log10(after / before), "", 1.05)


def least_cpu_s(act: Callable[[], object], repeats: int = 2) -> float:
    """Seconds of the processor, the processes that it starts included."""
    return min(cost_of(act).cpu_s for _ in range(repeats))


def of_images(most: int, per_camera: int | None) -> None:
    """Whole runs of extract by the number of images: of one camera, or of as many as there are tens."""
    with TemporaryDirectory(prefix="calibrary-bench-") as name:

        def cost(images: int) -> float:
            folder, cameras = Path(name, str(images)), max(images // (per_camera or images), 1)
            paths = write_corpus(folder, images, distinct=max(cameras, 2000), cameras=cameras)
            bare(paths)
            spent = least_cpu_s(lambda: gate(folder, "--workers", "1"))
            rmtree(folder)
            return spent

        of = "one camera" if per_camera is None else f"cameras, {per_camera} of each"
        what = f"extract, images of {of}"
        grows(what, 1000, most, cost, start=cost(1))


def of_registry(most: int) -> None:
    """Commands on a registry whose index is built, and a key resolved in a process that is up, by entries."""
    acts = {
        "list": ("list",),
        "check": ("check",),
        "resolve": ("resolve", "--make", "Make 01", "--model", "MODEL-000001"),
    }
    spent: dict[tuple[str, int], float] = {}

    def measured(entries: int) -> None:
        with TemporaryDirectory(prefix="calibrary-bench-") as name:
            snapshot = registry_entries.registry_of(Path(name, "registry"), entries)
            run = partial(registry_entries.command, snapshot.place)
            spent["index built and every entry checked", entries] = least_cpu_s(run("check"), 1)
            for what, words in acts.items():
                spent[what, entries] = least_cpu_s(run(*words))
            fleet = open_registry(snapshot.place)
            keys = [registry_entries.key_of(n) for n in range(0, entries, max(entries // 500, 1))]
            fleet.resolve(keys[0])
            first = least_cpu_s(lambda: [fleet.resolve(key) for key in keys], 1)
            spent["Fleet.resolve of another camera, each", entries] = first / len(keys)

    with registry_entries.nobody():
        # Twice the smallest: the first commands are those for which Python compiles its modules.
        for entries in (2, 2, *(10**power for power in range(4, 7) if 10**power <= most)):
            measured(entries)
            print(f"{entries} entries measured, load {os.getloadavg()[0]:.1f}", file=sys.stderr)
    for what in dict.fromkeys(what for what, _ in spent):
        cost = {entries: seconds for (name, entries), seconds in spent.items() if name == what}
        grows(f"registry, {what}", 10_000, most, cost.__getitem__, start=cost[2])


def of_table(most: int) -> None:
    """The most memory that the table takes, each size in a process of its own."""

    def peak(count: int) -> float:
        command = [sys.executable, "-m", "benchmarks.scale", "--table", str(count), "--images", "0"]
        printed = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
        return float(printed.split(SEPARATOR)[1].split()[0])

    grows("memory of the table, images", 100_000, most, peak, "MB")


def bucket(count: int) -> None:
    """A whole prefix from an S3 server that takes 20 ms for each request."""
    with served(DELAY_S, S3.format(count=count)) as url:
        keys = {
            "AWS_ENDPOINT_URL": url,
            "AWS_REGION": "us-east-1",
            "AWS_ACCESS_KEY_ID": "a",
            "AWS_SECRET_ACCESS_KEY": "b",
        }
        os.environ.update(keys)
        found = []
        cost = cost_of(lambda: found.append(run("s3://fleet/", workers=1)))
    assert found[0].images == count
    show(
        f"extract s3://, {count} objects, {DELAY_S * 1000:.0f} ms for each request (clock)",
        f"{cost.wall_s:.3g} s",
    )
    show("  the same, of the processor", f"{cost.cpu_s:.3g} s, {cost.cpu_s / count * 1e3:.3g} ms an image")


def cluster(count: int) -> None:
    """Two workers, of which one is killed after its first piece, beside one process."""
    distributed = import_module("distributed")
    with TemporaryDirectory(prefix="calibrary-bench-") as name:
        write_corpus(Path(name), count)
        found = []

        def read(engine: reading.Engine, progress: Callable[[int], None] | None = None) -> None:
            images = Listing([Path(name)], recursive=True)
            found.append(reading.read_images(images, engine=engine, batch=count // 20, progress=progress))

        read(reading.here(1, known=count))
        alone = found[0].images.to_bytes()
        with (
            distributed.LocalCluster(
                n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
            ) as dask,
            distributed.Client(dask, set_as_default=False) as client,
        ):
            killed: list[int] = []

            def kill(_: int) -> None:
                if not killed:
                    killed.append(next(iter(client.run(os.getpid).values())))
                    os.kill(killed[0], signal.SIGKILL)

            whole = cost_of(lambda: read(reading.on_cluster(client))).wall_s
            hurt = cost_of(lambda: read(reading.on_cluster(client), kill)).wall_s
    same = "the same" if all(one.images.to_bytes() == alone for one in found) else "ANOTHER RESULT"
    show(f"two workers of Dask, {count} images (clock)", f"{whole:.3g} s")
    show(
        "  one of them killed (clock)",
        f"{hurt:.3g} s, {same}, {found[-1].lost} images lost",
        met=same == "the same",
    )


PARTS: dict[str, tuple[int, Callable[[int], None]]] = {
    "images": (100_000, lambda most: of_images(most, None)),
    "cameras": (100_000, lambda most: of_images(most, 10)),
    "registry": (100_000, of_registry),
    "table": (10_000_000, of_table),
    "bucket": (5000, bucket),
    "cluster": (20_000, cluster),
}
"""By part: the most of it, and what measures it."""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("parts", nargs="+", choices=PARTS, metavar="PART", help=", ".join(PARTS))
    parser.add_argument("--most", type=int, metavar="N", help="where each ends (default: by part)")
    arguments = parser.parse_args()
    for part in arguments.parts:
        most, act = PARTS[part]
        act(arguments.most or most)
        print(machine(), file=sys.stderr)


if __name__ == "__main__":
    main()
