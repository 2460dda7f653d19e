"""Commands of three people on one registry, killed at random, beside git gc: nothing that was acknowledged is lost.

    python -m benchmarks.soak [--minutes M] [--kills N] [--seed S]

Two people share a clone, the third has one of their own, and all pull from and push to one remote. Each changes their
own ten entries by one command after the other, of every kind that writes, and most of them are killed (SIGKILL, alone
or with their git) after a random time. What is known is the state of the ten entries after each command that ended:
after one that was killed they are as before it or as it would have left them, and nothing else is accepted; what was
pushed is at the remote. The last line counts the kills, and what was lost, half, or hung: refused until a person looks
at it counts as that.
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
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from threading import Thread
from typing import Final

from benchmarks.registry_entries import entry, fill
from calibrary import records
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.git.remotes import clone
from calibrary.registry.git.repository import create
from calibrary.registry.paths import proposal_path
from calibrary.registry.registry import open_snapshot

PEOPLE: Final = 3
EACH: Final = 10
KILLED: Final = 0.7
STEP: Final = 1e-7
HUNG_S: Final = 120.0
GC_S: Final = 20.0


@dataclass(frozen=True)
class State:
    """What is known of one entry: what is in force of it, and what is proposed, with its notes.

    Numbers stand for contents.
    """

    number: int = 0
    status: str = "approved"
    tags: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    proposed: tuple[int, tuple[str, ...]] | None = None


States = dict[int, State]


def numbered(which: int, number: int) -> Entry:
    """One of the contents of an entry."""
    return records.replace(entry(which), tolerance=number * STEP)


def number_of(one: Entry) -> int:
    """Which of its contents an entry has."""
    return round((one.tolerance or 0.0) / STEP)


def found_in(place: Path, own: range) -> States:
    """Read the state of one's entries."""
    snapshot, found = open_snapshot(place), States()
    for which in own:
        path = entry(which).path
        used, beside = snapshot.at(path), snapshot.at(proposal_path(path))
        if used is None:
            continue
        proposed = (number_of(beside.entry), beside.entry.notes) if beside is not None else None
        # A content that nothing approves is no state that a command leaves.
        whole = used.standing is None or used.standing.remark is None
        status = used.entry.status.value if whole else "not approved"
        found[which] = State(number_of(used.entry), status, used.entry.tags, used.entry.notes, proposed)
    return found


@dataclass(frozen=True)
class Command:
    """A command, and what it makes of one's entries."""

    kind: str
    words: tuple[str, ...]
    after: Mapping[int, State] = field(default_factory=dict)


