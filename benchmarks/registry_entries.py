"""What finding and checking entries costs, in registries of real entries of three sizes.

    python -m benchmarks.registry_entries [--quick] [--large] [--repeats R]

Registries of 1 000 and 10 000 entries (--large: 100 000 too), bare and packed; one camera in a hundred goes by another
name as well. A resolve ends with K at the image's size; a warm one is asked of a process that is up, a cold one is a
process from its start to its end, beside the least that any process could do: a git that prints the one file, and a
Python that imports nothing. Nothing here fails on a slow machine; a goal is met or missed, and that is printed.
"""

from __future__ import annotations

import argparse
import os
import platform
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from statistics import median
from time import perf_counter

from benchmarks.table import interleaved, ratio, row
from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance, Quality
from calibrary.distortion import BrownConrady
from calibrary.records import replace
from calibrary.registry.check_registry import check_all
from calibrary.registry.configuration import configuration_yaml
from calibrary.registry.entry import Alias, Entry, Status
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.git.commits import File, Person, Step, stream
from calibrary.registry.git.maintenance import create, maintain
from calibrary.registry.git.writing import Change, write
from calibrary.registry.index import index_at
from calibrary.registry.reader import open_snapshot
from calibrary.registry.snapshot import Snapshot

KEEPER = Person(name="Fleet Keeper", email="keeper@example.com")
MAKES = 20
NAMED_EVERY = 100
ASKED = 500
CHECKED_UP_TO = 10_000
SIZE = (5472, 3648)
FLAT = 2.0
"""How much slower a warm resolve may be in the largest registry than in the smallest; the rest is chance."""


@dataclass(frozen=True, slots=True)
class Sizes:
    """How much of everything is done."""

    entries: tuple[int, ...]
    repeats: int
    revisions: int = 5000


def key_of(number: int) -> CameraKey:
    """A camera as an image of half the size tells it."""
    return CameraKey(
        make=f"Make {number % MAKES:02d}", model=f"MODEL-{number:06d}", focal_mm=8.8, image_size=(2736, 1824)
    )


def entry(number: int) -> Entry:
    """An approved entry with everything that a calibration says of itself."""
    chance = random.Random(number)  # noqa: S311  the same numbers in every run
    f = chance.uniform(3000.0, 4500.0)
    calibration = Calibration(
        camera=replace(key_of(number), image_size=SIZE),
        intrinsics=Intrinsics(
            fx=f, fy=f * 1.0003, cx=2736 + chance.gauss(0, 9), cy=1824 + chance.gauss(0, 9), image_size=SIZE
        ),
        distortion=BrownConrady(k1=chance.gauss(0, 0.02), k2=0.01, p1=1e-4, p2=-1e-4, k3=0.0),
        grade=Grade.CALIBRATED,
        quality=Quality(rms_px=0.3, views=80, std={"fx": 0.4, "fy": 0.4, "cx": 0.3, "cy": 0.3}),
        provenance=Provenance(
            kind="calibration-file",
            source=f"{number}.xml",
            sha256=f"{number:064x}",
            tool="lab",
            date="2026-01-01",
        ),
    )
    named = (Alias(make="Other", model=f"NAME-{number}"),) if number % NAMED_EVERY == 0 else ()
    return Entry(calibration=calibration, status=Status.APPROVED, aliases=named)


def registry_of(folder: Path, entries: int) -> Snapshot:
    """A packed bare registry."""
    repo = create(folder, bare=True, durable=False)
    changes = [Change(path="registry.yaml", data=configuration_yaml())]
    changes += [Change(path=one.path, data=entry_yaml(one)) for one in map(entry, range(entries))]
    write(repo, changes, "Import\n")
    maintain(repo)
    repo.close()
    return open_snapshot(folder)


def warm(snapshot: Snapshot, entries: int) -> float:
    """Resolving in a process that is up; the seconds that one takes."""
    chance = random.Random(1)  # noqa: S311  the same numbers in every run
    keys = [key_of(chance.randrange(entries)) for _ in range(ASKED)]
    index = snapshot.index()
    assert index.resolve(keys[0]) is not None
    times: dict[str, list[float]] = {}
    for name in ("first", "again"):
        times[name] = []
        for key in keys:
            start = perf_counter()
            index.resolve(key)
            times[name].append(perf_counter() - start)
    others = [CameraKey(make="Other", model=f"NAME-{n}") for n in range(0, entries, NAMED_EVERY)][:ASKED]
    start = perf_counter()
    index.resolve(others[0])
    scan_s = perf_counter() - start
    by_name = []
    for key in others[1:]:
        start = perf_counter()
        assert index.resolve(key) is not None
        by_name.append(perf_counter() - start)
    print("\nResolve, warm: key to K at the image's size")
    again = median(times["again"])
    row("a camera that was asked for before", f"{again * 1e3:.3f} ms", again * 1e3, at_most=1.0)
    row("a camera for the first time, read and parsed", f"{median(times['first']) * 1e3:.3f} ms")
    row("by another name, for the first time", f"{median(by_name) * 1e3:.3f} ms")
    row("  before that once: looking for other names", f"{scan_s:.2f} s")
    return again


