"""What finding, listing and checking the entries of a registry costs, by how many there are.

    python benchmarks/registry_entries.py [--quick] [--large] [--repeats R]

Registries of 1 000 and 10 000 entries (--large: 100 000 too), bare and packed; one camera in a hundred goes by another
name as well. A command is a process from its start to its end. All figures are seconds of processor time, user and
system, of a process and of those it starts; what is compared runs in turns, and the median counts. The peers are git
doing the least that gives the same, and GitPython as its manual shows it. Rows are ``measure | ours | peer | ratio |
limit | met``. Nothing here fails on a slow machine; a limit is met or missed.
"""

from __future__ import annotations

import argparse
import os
import platform
import random
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from itertools import count
from pathlib import Path
from statistics import median
from typing import Final

import git

from calibrary import open_registry
from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance, Quality
from calibrary.distortion import BrownConrady
from calibrary.records import replace
from calibrary.registry.configuration import configuration_yaml, parse_configuration
from calibrary.registry.entry import Alias, Entry, Status
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.git.remotes import clone
from calibrary.registry.git.repository import Repository, create, maintain
from calibrary.registry.git.writing import Change, File, Person, Step, stream, write
from calibrary.registry.registry import open_snapshot
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.stating import Act, founded, stated

KEEPER = Person(name="Fleet Keeper", email="keeper@example.com")
MAKES = 20
NAMED_EVERY = 100
ASKED = 500
FEW_MODELS = 100
LARGEST = 100_000
SIZE = (5472, 3648)


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


def founding(repo: Repository) -> list[Change]:
    """Files of a new registry."""
    configuration = configuration_yaml()
    return [
        Change(path="registry.yaml", data=configuration),
        *founded(repo, parse_configuration(configuration).rules),
    ]


def approving(snapshot: Snapshot, one: Entry) -> tuple[Change, ...]:
    """Files of the statement that approves an entry."""
    return stated(snapshot, [Act(action="approve", entry=one)], None).changes


def fill(repo: Repository, numbers: Iterable[int]) -> None:
    """Found a registry, and put entries to use in one commit."""
    write(repo, founding(repo), "Create\n")
    made = [*map(entry, numbers)]
    acts = [Act(action="approve", entry=one) for one in made]
    files = [Change(path=one.path, data=entry_yaml(one)) for one in made]
    write(repo, [*files, *stated(open_snapshot(repo.path), acts, None).changes], "Import\n")


def registry_of(folder: Path, entries: int) -> Snapshot:
    """A packed bare registry."""
    repo = create(folder, bare=True, durable=False)
    fill(repo, range(entries))
    maintain(repo)
    repo.close()
    return open_snapshot(folder)


def show(
    measure: str,
    ours: float,
    unit: str = "s",
    *,
    peer: str = "",
    other: float | None = None,
    limit: float | None = None,
    most: float | None = None,
) -> None:
    """Print a row.

    Args:
        measure: what was measured.
        ours: its cost.
        unit: of both.
        peer: what it is compared with.
        other: the peer's cost.
        limit: that ours may not exceed.
        most: how many times the peer's cost ours may be.
    """
    ratio = ours / other if other else None
    limits, met = [], []
    if limit is not None:
        limits.append(f"≤ {limit:g} {unit}")
        met.append(ours <= limit)
    if most is not None and ratio is not None:
        limits.append(f"≤ {most:g} ×")
        met.append(ratio <= most)
    cells = (
        measure,
        f"{ours:.3g} {unit}",
        f"{other:.3g} {unit} ({peer})" if other is not None else "",
        f"{ratio:.2f} ×" if ratio is not None else "",
        ", ".join(limits),
        "" if not met else "yes" if all(met) else "no",
    )
    print(" | ".join(cells), flush=True)


def cpu_of(act: Callable[[], object]) -> float:
    """Seconds of processor time of doing something, the processes it starts and waits for included."""
    before = _cpu_s()
    act()
    return _cpu_s() - before


def _cpu_s() -> float:
    own, ended = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime + ended.ru_utime + ended.ru_stime


def in_turns(contestants: Mapping[str, Callable[[], object]], repeats: int) -> dict[str, float]:
    """The median cost of each."""
    costs: dict[str, list[float]] = {name: [] for name in contestants}
    for _ in range(repeats):
        for name, act in contestants.items():
            costs[name].append(cpu_of(act))
    return {name: median(found) for name, found in costs.items()}


def process(*words: str) -> Callable[[], object]:
    """A process, from its start to its end."""
    return lambda: subprocess.run(words, check=True, capture_output=True)


def command(place: Path, *words: str) -> Callable[[], object]:
    """A command on a registry."""
    return process(sys.executable, "-m", "calibrary", "registry", *words, "--registry", str(place))