class Person(Thread):
    """Gives one command after the other on their own entries, and compares what is there with what was acknowledged."""

    def __init__(self, soak: Soak, place: Path, number: int) -> None:
        super().__init__(daemon=True)
        self.soak, self.place, self.at = soak, place, number
        self.own = range(number * EACH, (number + 1) * EACH)
        self.chance = random.Random(f"{soak.seed} {number}")  # noqa: S311  chance
        self.known = found_in(place, self.own)
        self.last = 0
        self.lasting: dict[str, float] = {}
        self.ended, self.killed = Counter[str](), Counter[str]()
        self.lost = self.half = self.hung = self.compared = self.refused = 0
        self.is_done = False

    def run(self) -> None:
        """Give commands until the time is over."""
        choices = [self.tag, self.table, self.add, self.add, self.approve, self.add_approved, self.retire]
        while not self.soak.is_over():
            chosen = self.chance.choice([*choices, self.exchange, self.exchange])
            one = chosen()
            if one is not None:
                self.do(one)
        self.is_done = True

    def entry_at(self, test: Callable[[State], bool]) -> int | None:
        """One of the entries of which something holds."""
        those = [which for which, state in self.known.items() if test(state)]
        return self.chance.choice(those) if those else None

    def new(self) -> int:
        """A number that nothing has yet."""
        self.last += 1
        return self.last

    def file(self, which: int, number: int) -> str:
        """A file to add, as a person writes it."""
        path = self.soak.folder / f"{self.at}.yaml"
        data = entry_yaml(records.replace(numbered(which, number), tags=self.known[which].tags))
        path.write_bytes(data)
        return str(path)

    def tag(self) -> Command | None:
        """``set`` with tags, which go to the entry and what is proposed for it."""
        which = self.entry_at(lambda _: True)
        if which is None:
            return None
        word = f"t{self.new()}"
        after = {which: replace(self.known[which], tags=(word,))}
        return Command("set", ("set", entry(which).id, f"tags={word}", "--yes"), after)

    def table(self) -> Command:
        """``set --table`` with notes on all of one's entries: all of them are written, or none."""
        word, path = f"n{self.new()}", self.soak.folder / f"{self.at}.csv"
        rows = "".join(f"{entry(which).id},{word}\n" for which in self.known)
        path.write_text(f"entry,notes\n{rows}")
        after = {
            which: replace(
                state, notes=(word,), proposed=(state.proposed[0], (word,)) if state.proposed else None
            )
            for which, state in self.known.items()
        }
        return Command("set --table", ("set", "--table", str(path), "--yes"), after)

    def add(self) -> Command | None:
        """``add``: a proposal beside what is in force."""
        which = self.entry_at(lambda _: True)
        if which is None:
            return None
        number = self.new()
        after = {which: replace(self.known[which], proposed=(number, ()))}
        return Command("add", ("add", self.file(which, number), "--yes"), after)

    def add_approved(self) -> Command | None:
        """``add --approve``: in force at once, also what was retired."""
        which = self.entry_at(lambda state: state.proposed is None)
        if which is None:
            return None
        number = self.new()
        after = {which: replace(self.known[which], number=number, status="approved", notes=())}
        return Command("add --approve", ("add", self.file(which, number), "--approve", "--yes"), after)

    def approve(self) -> Command | None:
        """``approve`` what is proposed."""
        which = self.entry_at(lambda state: state.proposed is not None)
        if which is None:
            return None
        path = proposal_path(entry(which).path)
        oid = open_snapshot(self.place).proposed.get(path)
        proposed = self.known[which].proposed
        if oid is None or proposed is None:
            return None
        number, notes = proposed
        state = replace(self.known[which], number=number, proposed=None, status="approved", notes=notes)
        return Command("approve", ("approve", entry(which).id, "--digest", oid[:12]), {which: state})

    def retire(self) -> Command | None:
        """``retire`` what is in force."""
        which = self.entry_at(lambda state: state.status == "approved" and state.proposed is None)
        if which is None:
            return None
        after = {which: replace(self.known[which], status="retired")}
        return Command("retire", ("retire", entry(which).id, "--reason", "lens cracked"), after)

    def exchange(self) -> Command:
        """Exchange commits with the remote, which changes nothing of one's own entries."""
        return Command("sync", ("sync",))

    def do(self, one: Command) -> None:
        """Give a command and compare what it left."""
        before = dict(self.known)
        code = self.give(one, self.place)
        found = found_in(self.place, self.own)
        after = {**before, **one.after}
        self.compared += 1
        if code == 0 and found != after:
            self.complain(one, "lost" if found == before else "half", code, found, after)
        elif code not in (0, None) and found != before:
            self.complain(one, "half", code, found, before)
        elif found not in (before, after):
            self.complain(one, "half", code, found, after)
        if code == 0 and one.kind == "sync" and found_in(self.soak.remote, self.own) != found:
            self.complain(one, "lost", code, found_in(self.soak.remote, self.own), found)
        self.known = found

    def complain(self, one: Command, what: str, code: int | None, found: States, wanted: States) -> None:
        """Count and print what is wrong."""
        self.lost += what == "lost"
        self.half += what == "half"
        for which in self.own:
            if found.get(which) != wanted.get(which):
                print(what, *one.words, "ended with", code, found.get(which), "and not", wanted.get(which))

    def give(self, one: Command, place: Path) -> int | None:
        """Run a command; its exit code, None if it was killed before its end."""
        words = (sys.executable, "-m", "calibrary", "registry", *one.words)
        named = ("--registry", str(place))
        start = time.monotonic()
        with (self.soak.folder / f"{self.at}.err").open("wb+") as said:
            process = subprocess.Popen(
                (*words, *named), start_new_session=True, stdin=subprocess.DEVNULL, stdout=said, stderr=said
            )
            usual = self.lasting.get(one.kind)
            if usual is not None and self.chance.random() < KILLED:
                life: float | None = usual * self.chance.uniform(0.3, 1.1)
            else:
                life = None
            try:
                code: int | None = process.wait(life if life is not None else HUNG_S)
            except subprocess.TimeoutExpired:
                self.hung += life is None
                with_git = life is None or self.chance.random() < 0.5
                (os.killpg if with_git else os.kill)(process.pid, signal.SIGKILL)
                process.wait()
                self.killed[one.kind] += 1
                code = None
            self.wait_for_git(process.pid)
            if code is not None:
                self.ended[one.kind] += 1
                self.refused += code != 0
                took = time.monotonic() - start
                self.lasting[one.kind] = 0.7 * (usual or took) + 0.3 * took
                said.seek(0)
                text = said.read()
                # The remote may have another's commits, and a migration may have been done before its kill.
                is_usual = code == 4 and (one.kind == "sync" or b"already" in text)
                if code and not is_usual:
                    # One's own entries are nobody else's: what is refused waits for a person.
                    self.hung += 1
                    print(*one.words, "ended with", code, text.decode().strip()[-400:], flush=True)
        return code

    def wait_for_git(self, group: int) -> None:
        """Wait until what a killed command had started has ended too."""
        until = time.monotonic() + HUNG_S
        while time.monotonic() < until:
            try:
                os.killpg(group, 0)
            except ProcessLookupError:
                return
            time.sleep(0.02)
        self.hung += 1


