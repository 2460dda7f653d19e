"""What publishing a registry costs, and how many cameras are resolved from a static server.

    python benchmarks/publish.py [--entries N ...] [--resolves R] [--threads T]

Registries of N entries of as many models (10 000 and 100 000): writing all files, writing them again after one entry
has changed, the largest file, and how many files a camera costs a reader who has none (cold), all (kept), or those of
another camera (warm). Then R cameras are asked from T threads of one process, over HTTP from a server of another
process that gives out the folder: nginx where it is installed, else Python's own, which is the slower part then. The
goal is 1 000 a second. Nothing fails on a slow machine; the goal is met or missed, and that is printed.
"""

from __future__ import annotations

import argparse
import multiprocessing
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from multiprocessing.connection import Connection
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING

from calibrary.calibration import CameraKey
from calibrary.records import replace
from calibrary.registry.configuration import configuration_yaml
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.git.maintenance import create
from calibrary.registry.git.writing import Change, write
from calibrary.registry.published import fetch as transport
from calibrary.registry.published import read
from calibrary.registry.published.cache import Cache
from calibrary.registry.published.read import Published
from calibrary.registry.published.write import publish
from calibrary.registry.reader import open_snapshot
from calibrary.registry.resolution import Resolution

if TYPE_CHECKING:
    from benchmarks.registry_entries import entry, key_of
else:
    # A program's own folder is where Python looks first.
    from registry_entries import entry, key_of

GOAL_PER_S = 1000.0


def registry_of(folder: Path, count: int) -> Path:
    """A registry of so many entries, in one commit."""
    repo = create(folder, durable=False)
    changes = [Change(path="registry.yaml", data=configuration_yaml(), base=None)]
    changes += [Change(path=one.path, data=entry_yaml(one), base=None) for one in map(entry, range(count))]
    write(repo, changes, "Import\n")
    return folder


def change_one(folder: Path) -> None:
    """Calibrate one camera anew."""
    one = entry(0)
    K = one.calibration.intrinsics
    moved = replace(one, calibration=replace(one.calibration, intrinsics=replace(K, fx=K.fx + 1.0)))
    snapshot = open_snapshot(folder)
    repo, _ = snapshot.require_git("is needed")
    write(repo, [Change(path=one.path, data=entry_yaml(moved), base=snapshot.paths[one.path])], "Again\n")


@contextmanager
def serving(folder: Path) -> Iterator[str]:
    """The folder on the web by another process; its address."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=_serve, args=(folder, theirs), daemon=True)
    process.start()
    try:
        yield f"http://127.0.0.1:{ours.recv()}/"
    finally:
        process.kill()
        process.join()


class _Quiet(SimpleHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    # It writes head and body by themselves, and would wait between the two on a connection that stays open.
    disable_nagle_algorithm = True

    def log_message(self, *_: object) -> None:
        """Say nothing."""


def _serve(folder: Path, pipe: Connection) -> None:
    nginx = shutil.which("nginx")
    if nginx is None:
        with ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=str(folder))) as server:
            pipe.send(server.server_port)
            server.serve_forever()
    else:
        port = 18_473
        configuration = (
            f"daemon off; pid {folder}/.nginx.pid; error_log /dev/null; events {{}} http {{ access_log off; "
            f"server {{ listen 127.0.0.1:{port}; root {folder}; }} }}"
        )
        place = folder / ".nginx.conf"
        place.write_text(configuration)
        pipe.send(port)
        subprocess.run([nginx, "-c", str(place)], check=True)


def measure(count: int, resolves: int, threads: int) -> None:
    """One size, printed."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        fleet, out = registry_of(folder / "fleet", count), folder / "out"
        for what in ("all of it", "again after one change"):
            start = perf_counter()
            done = publish(open_snapshot(fleet), out)
            print(
                f"{count:>9,} entries  {what:<24}{perf_counter() - start:8.1f} s  {done.written:>9,} files written"
            )
            change_one(fleet)
        files = [path for path in out.rglob("*.json") if path.is_file()]
        print(
            f"{count:>9,} entries  {len(files):,} files, the largest {max(f.stat().st_size for f in files):,} bytes"
        )
        with serving(out) as url:
            _requests(url, folder, count)
            _rate(url, folder, count, resolves, threads)


def _requests(url: str, folder: Path, count: int) -> None:
    """How many files a camera costs."""
    asked = 0
    real = transport.fetch

    def counted(*arguments: object, **options: object) -> transport.Fetched:
        nonlocal asked
        asked += 1
        return real(*arguments, **options)  # type: ignore[arg-type]

    read.fetch = counted  # type: ignore[attr-defined]
    try:
        for what, number in (("cold", 1), ("kept", 1), ("warm, another camera", count // 2)):
            asked = 0
            assert (
                Published(url, cache=Cache(folder / "cache"))
                .index_for(key_of(number))
                .resolve(key_of(number))
            )
            print(f"{count:>9,} entries  {what:<24}{asked:8} requests")
    finally:
        read.fetch = real  # type: ignore[attr-defined]


def _rate(url: str, folder: Path, count: int, resolves: int, threads: int) -> None:
    keys = [key_of(number * max(1, count // resolves) % count) for number in range(resolves)]
    for what in ("each read over HTTP", "each from the cache"):
        registry = Published(url, cache=Cache(folder / "rate"))
        start = perf_counter()
        with ThreadPoolExecutor(threads) as pool:
            found = [*pool.map(partial(_resolved, registry), keys)]
        rate = resolves / (perf_counter() - start)
        assert all(found)
        verdict = "met" if rate >= GOAL_PER_S else f"missed ({GOAL_PER_S:g}/s)"
        print(f"{count:>9,} entries  {what:<24}{rate:8.0f} /s      goal {verdict}")


def _resolved(registry: Published, key: CameraKey) -> Resolution | None:
    return registry.index_for(key).resolve(key)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--entries", type=int, nargs="+", default=[10_000, 100_000])
    parser.add_argument("--resolves", type=int, default=2000)
    parser.add_argument("--threads", type=int, default=8)
    given = parser.parse_args()
    for size in given.entries:
        measure(size, min(given.resolves, size), given.threads)
