"""What the registry's git layer costs, as ratios from one run of this file on one machine.

    python -m benchmarks.registry [--quick] [--large] [--repeats R]

Registries of 1 000 and 10 000 entries (--large: 100 000 too) of 1.2 kB, each with 10 000 commits of one entry, packed.
Everything is done beside plain git doing the least that gives the same, and beside GitPython as its manual shows it
(``index.add`` + ``index.commit``, ``commit.tree / path``, ``iter_commits``). What is compared runs in turns, and the
median counts. Nothing here fails on a slow machine; a goal is met or missed, and that is printed.
"""

from __future__ import annotations

import argparse
import os
import platform
import random
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from itertools import count
from pathlib import Path
from statistics import median

import git

from benchmarks.table import interleaved, ratio, row
from calibrary.registry.configuration import configuration_yaml
from calibrary.registry.git.history import history
from calibrary.registry.git.remotes import clone
from calibrary.registry.git.repository import Repository, create, maintain
from calibrary.registry.git.writing import Change, File, Person, Step, stream, write
from calibrary.registry.registry import Registry

KEEPER = Person(name="Fleet Keeper", email="keeper@example.com")
MAKES = 20
READS = 200
NAIVE_UP_TO = 10_000

ENTRY = """\
digest: "sha256:{digest}"
schema: "camera-entry/1"
key:
  make: "Make {make}"
  model: "Model {model}"
  image_size: [5472, 3648]
intrinsics:
  pixel_origin: "corner"
  fx: {fx!r}
  fy: {fy!r}
  cx: {cx!r}
  cy: {cy!r}
  skew: 0.0
distortion:
  model: "brown"
  k1: {k1!r}
  k2: {k2!r}
  p1: {p1!r}
  p2: {p2!r}
quality:
  rms_px: 0.31
  views: 84
provenance:
  kind: "calibration-file"
  source: "calibration-{model}.xml"
  sha256: "{digest}"
  tool: "opencv 4.10.0"
  date: "2026-05-17T09:31:00Z"
notes: "{notes}"
status: "approved"
"""


@dataclass(frozen=True, slots=True)
class Sizes:
    """How much of everything is done."""

    entries: tuple[int, ...]
    commits: int
    repeats: int


def path_of(number: int) -> str:
    """Where an entry stands: models shared out over twenty makes."""
    return f"cameras/make-{number % MAKES:02d}/model-{number:06d}/5472x3648.yaml"


def entry(number: int, seed: int = 0) -> bytes:
    """An entry of 1.2 kB; another for every seed."""
    chance = random.Random(f"{number} {seed}")  # noqa: S311  the same numbers in every run
    values = {name: chance.uniform(1000.0, 4000.0) for name in ("fx", "fy", "cx", "cy")}
    values |= {name: chance.gauss(0.0, 0.1) for name in ("k1", "k2", "p1", "p2")}
    digest = f"{chance.getrandbits(256):064x}"
    text = ENTRY.format(digest=digest, make=number % MAKES, model=number, notes="calibrated " * 30, **values)
    return text.encode()


def begun(folder: Path, files: Mapping[str, bytes], *, durable: bool = True) -> Repository:
    """A bare registry with some entries as its first commit."""
    repo = create(folder, bare=True, durable=durable)
    changes = [Change(path=path, data=data) for path, data in files.items()]
    write(repo, [Change(path="registry.yaml", data=configuration_yaml()), *changes], "Import\n")
    return repo