class Soak:
    """One run: the registry, its people, and what was found."""

    def __init__(self, folder: Path, seed: int, minutes: float, kills: int) -> None:
        self.folder, self.seed, self.kills = folder, seed, kills
        self.end = time.monotonic() + minutes * 60
        self.remote = folder / "remote.git"
        repo = create(self.remote, bare=True, durable=False)
        fill(repo, range(PEOPLE * EACH))
        repo.close()
        self.places = [folder / "fleet", folder / "other"]
        for place in self.places:
            clone(str(self.remote), place, durable=False).close()
        self.people = [Person(self, self.places[at // 2], at) for at in range(PEOPLE)]

    def is_over(self) -> bool:
        """Whether the time is over and enough were killed."""
        killed = sum(sum(one.killed.values()) for one in self.people)
        return time.monotonic() > self.end and killed >= self.kills

    def run(self) -> str:
        """Run all of it, and say what was found."""
        for one in self.people:
            one.start()
        while any(one.is_alive() for one in self.people):
            time.sleep(GC_S)
            for place in (*self.places, self.remote):
                subprocess.run(["git", "-C", str(place), "gc", "-q"], check=False, capture_output=True)
        for one in (*self.people, *self.people):
            while one.give(Command("sync", ("sync",)), one.place) is None:
                pass
        for place in (*self.places, self.remote):
            for one in self.people:
                if (found := found_in(place, one.own)) != one.known:
                    one.complain(Command("the end", (str(place),)), "lost", None, found, one.known)
            done = subprocess.run(
                ["git", "-C", str(place), "fsck", "--strict"], capture_output=True, check=False
            )
            self.people[0].half += done.returncode != 0
        self.people[0].half += not all(one.is_done for one in self.people)
        return self.said()

    def said(self) -> str:
        """What was found, in one sentence."""
        killed, ended = Counter[str](), Counter[str]()
        for one in self.people:
            killed += one.killed
            ended += one.ended
        by_kind = ", ".join(
            f"{kind} {killed[kind]} of {killed[kind] + ended[kind]}" for kind in sorted(ended)
        )
        refused, lost, half, hung, compared = (
            sum(getattr(one, name) for one in self.people)
            for name in ("refused", "lost", "half", "hung", "compared")
        )
        return (
            f"killed: {by_kind}\n{killed.total()} kills, {ended.total()} commands that ended, {refused} of them "
            f"refused, {compared} comparisons: {lost} lost, {half} half, {hung} hung"
        )


def main() -> None:
    """Run for as long as the command line says."""
    parser = argparse.ArgumentParser(
        description="Commands that are killed at random, against what they acknowledged."
    )
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--kills", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="calibrary-soak-", ignore_cleanup_errors=True) as name:
        os.environ |= {
            "XDG_CACHE_HOME": f"{name}/cache",
            "GIT_AUTHOR_NAME": "Fleet Keeper",
            "GIT_AUTHOR_EMAIL": "keeper@example.com",
            "GIT_COMMITTER_NAME": "Fleet Keeper",
            "GIT_COMMITTER_EMAIL": "keeper@example.com",
        }
        print(Soak(Path(name), given.seed, given.minutes, given.kills).run())


if __name__ == "__main__":
    main()