def cold(snapshot: Snapshot, entries: int, repeats: int) -> None:
    """Resolving as a process of its own."""
    folder, number = snapshot.place, entries // 2
    key, path = key_of(number), entry(number).path
    command = [
        sys.executable,
        "-m",
        "calibrary",
        "registry",
        "resolve",
        "--registry",
        str(folder),
        "--json",
    ]
    own = [*command, "--make", str(key.make), "--model", str(key.model)]
    named = [*command, "--make", "Other", "--model", "NAME-0"]
    cache = Path(os.environ["XDG_CACHE_HOME"])

    def forgetful() -> None:
        shutil.rmtree(cache, ignore_errors=True)
        process(own)

    def process(words: list[str]) -> None:
        subprocess.run(words, check=True, capture_output=True)

    contestants: dict[str, Callable[[], object]] = {
        "forgetful": forgetful,
        "named": lambda: process(named),
        "own": lambda: process(own),
        "version": lambda: process([sys.executable, "-m", "calibrary", "--version"]),
        "git": lambda: process(["git", "-C", str(folder), "show", f"HEAD:{path}"]),
        "python": lambda: process([sys.executable, "-c", "pass"]),
    }
    process(named)
    assert snapshot.repo is not None
    assert snapshot.commit is not None
    _ = index_at(snapshot.repo, snapshot.commit).files
    times = interleaved(contestants, repeats)
    # The turn of `named` comes right after the cache was thrown away: it looks through all entries.
    times["named again"] = interleaved({"named again": lambda: process(named)}, repeats)["named again"]
    print("\nResolve, cold: a process from start to end")
    row("ours, other names known from before", each_ms(times["own"]))
    row("ours, nothing known from before", each_ms(times["forgetful"]))
    row("ours, by another name, known from before", each_ms(times["named again"]))
    row("ours, by another name, nothing known from before", each_ms(times["named"]))
    row("calibrary --version", each_ms(times["version"]))
    row("git show HEAD:path", each_ms(times["git"]))
    row("python -c pass", each_ms(times["python"]))
    row("  ours takes, of calibrary --version", ratio(times["own"], times["version"])[0])


def check(snapshot: Snapshot, entries: int) -> None:
    """Everything that check says, of every entry."""
    start = perf_counter()
    done = check_all(snapshot)
    seconds = perf_counter() - start
    assert done.report.is_good
    assert done.report.entries == entries
    print("\nCheck of everything: schema, digest, path, policy, uncertainty, one against another")
    row("entries a second, one process", f"{entries / seconds:.0f} /s", entries / seconds, at_least=500.0)


def commands(snapshot: Snapshot, entries: int, repeats: int) -> None:
    """Whole commands, each a process of its own, in seconds of processor time, that of the git they start included."""
    folder, number = str(snapshot.place), entries // 2
    before = snapshot.commit
    changed = replace(entry(number), tolerance=0.01)
    assert snapshot.repo is not None
    blob = snapshot.repo.read(before or "", changed.path)
    change = Change(path=changed.path, data=entry_yaml(changed), base=blob.oid if blob is not None else None)
    write(snapshot.repo, [change], "Change one\n")
    asked = {
        "list WORD": (["list", f"{number:06d}"], 1.0),
        "show KEY": (["show", f"model-{number:06d}"], 1.0),
        "resolve": (
            ["resolve", "--make", str(key_of(number).make), "--model", str(key_of(number).model)],
            1.0,
        ),
        "check BASE..HEAD, one change": (["check", f"{before}..HEAD"], None),
    }
    if entries <= CHECKED_UP_TO:
        asked["list"] = (["list"], 2.0)
        asked["check"] = (["check"], None)
        asked["lock"] = (["lock", "--out", str(snapshot.place.parent / "all.lock")], None)
    print("\nCommands, the index known from before: seconds of processor time")
    for name, (words, goal) in asked.items():
        command = [sys.executable, "-m", "calibrary", "registry", *words, "--registry", folder]
        seconds = [cpu_s(command) for _ in range(repeats + 1)][1:]
        row(name, f"{median(seconds):.2f} s", median(seconds), at_most=goal)


