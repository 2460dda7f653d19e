"""What publishing a registry costs, and what cameras cost that are resolved from a static server.

    python -m benchmarks.publish [--quick] [--entries N ...] [--resolves R]

Registries of N entries of as many models (5 000 and 100 000): writing all files, and again after one entry has changed;
the largest file; requests and bytes of a camera for a reader who has nothing (cold), those of another camera (warm), or
all (kept). Then R cameras are resolved over HTTP, from the cache on the disk, and from memory, beside a peer that only
fetches the same files and parses them as JSON: with urllib, a connection each, and over one open connection. Everything
is processor time, user and system, of the reading process alone. The server is a process of its own: nginx where it is
installed, else Python's. Nothing fails on a slow machine; the goal is met or missed, and that is printed.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from http.client import HTTPConnection
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from multiprocessing.connection import Connection
from pathlib import Path
from time import process_time
from urllib.parse import urlsplit
from urllib.request import urlopen

from benchmarks.registry_entries import approving, entry, fill, key_of
from benchmarks.table import machine, row, show
from calibrary import open_registry
from calibrary.calibration import CameraKey
from calibrary.records import replace
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.git.repository import create
from calibrary.registry.git.writing import FileChange, write
from calibrary.registry.published.cache import Cache
from calibrary.registry.published.fetch import fetch
from calibrary.registry.published.read import Published
from calibrary.registry.published.write import publish
from calibrary.registry.registry import open_snapshot

GOAL_PER_S = 1000.0


def registry_of(folder: Path, count: int) -> Path:
    """A registry of so many entries, in one commit."""
    repo = create(folder, durable=False)
    fill(repo, range(count))
    return folder


def change_one(folder: Path) -> None:
    """Calibrate one camera anew."""
    one = entry(0)
    K = one.calibration.intrinsics
    moved = replace(one, calibration=replace(one.calibration, intrinsics=replace(K, fx=K.fx + 1.0)))
    snapshot = open_snapshot(folder)
    repo, _ = snapshot.require_git("is needed")
    changed = FileChange(path=one.path, data=entry_yaml(moved), base=snapshot.paths[one.path])
    write(repo, [changed, *approving(snapshot, moved)], "Again\n")


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


def cpu_s() -> float:
    """Processor time of this process and of those that it has ended, in the clock's hundredths of a second."""
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


def measure(count: int, resolves: int) -> None:
    """One size, printed."""
    with tempfile.TemporaryDirectory(prefix="calibrary-bench-") as name:
        folder = Path(name)
        fleet, out = registry_of(folder / "fleet", count), folder / "out"
        spent = []
        for what in ("all of it", "again after one change"):
            start = cpu_s()
            done = publish(open_snapshot(fleet), out)
            spent.append(cpu_s() - start)
            row(f"publish {count} entries, {what}, {done.written} files written", f"{spent[-1]:.2f} s")
            change_one(fleet)
        row("  again takes, of all of it", f"{spent[1] / spent[0]:.3f} ×", spent[1] / spent[0], at_most=0.1)
        sizes = [path.stat().st_size for path in out.rglob("*.json")]
        row(
            f"files: {len(sizes)}; the largest, the list",
            f"{max(sizes)} bytes, {max(sizes) / count:.0f} each",
        )
        with serving(out) as url:
            _lookups(url, folder, count)
            _rates(url, folder, count, resolves)


class Counted:
    """Fetches files as :func:`~calibrary.registry.published.fetch.fetch` does, and notes each with its length."""

    def __init__(self) -> None:
        self.files: list[tuple[str, int]] = []

    def __call__(self, url: str, *, most: int, fresh: bool = False) -> bytes:
        """One file."""
        data = fetch(url, most=most, fresh=fresh)
        self.files.append((url, len(data)))
        return data


def _lookups(url: str, folder: Path, count: int) -> None:
    """How many files and bytes a camera costs."""
    for what, number, most in (("cold", 1, 3), ("kept", 1, 1), ("warm, another camera", count // 2, 2)):
        counted = Counted()
        registry = Published(url, cache=Cache(folder / "cache"), fetch=counted)
        assert registry.index_for(key_of(number)).resolve(key_of(number))
        files = counted.files
        printed = f"{len(files)} requests, {sum(size for _, size in files)} bytes"
        row(f"a camera of {count}, {what}", printed, len(files), at_most=most)


def _rates(url: str, folder: Path, count: int, resolves: int) -> None:
    keys = [key_of(number * max(1, count // resolves) % count) for number in range(resolves)]
    counted = Counted()
    ours = _cpu_each(Published(url, cache=Cache(folder / "rate"), fetch=counted), keys)
    places = [place for place, _ in counted.files]
    peers = {"urllib": _with_urllib, "one connection, http.client": _with_one_connection}
    row("resolve over HTTP, CPU", f"{ours * 1e6:.0f} µs, {1 / ours:.0f} /s", 1 / ours, at_least=GOAL_PER_S)
    for name, act in peers.items():
        start = process_time()
        act(places)
        peer = (process_time() - start) / resolves
        limit = 1.0 if name == "urllib" else None
        show(
            f"  beside fetching the same {len(places)} files",
            f"{ours * 1e6:.0f} µs",
            f"{peer * 1e6:.0f} µs ({name})",
            ratio=f"{ours / peer:.2f} ×",
            limit=f"≤ {limit:g} ×" if limit is not None else "",
            met=ours <= limit * peer if limit is not None else None,
        )
    again = Published(url, cache=Cache(folder / "rate"))
    each = _cpu_each(again, keys)
    row(
        "resolve from the cache on the disk, CPU",
        f"{each * 1e6:.0f} µs, {1 / each:.0f} /s",
        1 / each,
        at_least=GOAL_PER_S,
    )
    fleet = open_registry(url)
    for key in keys:
        fleet.resolve(key)
    start = process_time()
    for key in keys:
        fleet.resolve(key)
    each = (process_time() - start) / len(keys)
    row(
        "Fleet.resolve from memory, CPU", f"{each * 1e6:.0f} µs, {1 / each:.0f} /s", 1 / each, at_least=10_000
    )


def _cpu_each(registry: Published, keys: Sequence[CameraKey]) -> float:
    start = process_time()
    for key in keys:
        assert registry.index_for(key).resolve(key)
    return (process_time() - start) / len(keys)


def _with_urllib(places: Sequence[str]) -> None:
    for place in places:
        with urlopen(place, timeout=10) as answer:  # noqa: S310  our own server
            json.load(answer)


def _with_one_connection(places: Sequence[str]) -> None:
    connection = HTTPConnection(urlsplit(places[0]).netloc, timeout=10)
    for place in places:
        connection.request("GET", urlsplit(place).path)
        json.loads(connection.getresponse().read())
    connection.close()


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="a small run, to see that everything runs")
    parser.add_argument("--entries", type=int, nargs="+", default=[5000, 100_000])
    parser.add_argument("--resolves", type=int, default=1000)
    given = parser.parse_args()
    print(machine())
    for size in [300] if given.quick else given.entries:
        measure(size, min(100 if given.quick else given.resolves, size))


if __name__ == "__main__":
    main()
