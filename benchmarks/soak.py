"""Three writers of one registry, killed at random, beside git gc: nothing that was acknowledged is lost.

    python -m benchmarks.soak [--minutes M] [--seed N]

Every writer approves new contents of its own ten entries, one commit each, and notes in a file what it tries and what
was acknowledged. It is killed (SIGKILL, alone or with its git) after a random time and started again. In between, all
entries are read: what is in force is the last content that was acknowledged, or one that was tried since. The last line
counts the kills, and what was lost, half or hung.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks.registry_entries import approving, entry, founding
from calibrary.errors import RegistryError
from calibrary.records import replace
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.git.repository import Repository, create
from calibrary.registry.git.writing import Change, write
from calibrary.registry.registry import open_snapshot

WRITERS, EACH = 3, 10
STEP = 1e-7
LONGEST_LIFE_S, HUNG_S, GC_S = 4.0, 120.0, 20.0


def write_on(place: Path, notes: Path, writer: int) -> None:
    """Approve one content after the other, until killed."""
    number = max(_noted(notes)[0].values(), default=0)
    repo = Repository.open(place, durable=False)
    with notes.open("a") as file:
        while True:
            number += 1
            which = writer * EACH + number % EACH
            one = replace(entry(which), tolerance=number * STEP)
            print("try", which, number, file=file, flush=True)
            snapshot = open_snapshot(place)
            change = Change(path=one.path, data=entry_yaml(one), base=snapshot.paths.get(one.path))
            try:
                write(repo, [change, *approving(snapshot, one)], f"Content {number}\n")
            except RegistryError as error:
                print("refused", which, str(error).replace("\n", " "), file=file, flush=True)
            else:
                print("did", which, number, file=file, flush=True)


def _noted(notes: Path) -> tuple[dict[int, int], dict[int, int]]:
    """The last content that was tried and acknowledged, by entry."""
    tried, done = dict[int, int](), dict[int, int]()
    # A line that a killed writer left half is none.
    for line in notes.read_text().split("\n")[:-1] if notes.exists() else ():
        word, which, number = line.split(" ", 2)
        if word != "refused":
            (tried if word == "try" else done)[int(which)] = int(number)
    return tried, done


class Soak:
    """One run: the writers, and what was found."""

    def __init__(self, folder: Path, seed: int) -> None:
        self.place, self.folder, self.chance = folder / "fleet", folder, random.Random(seed)  # noqa: S311  chance
        repo = create(self.place, durable=False)
        write(repo, founding(repo, map(entry, range(WRITERS * EACH))), "Import\n")
        repo.close()
        self.running: dict[int, tuple[subprocess.Popen[bytes], float]] = {}
        self.kills = self.compared = self.lost = self.half = self.hung = 0
        self.progress = (0, time.monotonic())

    def notes(self, writer: int) -> Path:
        """Where a writer notes what it does."""
        return self.folder / f"{writer}.txt"

    def turn(self) -> None:
        """Start who does not run, and kill whose time is over."""
        for writer in range(WRITERS):
            process, until = self.running.get(writer, (None, 0.0))
            if process is not None and time.monotonic() > until:
                with_git = self.chance.random() < 0.5
                (os.killpg if with_git else os.kill)(process.pid, signal.SIGKILL)
                process.wait()
                self.kills += 1
                process = None
            if process is None:
                words = (sys.executable, "-m", "benchmarks.soak", "--writer", str(writer), str(self.place))
                life = LONGEST_LIFE_S * self.chance.random() + 0.5
                started = subprocess.Popen((*words, str(self.notes(writer))), start_new_session=True)
                self.running[writer] = started, time.monotonic() + life

    def compare(self) -> None:
        """Compare what is in force with what the writers noted before and after it was read."""
        before = [_noted(self.notes(writer))[1] for writer in range(WRITERS)]
        found = {one.path: one for one in open_snapshot(self.place).entries()}
        after = [_noted(self.notes(writer))[0] for writer in range(WRITERS)]
        for which in range(WRITERS * EACH):
            stored, own = found.get(entry(which).path), which // EACH
            number = round((stored.entry.tolerance or 0.0) / STEP) if stored is not None else -1
            self.lost += number < before[own].get(which, 0)
            self.half += number > after[own].get(which, 0)
            self.half += stored is None or (
                stored.standing is not None and stored.standing.remark is not None
            )
        self.compared += 1
        total = sum(sum(one.values()) for one in before)
        if total != self.progress[0]:
            self.progress = total, time.monotonic()
        elif time.monotonic() - self.progress[1] > HUNG_S:
            self.hung, self.progress = self.hung + 1, (total, time.monotonic())

    def end(self) -> str:
        """End the writers, compare once more, and say what was found."""
        for process, _ in self.running.values():
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        self.compare()
        bad = subprocess.run(
            ["git", "-C", str(self.place), "fsck", "--strict"], capture_output=True, check=False
        )
        self.half += bad.returncode != 0
        text = "".join(self.notes(writer).read_text() for writer in range(WRITERS))
        writes = f"{text.count('did ')} acknowledged and {text.count('refused ')} refused writes"
        found = f"{self.lost} lost, {self.half} half, {self.hung} hung"
        return f"{self.kills} kills, {writes}, {self.compared} comparisons: {found}"


def main() -> None:
    """Run for as long as the command line says."""
    parser = argparse.ArgumentParser(
        description="Writers that are killed at random, against what they noted."
    )
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--writer", nargs=3, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.writer:
        write_on(Path(given.writer[1]), Path(given.writer[2]), int(given.writer[0]))
    with tempfile.TemporaryDirectory(prefix="calibrary-soak-", ignore_cleanup_errors=True) as name:
        os.environ |= {"XDG_CACHE_HOME": f"{name}/cache"}
        soak, start, gc = Soak(Path(name), given.seed), time.monotonic(), time.monotonic() + GC_S
        while time.monotonic() - start < given.minutes * 60:
            soak.turn()
            soak.compare()
            if time.monotonic() > gc:
                subprocess.run(["git", "-C", str(soak.place), "gc", "-q"], check=False)
                gc = time.monotonic() + GC_S
        print(soak.end())


if __name__ == "__main__":
    main()