def revised(folder: Path, count: int) -> Entry:
    """A packed bare registry of one entry that was changed very often; the entry as it was at first."""
    repo, one = create(folder, bare=True, durable=False), entry(0)
    write(repo, [Change(path="registry.yaml", data=configuration_yaml())], "Begin\n")
    start = datetime(2026, 1, 1, tzinfo=UTC)
    steps = [
        Step(
            files=[File(path=one.path, data=entry_yaml(replace(one, tolerance=(number + 1) / (count + 1))))],
            message=f"Change {number}\n\nCamera: {one.id}\n",
            author=KEEPER,
            authored=start + timedelta(minutes=number),
            committer=KEEPER,
            committed=start + timedelta(minutes=number),
        )
        for number in range(count)
    ]
    commands = stream("refs/heads/main", repo.tip(), steps)
    repo.run("fast-import", "--quiet", "--date-format=raw", "--force", stdin=commands)
    maintain(repo)
    repo.close()
    return one


def revisions(folder: Path, count: int, repeats: int) -> None:
    """The log of one entry that was changed very often."""
    revised(folder, count)
    command = [
        sys.executable,
        "-m",
        "calibrary",
        "registry",
        "log",
        "model-000000",
        "--registry",
        str(folder),
    ]
    first, *again = (cpu_s(command) for _ in range(repeats + 1))
    print(f"\nLog of an entry with {count} revisions: seconds of processor time")
    row("for the first time", f"{first:.2f} s")
    row("again", f"{median(again):.2f} s")


def cpu_s(command: list[str]) -> float:
    """Seconds of processor time of a process and of what it starts."""
    before = os.times()
    subprocess.run(command, check=True, capture_output=True)
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


def each_ms(seconds: list[float]) -> str:
    """The median."""
    return f"{median(seconds) * 1e3:.0f} ms"


def measure(sizes: Sizes) -> None:
    """Make the registries and print everything."""
    git = subprocess.run(["git", "version"], check=True, capture_output=True, text=True).stdout.split()[2]
    print(
        f"Python {platform.python_version()}, git {git}, {os.cpu_count()} cores, {platform.system()}", end=""
    )
    print(f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "")
    again = []
    for entries in sizes.entries:
        with tempfile.TemporaryDirectory(prefix="calibrary-bench-") as name:
            print(f"\n{entries} entries")
            snapshot = registry_of(Path(name, "registry"), entries)
            again.append(warm(snapshot, entries))
            cold(snapshot, entries, sizes.repeats)
            if entries <= CHECKED_UP_TO:
                check(snapshot, entries)
            commands(snapshot, entries, sizes.repeats)
            assert snapshot.repo is not None
            snapshot.repo.close()
    with tempfile.TemporaryDirectory(prefix="calibrary-bench-") as name:
        revisions(Path(name, "registry"), sizes.revisions, sizes.repeats)
    if len(again) > 1:
        growth = again[-1] / again[0]
        print(f"\nResolve, warm, from {sizes.entries[0]} to {sizes.entries[-1]} entries")
        row("  the largest registry takes", f"{growth:.2f} ×", growth, at_most=FLAT)


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(description="What finding and checking entries costs.")
    parser.add_argument("--quick", action="store_true", help="a small run, to see that everything runs")
    parser.add_argument("--large", action="store_true", help="100 000 entries too, which takes minutes")
    parser.add_argument("--repeats", type=int, default=5, metavar="R", help="of what is compared")
    arguments = parser.parse_args()
    if arguments.repeats < 1:
        parser.error("wanted at least one repetition")
    sizes = Sizes(
        entries=(1000, 10_000, 100_000) if arguments.large else (1000, 10_000), repeats=arguments.repeats
    )
    if arguments.quick:
        print("A quick run, to see that everything runs: too small for the goals.")
        sizes = Sizes(entries=(200,), repeats=1, revisions=20)
    # Nobody's taste of git, and nobody's cache.
    with tempfile.TemporaryDirectory() as home:
        config = Path(home, ".gitconfig")
        config.write_text("[user]\n\tname = Fleet Keeper\n\temail = keeper@example.com\n[gc]\n\tauto = 0\n")
        os.environ |= {
            "GIT_CONFIG_GLOBAL": str(config),
            "GIT_CONFIG_NOSYSTEM": "1",
            "HOME": home,
            "XDG_CACHE_HOME": str(Path(home, "cache")),
        }
        measure(sizes)


if __name__ == "__main__":
    main()