def registry_with_history(folder: Path, entries: int, commits: int) -> Registry:
    """A packed bare registry: all entries in one commit, then one commit after the other of one entry each."""
    begun(folder, {path_of(n): entry(n) for n in range(entries)}, durable=False).close()
    registry = Registry.open(folder, durable=False)
    # One entry in ten is changed often: some twenty revisions among ten thousand commits at a thousand entries.
    chance = random.Random(entries)  # noqa: S311  the same numbers in every run
    start = datetime(2026, 1, 1, tzinfo=UTC)
    steps = []
    for number in range(commits):
        changed = chance.randrange(max(entries, 10) // 10 if number % 2 else entries)
        moment = start + timedelta(minutes=number)
        steps.append(
            Step(
                files=[File(path=path_of(changed), data=entry(changed, number + 1))],
                message=f"Calibrate model {changed}\n\nReason: number {number}\n",
                author=KEEPER,
                authored=moment,
                committer=KEEPER,
                committed=moment,
            )
        )
    commands = stream("refs/heads/main", registry.repo.tip(), steps)
    registry.repo.run("fast-import", "--quiet", "--date-format=raw", "--force", stdin=commands)
    maintain(registry.repo)
    return registry


def run(folder: Path, *arguments: str) -> bytes:
    """Plain git."""
    return subprocess.run(["git", "-C", str(folder), *arguments], check=True, capture_output=True).stdout


class CatFile:
    """The least that reads an entry at a revision: a warm ``git cat-file --batch``, nothing checked."""

    def __init__(self, folder: Path) -> None:
        command = ["git", "-C", str(folder), "cat-file", "--batch"]
        self._process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)

    def read(self, name: str) -> bytes:
        """The content that a name means."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{name}\n".encode())
        self._process.stdin.flush()
        size = int(self._process.stdout.readline().split()[2])
        return self._process.stdout.read(size + 1)[:-1]

    def close(self) -> None:
        """End the process."""
        self._process.communicate()


def each_ms(seconds: list[float], times: int = 1) -> str:
    """The median, for one of so many."""
    return f"{median(seconds) / times * 1e3:.2f} ms"


def bulk_import(folder: Path, entries: int, repeats: int) -> None:
    """All entries in one commit."""
    files = {path_of(number): entry(number) for number in range(entries)}
    places = count()

    def ours() -> None:
        begun(folder / f"o{next(places)}", files).close()

    def plain() -> None:
        place = folder / f"g{next(places)}"
        write_out(place, files)
        run(place, "add", ".")
        run(place, "commit", "-qm", "Import")

    def naive() -> None:
        place = folder / f"n{next(places)}"
        write_out(place, files)
        with git.Repo(place) as repo:
            repo.index.add([*files])
            repo.index.commit("Import")

    contestants: dict[str, Callable[[], object]] = {"ours": ours, "plain": plain}
    if entries <= NAIVE_UP_TO:
        contestants["naive"] = naive
    times = interleaved(contestants, 1 if entries > 1000 else repeats)
    print(f"\nBulk import of {entries} entries as one commit, into a new registry")
    goal = 5.0 if entries == 10_000 else None
    row("ours, waiting for the disk", f"{median(times['ours']):.2f} s", median(times["ours"]), at_most=goal)
    row("files written, git add, git commit", f"{median(times['plain']):.2f} s")
    row("  ours is faster by", ratio(times["plain"], times["ours"])[0])
    if "naive" in times:
        row("files written, GitPython index.add, index.commit", f"{median(times['naive']):.2f} s")
        row("  ours is faster by", ratio(times["naive"], times["ours"])[0])
    for place in folder.iterdir():
        shutil.rmtree(place)


def write_out(place: Path, files: dict[str, bytes]) -> None:
    """A new repository with the files in its work tree."""
    place.mkdir()
    run(place, "init", "-q")
    for path, data in files.items():
        (place / path).parent.mkdir(parents=True, exist_ok=True)
        (place / path).write_bytes(data)


def show(registry: Registry, entries: int, repeats: int) -> None:
    """One entry at an old revision, by its commit id, warm."""
    chance = random.Random(1)  # noqa: S311  the same numbers in every run
    folder, revision = registry.repo.path, registry.commit("main~500")
    paths = [path_of(chance.randrange(entries)) for _ in range(READS)]
    reader, repo = CatFile(folder), git.Repo(folder)
    assert registry.snapshot(revision).read(paths[0]) == reader.read(f"{revision}:{paths[0]}")
    contestants: dict[str, Callable[[], object]] = {
        "ours": lambda: [registry.snapshot(revision).read(path) for path in paths],
        "plain": lambda: [reader.read(f"{revision}:{path}") for path in paths],
        "naive": lambda: [(repo.commit(revision).tree / path).data_stream.read() for path in paths[:20]],
        "by name": lambda: [registry.snapshot("main~500").read(path) for path in paths[:10]],
        "cold git": lambda: [run(folder, "show", f"{revision}:{path}") for path in paths[:10]],
        "tip": lambda: [registry.snapshot() for _ in paths],
    }
    times = interleaved(contestants, repeats)
    reader.close()
    repo.close()
    print("\nOne entry at a revision (show KEY@REV), its hash checked; without parsing it")
    row("ours, warm, by commit id", each_ms(times["ours"], READS))
    row("git cat-file --batch, warm, nothing checked", each_ms(times["plain"], READS))
    row("  ours takes", ratio(times["ours"], times["plain"])[0])
    row("GitPython commit.tree / path, warm", each_ms(times["naive"], 20))
    ours = [seconds * 20 / READS for seconds in times["ours"]]
    row("  ours is faster by", ratio(times["naive"], ours)[0])
    row("ours, by a name that git must resolve", each_ms(times["by name"], 10))
    row("git show REV:path, one process each", each_ms(times["cold git"], 10))
    row("snapshot of all paths while nothing changes", each_ms(times["tip"], READS))


def log(registry: Registry, repeats: int) -> None:
    """The history of the entry that was changed most often."""
    folder = registry.repo.path
    changed = run(folder, "log", "--format=", "--name-only", "-n", "10000").decode().split()
    path = max(set(changed), key=changed.count)
    repo = git.Repo(folder)

    def naive() -> list[bytes]:
        return [(commit.tree / path).data_stream.read() for commit in repo.iter_commits(paths=path)]

    def plain() -> list[str]:
        return run(folder, "log", "--format=%H %an %ad %s", "--", path).decode().splitlines()

    contestants: dict[str, Callable[[], object]] = {
        "ours": lambda: history(registry.repo, path, registry.commit()),
        "plain": plain,
        "naive": naive,
    }
    revisions = len(history(registry.repo, path, registry.commit()))
    assert revisions == len(plain())
    times = interleaved(contestants, repeats * 3)
    repo.close()
    commits = run(folder, "rev-list", "--count", "main").decode().strip()
    print(f"\nThe log of one entry: {revisions} revisions among {commits} commits")
    row("ours, with trailers and the id of each content", each_ms(times["ours"]))
    row("git log -- path", each_ms(times["plain"]))
    row("  ours takes", *ratio(times["ours"], times["plain"]), at_most=2.0)
    row("GitPython iter_commits(paths=…), tree / path", each_ms(times["naive"]))
    row("  ours is faster by", ratio(times["naive"], times["ours"])[0])


def add_and_commit(registry: Registry, folder: Path, entries: int, repeats: int) -> None:
    """One new entry, one commit."""
    numbers = count(entries)
    waiting = Repository.open(registry.repo.path)
    work, seen = folder / "git", folder / "ours"
    clone(str(registry.repo.path), work, durable=False).close()
    shown = clone(str(registry.repo.path), seen, durable=False)

    def put(into: Repository) -> None:
        number = next(numbers)
        write(into, [Change(path=path_of(number), data=entry(number))], f"Add {number}\n")

    def written() -> str:
        number = next(numbers)
        (work / path_of(number)).parent.mkdir(parents=True, exist_ok=True)
        (work / path_of(number)).write_bytes(entry(number))
        return path_of(number)

    def plain() -> None:
        path = written()
        run(work, "add", path)
        run(work, "commit", "-qm", "Add")

    def naive() -> None:
        with git.Repo(work) as repo:
            repo.index.add([written()])
            repo.index.commit("Add")

    contestants: dict[str, Callable[[], object]] = {
        "ours": lambda: put(registry.repo),
        "durable": lambda: put(waiting),
        "shown": lambda: put(shown),
        "plain": plain,
    }
    times = interleaved(contestants, repeats * 5)
    times["naive"] = interleaved({"naive": naive}, repeats if entries <= NAIVE_UP_TO else 1)["naive"]
    few = {name: seconds[: len(times["naive"])] for name, seconds in times.items()}
    for opened in (waiting, shown):
        opened.close()
    shutil.rmtree(work)
    shutil.rmtree(seen)
    print("\nOne new entry, one commit (add)")
    limit = 30.0 if entries == 100_000 else None
    row(
        "ours, bare, not waiting for the disk",
        each_ms(times["ours"]),
        median(times["ours"]) * 1e3,
        at_most=limit,
    )
    row("ours, bare, every object and ref fsynced", each_ms(times["durable"]))
    row("ours, checked out, the files brought up to date", each_ms(times["shown"]))
    row("git add, git commit", each_ms(times["plain"]))
    row("  ours is faster by, bare", *ratio(times["plain"], times["ours"]), at_least=1.0)
    row("  ours is faster by, checked out", *ratio(times["plain"], times["shown"]), at_least=1.0)
    row("GitPython index.add, index.commit", each_ms(times["naive"]))
    goal = 20.0 if entries == 10_000 else None
    row("  ours is faster by", *ratio(few["naive"], few["ours"]), at_least=goal)


def measure(sizes: Sizes) -> None:
    """Make the registries and print everything."""
    version = subprocess.run(["git", "version"], check=True, capture_output=True, text=True).stdout.split()[2]
    print(f"Python {platform.python_version()}, git {version}, GitPython {git.__version__}, ", end="")
    print(f"{os.cpu_count()} cores, {platform.system()}", end="")
    print(f", load {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "")
    for entries in sizes.entries:
        with tempfile.TemporaryDirectory(prefix="calibrary-bench-") as name:
            folder = Path(name)
            (folder / "bulk").mkdir()
            print(f"\n{entries} entries, {sizes.commits} commits")
            bulk_import(folder / "bulk", entries, sizes.repeats)
            registry = registry_with_history(folder / "registry", entries, sizes.commits)
            show(registry, entries, sizes.repeats)
            log(registry, sizes.repeats)
            add_and_commit(registry, folder, entries, sizes.repeats)
            registry.repo.close()


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(
        description="What the registry's git layer costs, as ratios from one run."
    )
    parser.add_argument("--quick", action="store_true", help="a small run, to see that everything runs")
    parser.add_argument("--large", action="store_true", help="100 000 entries too, which takes minutes")
    parser.add_argument("--repeats", type=int, default=3, metavar="R", help="of what is compared")
    arguments = parser.parse_args()
    if arguments.repeats < 1:
        parser.error("wanted at least one repetition")
    entries = (1000, 10_000, 100_000) if arguments.large else (1000, 10_000)
    sizes = Sizes(entries=entries, commits=10_000, repeats=arguments.repeats)
    if arguments.quick:
        print("A quick run, to see that everything runs: too small for the goals.")
        sizes = Sizes(entries=(200,), commits=600, repeats=1)
    # Nobody's taste of git, and no pauses for a gc of its own, in whatever is compared.
    with tempfile.TemporaryDirectory() as home:
        config = Path(home, ".gitconfig")
        person = f"[user]\n\tname = {KEEPER.name}\n\temail = {KEEPER.email}\n"
        config.write_text(f"{person}[gc]\n\tauto = 0\n[maintenance]\n\tauto = false\n")
        os.environ |= {"GIT_CONFIG_GLOBAL": str(config), "GIT_CONFIG_NOSYSTEM": "1", "HOME": home}
        measure(sizes)


if __name__ == "__main__":
    main()
