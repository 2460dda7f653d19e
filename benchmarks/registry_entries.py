"""What finding, listing and adding the entries of a registry costs, by how many there are.

    python -m benchmarks.registry_entries [--entries N ...] [--repeats R]

Bare and packed registries of 1 000 and 10 000 entries; a command is a process from its start to its end. The peers do
what somebody without a registry would: files of YAML in a folder, a table of SQLite, git by its own commands.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from itertools import count
from pathlib import Path
from typing import Final

from benchmarks.table import compared, in_turns, machine
from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance, Quality
from calibrary.distortion import BrownConrady
from calibrary.records import replace
from calibrary.registry.configuration import configuration_yaml, parse_configuration
from calibrary.registry.entry import Alias, Entry, Status
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.git.remotes import clone
from calibrary.registry.git.repository import Repository, create, maintain
from calibrary.registry.git.writing import FileChange, write
from calibrary.registry.registry import open_snapshot
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.stating import Change, founded, stated

MAKES = 20
NAMED_EVERY = 100
SIZE = (5472, 3648)


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


def founding(repo: Repository) -> list[FileChange]:
    """Files of a new registry."""
    configuration = configuration_yaml()
    return [
        FileChange(path="registry.yaml", data=configuration),
        *founded(repo, parse_configuration(configuration).rules),
    ]


def approving(snapshot: Snapshot, one: Entry) -> tuple[FileChange, ...]:
    """Files of the statement that approves an entry."""
    return stated(snapshot, [_approval(one)]).changes


def _approval(one: Entry) -> Change:
    return Change(action="approve", before=None, after=one, fields=())


def fill(repo: Repository, numbers: Iterable[int]) -> None:
    """Found a registry, and put entries to use in one commit."""
    write(repo, founding(repo), "Create\n")
    made = [*map(entry, numbers)]
    files = [FileChange(path=one.path, data=entry_yaml(one)) for one in made]
    write(repo, [*files, *stated(open_snapshot(repo.path), [*map(_approval, made)]).changes], "Import\n")


def registry_of(folder: Path, entries: int) -> Snapshot:
    """A packed bare registry."""
    repo = create(folder, bare=True, durable=False)
    fill(repo, range(entries))
    maintain(repo)
    repo.close()
    return open_snapshot(folder)


def process(*words: str) -> Callable[[], object]:
    """A process, from its start to its end."""
    return lambda: subprocess.run(words, check=True, capture_output=True)


def command(place: Path, *words: str) -> Callable[[], object]:
    """A command on a registry."""
    return process(sys.executable, "-m", "calibrary", "registry", *words, "--registry", str(place))


def python(code: str, *words: str) -> Callable[[], object]:
    """A program of a few lines."""
    return process(sys.executable, "-c", code, *words)


PLAIN_YAML: Final = """
import pathlib, sys, yaml
for path in pathlib.Path(sys.argv[1]).rglob("*.yaml"):
    print(path.name, yaml.load(path.read_bytes(), yaml.CSafeLoader)["camera"]["model"])
"""
"""What listing is without a registry: a folder of files and PyYAML's quick loader."""
SQLITE: Final = """
import json, sqlite3, sys
for found, in sqlite3.connect(sys.argv[1]).execute("select k from cameras where model = ?", sys.argv[2:]):
    print(json.loads(found)["fx"])
"""
"""What resolving is to a program that keeps its cameras in a table."""
NAIVE_SHOW: Final = """
import sys, git
repo = git.Repo(sys.argv[1])
print((repo.head.commit.tree / sys.argv[2]).data_stream.read().decode())
"""


def table_of(folder: Path, entries: int) -> Path:
    """The same cameras as rows of a table."""
    place = folder / "cameras.sqlite"
    rows = [
        (one.calibration.camera.model, one.calibration.intrinsics.fx) for one in map(entry, range(entries))
    ]
    with closing(sqlite3.connect(place)) as table, table:
        table.execute("create table cameras (model primary key, k)")
        table.executemany(
            "insert into cameras values (?, ?)", [(model, f'{{"fx": {fx}}}') for model, fx in rows]
        )
    return place


def files_of(folder: Path, entries: int) -> Path:
    """The same entries as files of a folder."""
    for one in map(entry, range(entries)):
        place = folder / "files" / one.path
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(entry_yaml(one))
    return folder / "files"