def python(code: str, *words: str) -> Callable[[], object]:
    """A program of a few lines."""
    return process(sys.executable, "-c", code, *words)


LIBRARIES: Final = (
    "import argparse, git, msgspec, numpy, platformdirs, rich.console, rich.text, sqlite3, yaml"
)
"""What a command that reads a registry cannot do without; what it may cost more is calibrary's own."""
NAIVE_LIST: Final = """
import sys, git
repo = git.Repo(sys.argv[1])
every = (one.path for one in repo.head.commit.tree.traverse() if one.type == "blob")
print(*[path for path in every if sys.argv[2] in path], sep="\\n")
"""
NAIVE_SHOW: Final = """
import sys, git
repo = git.Repo(sys.argv[1])
print((repo.head.commit.tree / sys.argv[2]).data_stream.read().decode())
"""
NAIVE_LOG: Final = """
import sys, git
repo = git.Repo(sys.argv[1])
for commit in repo.iter_commits(paths=sys.argv[2]):
    print(commit.hexsha, commit.author, commit.summary, (commit.tree / sys.argv[2]).data_stream.read()[:0])
"""


def change_one(place: Path, entries: int, number: int) -> str:
    """Commit a change of one entry; the commit before."""
    repo = Repository.open(place, durable=False)
    changed = replace(entry(entries // 2), tolerance=(number + 1) / 100)
    before = repo.tip() or ""
    blob = repo.read(before, changed.path)
    base = blob.oid if blob is not None else None
    write(
        repo,
        [
            Change(path=changed.path, data=entry_yaml(changed), base=base),
            *approving(open_snapshot(place), changed),
        ],
        "Change one\n",
    )
    repo.close()
    return before


def commands(place: Path, entries: int, repeats: int) -> None:
    """Whole commands, with the index known from before; and the index itself."""
    word, key, path = f"{entries // 2:06d}", key_of(entries // 2), entry(entries // 2).path
    cache, said = Path(os.environ["XDG_CACHE_HOME"]), f"{entries} entries: "
    shutil.rmtree(cache, ignore_errors=True)
    show(f"{said}index built, first list WORD", cpu_of(command(place, "list", word)))
    size = sum(file.stat().st_size for file in cache.rglob("*.sqlite"))
    show(f"{said}index, size", size / 1e6, "MB")
    own = ("resolve", "--make", str(key.make), "--model", str(key.model))
    named = ("resolve", "--make", "Other", "--model", f"NAME-{entries // 200 * NAMED_EVERY}")
    cost = in_turns(
        {
            "libraries": python(LIBRARIES),
            "list WORD": command(place, "list", word),
            "list WORD naive": python(NAIVE_LIST, str(place), word),
            "show": command(place, "show", f"model-{word}"),
            "show git": process("git", "-C", str(place), "show", f"HEAD:{path}"),
            "show naive": python(NAIVE_SHOW, str(place), path),
            "resolve": command(place, *own),
            "resolve named": command(place, *named),
        },
        repeats,
    )
    show(
        f"{said}list WORD",
        cost["list WORD"],
        peer="GitPython, paths alone",
        other=cost["list WORD naive"],
        limit=1.0,
    )
    show(f"{said}show KEY", cost["show"], peer="GitPython, not parsed", other=cost["show naive"], limit=1.0)
    show(f"{said}show KEY, beside git", cost["show"], peer="git show", other=cost["show git"])
    imports = "its libraries' imports"
    show(
        f"{said}resolve, as a command",
        cost["resolve"],
        peer=imports,
        other=cost["libraries"],
        limit=1.0,
        most=1.3,
    )
    show(
        f"{said}resolve by another name",
        cost["resolve named"],
        peer=imports,
        other=cost["libraries"],
        limit=1.0,
    )
    after = []
    for number in range(repeats):
        before = change_one(place, entries, number)
        after.append(cpu_of(command(place, "list", word)))
    show(f"{said}list WORD, the first after a commit", median(after), limit=round(cost["list WORD"] + 1.0, 2))
    span = in_turns(
        {
            "ours": command(place, "check", f"{before}..HEAD"),
            "git": process("git", "-C", str(place), "diff", f"{before}..HEAD"),
        },
        repeats,
    )
    show(f"{said}check BASE..HEAD, one change", span["ours"], peer="git diff", other=span["git"])
    out = str(place.parent / "all.lock")
    whole = {
        "list": command(place, "list"),
        "lock": command(place, "lock", "--out", out),
        "check": command(place, "check"),
    }
    for act in whole.values():
        act()
    cost = in_turns(whole, repeats)
    show(f"{said}list, all of them", cost["list"], limit=2.0)
    show(f"{said}check, all of them", cost["check"], limit=15.0 if entries == LARGEST else 2.0)
    show(f"{said}lock, all of them", cost["lock"])


def adding(place: Path, entries: int, repeats: int) -> None:
    """One new entry, one commit: in a process that is up, beside git's two commands and GitPython's two calls."""
    numbers, work = count(entries), place.parent / "work"
    clone(str(place), work, durable=False).close()
    bare = Repository.open(place, durable=False)
    naive = git.Repo(work)

    def ours() -> None:
        one = entry(next(numbers))
        write(bare, [Change(path=one.path, data=entry_yaml(one))], "Add\n")
        # What its git has used counts once that has ended.
        bare.close()

    def written() -> str:
        one = entry(next(numbers))
        (work / one.path).parent.mkdir(parents=True, exist_ok=True)
        (work / one.path).write_bytes(entry_yaml(one))
        return one.path

    def plain() -> None:
        subprocess.run(["git", "-C", str(work), "add", written()], check=True, capture_output=True)
        subprocess.run(["git", "-C", str(work), "commit", "-qm", "Add"], check=True, capture_output=True)

    def by_gitpython() -> None:
        naive.index.add([written()])
        naive.index.commit("Add")

    contestants: dict[str, Callable[[], object]] = {"ours": ours, "git": plain, "GitPython": by_gitpython}
    cost = in_turns(contestants, repeats * 3)
    naive.close()
    shutil.rmtree(work)
    said = f"{entries} entries: add and commit one"
    show(said, cost["ours"] * 1e3, "ms", peer="git add, git commit", other=cost["git"] * 1e3, most=1.0)
    show(
        f"{said}, beside GitPython",
        cost["ours"] * 1e3,
        "ms",
        peer="index.add, index.commit",
        other=cost["GitPython"] * 1e3,
    )


def warm(snapshot: Snapshot, entries: int) -> None:
    """Resolving in a process that is up: key to K at the image's size."""
    chance = random.Random(1)  # noqa: S311  the same numbers in every run
    keys = [key_of(chance.randrange(entries)) for _ in range(ASKED)]
    fleet = open_registry(snapshot.place)
    fleet.resolve(keys[0])
    first = cpu_of(lambda: [fleet.resolve(key) for key in keys]) / ASKED
    keys = keys[:FEW_MODELS]
    for key in keys:
        fleet.resolve(key)
    again = cpu_of(lambda: [fleet.resolve(key) for key in keys * (ASKED // FEW_MODELS)]) / ASKED
    show(f"{entries} entries: Fleet.resolve, a camera for the first time", first * 1e3, "ms")
    show(f"{entries} entries: Fleet.resolve, again", again * 1e3, "ms", limit=0.1)


def revised(folder: Path, count: int) -> Entry:
    """A packed bare registry of one entry that was changed very often; the entry as it was at first."""
    repo, one = create(folder, bare=True, durable=False), entry(0)
    write(repo, founding(repo), "Begin\n")
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


def log(folder: Path, count: int, repeats: int) -> None:
    """The log of one entry that was changed very often."""
    one = revised(folder, count)
    show(f"log of {count} revisions, for the first time", cpu_of(command(folder, "log", "model-000000")))
    cost = in_turns(
        {
            "ours": command(folder, "log", "model-000000"),
            "git": process("git", "-C", str(folder), "log", "-p", "--", one.path),
            "naive": python(NAIVE_LOG, str(folder), one.path),
        },
        repeats,
    )
    show(f"log of {count} revisions", cost["ours"], peer="git log -p", other=cost["git"])
    show(
        f"log of {count} revisions, beside GitPython",
        cost["ours"],
        peer="iter_commits, each blob",
        other=cost["naive"],
    )


def measure(sizes: Sizes) -> None:
    """Make the registries and print everything."""
    version = subprocess.run(["git", "version"], check=True, capture_output=True, text=True).stdout.split()[2]
    print(
        f"Python {platform.python_version()}, git {version}, GitPython {git.__version__}, {os.cpu_count()} processors, "
        f"{platform.system()}, load {os.getloadavg()[0]:.1f}; processor time"
    )
    for entries in sizes.entries:
        with tempfile.TemporaryDirectory(prefix="calibrary-bench-") as name:
            snapshot = registry_of(Path(name, "registry"), entries)
            commands(snapshot.place, entries, sizes.repeats)
            warm(snapshot, entries)
            adding(snapshot.place, entries, sizes.repeats)
            assert snapshot.repo is not None
            snapshot.repo.close()
    with tempfile.TemporaryDirectory(prefix="calibrary-bench-") as name:
        log(Path(name, "registry"), sizes.revisions, sizes.repeats)


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
    with nobody():
        measure(sizes)


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