def commands(place: Path, entries: int, repeats: int) -> None:
    """Whole commands: the first list of a fresh clone, and what follows, with the cache known from before."""
    key, path = key_of(entries // 2), entry(entries // 2).path
    cache, model = Path(os.environ["XDG_CACHE_HOME"]), str(key.model)
    files, table = files_of(place.parent, entries), table_of(place.parent, entries)

    def first() -> None:
        shutil.rmtree(cache, ignore_errors=True)
        command(place, "list")()

    costs = in_turns(
        {
            "first": first,
            "files": python(PLAIN_YAML, str(files)),
            "list": command(place, "list"),
            "resolve": command(place, "resolve", "--make", str(key.make), "--model", model),
            "sqlite": python(SQLITE, str(table), model),
            "show": command(place, "show", model.lower()),
            "GitPython": python(NAIVE_SHOW, str(place), path),
        },
        repeats,
    )
    cpu = {name: [cost.cpu_s for cost in found] for name, found in costs.items()}
    row, yaml = partial(compared, scale=1.0, unit="s"), "files and PyYAML"
    row(f"{entries} entries: first list of a clone", cpu["first"], cpu["files"], name=yaml, most=1.2)
    row(f"{entries} entries: list", cpu["list"], cpu["files"], name=yaml, most=3.0)
    row(f"{entries} entries: resolve", cpu["resolve"], cpu["sqlite"], name="sqlite")
    row(f"{entries} entries: show", cpu["show"], cpu["GitPython"], name="GitPython, not parsed")


def adding(place: Path, entries: int, repeats: int) -> None:
    """One new entry, one commit: in a process that is up, beside git's two commands."""
    numbers, work = count(entries), place.parent / "work"
    clone(str(place), work, durable=False).close()
    bare = Repository.open(place, durable=False)

    def ours() -> None:
        one = entry(next(numbers))
        write(bare, [FileChange(path=one.path, data=entry_yaml(one))], "Add\n")
        # What its git has used counts once that has ended.
        bare.close()

    def plain() -> None:
        one = entry(next(numbers))
        (work / one.path).parent.mkdir(parents=True, exist_ok=True)
        (work / one.path).write_bytes(entry_yaml(one))
        subprocess.run(["git", "-C", str(work), "add", one.path], check=True, capture_output=True)
        subprocess.run(["git", "-C", str(work), "commit", "-qm", "Add"], check=True, capture_output=True)

    costs = in_turns({"ours": ours, "git": plain}, repeats * 3)
    shutil.rmtree(work)
    compared(
        f"{entries} entries: add and commit one",
        [cost.cpu_s for cost in costs["ours"]],
        [cost.cpu_s for cost in costs["git"]],
        scale=1e3,
        unit="ms",
        name="git add, git commit",
        most=1.0,
    )


def main() -> None:
    """Measure what the command line asks for."""
    parser = argparse.ArgumentParser(description="What finding, listing and adding entries costs.")
    parser.add_argument("--entries", type=int, nargs="+", default=[1000, 10_000], metavar="N")
    parser.add_argument("--repeats", type=int, default=5, metavar="R", help="of what is compared")
    given = parser.parse_args()
    print(machine())
    with nobody():
        for entries in given.entries:
            with tempfile.TemporaryDirectory(prefix="calibrary-bench-") as name:
                snapshot = registry_of(Path(name, "registry"), entries)
                commands(snapshot.place, entries, given.repeats)
                adding(snapshot.place, entries, given.repeats)
                assert snapshot.repo is not None
                snapshot.repo.close()


@contextmanager
def nobody() -> Iterator[None]:
    """Nobody's taste of git, and nobody's cache."""
    with tempfile.TemporaryDirectory() as home:
        config = Path(home, ".gitconfig")
        config.write_text("[user]\n\tname = Fleet Keeper\n\temail = keeper@example.com\n[gc]\n\tauto = 0\n")
        os.environ |= {
            "GIT_CONFIG_GLOBAL": str(config),
            "GIT_CONFIG_NOSYSTEM": "1",
            "HOME": home,
            "XDG_CACHE_HOME": str(Path(home, "cache")),
            # As installed: modules are compiled once, not by every command.
            "PYTHONDONTWRITEBYTECODE": "",
            "PYTHONPYCACHEPREFIX": str(Path(home, "compiled")),
        }
        yield


if __name__ == "__main__":
    main()
