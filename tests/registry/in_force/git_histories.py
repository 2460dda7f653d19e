"""Random histories of three clones with real git, in which a person knows of every commit what it must say.

What a commit must say is kept beside git, by the rules of a three-way merge, and never read from its files.
"""

from __future__ import annotations

import random
import shutil
import subprocess
from collections.abc import Callable
from datetime import UTC, date, datetime, timedelta
from pathlib import Path
from typing import Final

from msgspec import structs

from calibrary.arguments import Sides
from calibrary.records import replace, to_json
from calibrary.registry import in_force
from calibrary.registry.cache import cache_folder
from calibrary.registry.configuration import ApprovalRule, RuleSet
from calibrary.registry.entry import Entry, Status, Validity
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.git.writing import Person
from calibrary.registry.init import init
from calibrary.registry.proposals import message_of, write_changes
from calibrary.registry.registry import Registry
from calibrary.registry.statements import Signed, id_in, parse_statement, subject_of
from calibrary.registry.stating import Action, state_rules, stated
from calibrary.registry.sync import sync
from tests.registry.entries import a_change, an_entry
from tests.registry.git.repositories import git
from tests.registry.in_force.histories import REFUSED, History, day, expected

PEOPLE: Final = ("ada", "bob", "cy")
CAMERA: Final = an_entry(make="Example", model="M", focal_mm=None, distortion=None)
KEEPS: Final = ("-c", "user.name=git", "-c", "user.email=git@example.com", "-c", "core.editor=true")
Facts = frozenset[str]


class Clones:
    """The clones of three people beside a bare remote.

    Attributes:
        facts: ids of the statements that each commit must have.
        said: every statement by its id.
        fx: the K of each content, by its digest.
        done: how often what was done.
    """

    def __init__(self, folder: Path, rng: random.Random) -> None:
        self.rng, self.folder, self.hub = rng, folder, folder / "hub.git"
        self.said: dict[str, Signed] = {}
        self.facts: dict[str, Facts] = {}
        self.entries: list[Entry] = []
        self.reverted = False
        self.done: dict[str, int] = {}
        self.now = datetime(2026, 1, 1, tzinfo=UTC)
        first = init(folder / "ada").place
        yaml = first / "registry.yaml"
        yaml.write_text(f"{yaml.read_text()}approvals: {{count: 2}}\n")
        self.git("ada", "commit", "-qam", "rules")
        registry = Registry.open(first, durable=False)
        rules = state_rules(registry.snapshot(), registry.configuration.rules, None)
        write_changes(registry.repo, rules.changes, message_of("rules"))
        founding = registry.snapshot().book.rulebook.founding
        # The model's rules without keys change by nobody: they are two approvals from the start.
        two = RuleSet(approvals=ApprovalRule(count=2))
        self.rules = [structs.replace(founding, body=structs.replace(founding.body, terms=to_json(two)))]
        git(folder, "clone", "-q", "--bare", str(first), "hub.git")
        self.git("ada", "remote", "add", "origin", str(self.hub))
        for who in PEOPLE[1:]:
            git(folder, "clone", "-q", str(self.hub), who)
        for who in PEOPLE:
            self.git(who, "fetch", "-q", "origin")
            self.git(who, "branch", "-q", "--set-upstream-to=origin/main")
        self.facts[self.head("ada")] = frozenset()

    def git(self, who: str, *words: str) -> str:
        return git(self.folder / who, *KEEPS, *words)

    def tries(self, who: str, *words: str) -> bool:
        """Whether git can do that."""
        done = subprocess.run(
            ["git", "-C", str(self.folder / who), *KEEPS, *words], capture_output=True, check=False
        )
        return done.returncode == 0

    def head(self, who: str, rev: str = "HEAD") -> str:
        return self.git(who, "rev-parse", rev)

    def theirs(self, who: str) -> str:
        self.git(who, "fetch", "-q", "origin")
        return self.head(who, "origin/main")

    def merged(self, who: str, ours: str, theirs: str) -> Facts:
        """What a three-way merge of two commits must say."""
        base = self.facts[self.git(who, "merge-base", ours, theirs)]
        one, other = self.facts[ours], self.facts[theirs]
        return (one & other) | (one - base) | (other - base)

    def is_crossed(self, who: str, theirs: str) -> bool:
        """Whether there are several bases, so that a merge of a revert may turn out either way."""
        return self.reverted and len(self.git(who, "merge-base", "--all", "HEAD", theirs).split()) > 1

    def write(self, who: str, entry: Entry) -> None:
        """An entry's file, by hand."""
        before, file = self.facts[self.head(who)], self.folder / who / entry.path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(entry_yaml(entry))
        self.git(who, "add", "-A")
        if self.tries(who, "commit", "-qm", "by hand"):
            self.facts[self.head(who)] = before

    def propose(self, who: str) -> None:
        fx = 3000.0 + len(self.entries)
        calibration, rng = CAMERA.calibration, self.rng
        K = replace(calibration.intrinsics, fx=fx, fy=fx)
        made = replace(calibration.provenance, date=day(rng.choice((5, 5, 9))).isoformat())
        first = rng.choice((None, None, day(10), day(20)))
        last = None if rng.random() < 0.8 else day(rng.choice((15, 35)))
        entry = replace(
            CAMERA,
            calibration=replace(calibration, intrinsics=K, provenance=made),
            validity=Validity.between(first, last)
            if first is None or last is None or first <= last
            else None,
        )
        self.entries.append(entry)
        self.write(who, entry)

    def edit(self, who: str) -> None:
        if self.entries:
            entry = self.rng.choice(self.entries)
            self.write(who, replace(entry, tolerance=self.rng.choice((0.01, 0.02))))

    def state(self, who: str, action: Action, start: date | None = None) -> None:
        """What the file of this clone says is approved, or its camera retired."""
        before, registry = self.facts[self.head(who)], self.opened(who)
        file = registry.snapshot().file(CAMERA.path)
        if file is None or (action == "retire" and not before):
            return
        self.now += timedelta(seconds=1)
        person = Person(name=who, email=f"{who}@example.com")
        change = a_change(action, replace(file, status=Status.APPROVED, reason="looked at"), start=start)
        found = stated(registry.snapshot(), [change], author=person, now=self.now)
        write_changes(registry.repo, found.changes, message_of(action))
        new = [parse_statement(one.path, one.data or b"") for one in found.changes]
        self.said |= {one.id: one for one in new if isinstance(one, Signed)}
        self.facts[self.head(who)] = before | {one.id for one in new}

    def approve(self, who: str) -> None:
        self.state(who, "approve")

    def retire(self, who: str) -> None:
        self.state(who, "retire", self.rng.choice((None, day(20), day(30))))

    def opened(self, who: str) -> Registry:
        """The registry, by a reader who has not seen it before."""
        shutil.rmtree(cache_folder(), ignore_errors=True)
        return Registry.open(self.folder / who, durable=False)

    def push(self, who: str) -> None:
        assert self.tries(who, "push", "-q", "origin", "HEAD:main")

    def merge(self, who: str) -> None:
        """A merge as a person or a code host makes it, who clicks a side of the camera's file."""
        theirs, ours = self.theirs(who), self.head(who)
        if self.is_crossed(who, theirs):
            return
        must = self.merged(who, ours, theirs)
        if not self.tries(who, "merge", "-q", "--no-edit", theirs):
            self.clicked(who)
            self.git(who, "commit", "-q", "--no-edit")
        self.facts[self.head(who)] = must
        self.push(who)

    def clicked(self, who: str) -> None:
        """The conflicts of a merge; a removed statement has none."""
        for path in self.git(who, "diff", "--name-only", "--diff-filter=U").split():
            assert path == CAMERA.path, path
            side = self.rng.choice(("--ours", "--theirs"))
            if self.tries(who, "checkout", side, "--", path):
                self.git(who, "add", path)
            else:
                self.git(who, "rm", "-q", path)

    def squash(self, who: str) -> None:
        """A pull request that its host squashes; the person goes on from it."""
        theirs, ours = self.theirs(who), self.head(who)
        if self.is_crossed(who, theirs):
            return
        must = self.merged(who, ours, theirs)
        if not self.tries(who, "merge", "-q", "--no-edit", theirs):
            self.clicked(who)
            self.git(who, "commit", "-q", "--no-edit")
        new = self.git(who, "commit-tree", "HEAD^{tree}", "-p", theirs, "-m", "squashed")
        self.git(who, "reset", "-q", "--hard", new)
        self.facts[new] = must
        self.push(who)

    def rebase(self, who: str) -> None:
        theirs = self.theirs(who)
        must = self.facts[theirs]
        own = self.git(who, "rev-list", "--reverse", "--no-merges", f"{theirs}..HEAD").split()
        for one in own:
            before, after = self.facts[self.head(who, f"{one}^")], self.facts[one]
            must = (must - (before - after)) | (after - before)
        side = self.rng.choice(("ours", "theirs"))
        if self.tries(who, "rebase", "-q", "--reapply-cherry-picks", "-X", side, theirs):
            self.facts[self.head(who)] = must
            self.push(who)
        else:
            self.git(who, "rebase", "--abort")

    def known(self, who: str, *which: str) -> list[str]:
        """Commits of which it is known what they do; of those that were made again in one go it is not."""
        pairs = [
            line.split()
            for line in self.git(who, "rev-list", "--no-merges", "--parents", *which).splitlines()
        ]
        return [pair[0] for pair in pairs if len(pair) == 2 and self.facts.keys() >= {*pair}]

    def pick(self, who: str) -> None:
        """A commit of another clone, that comes by the remote once more."""
        other = self.rng.choice([one for one in PEOPLE if one != who])
        self.git(who, "fetch", "-q", str(self.folder / other), "HEAD")
        some = self.known(who, "--max-count=5", "FETCH_HEAD", "^HEAD")
        if not some:
            return
        one, now = self.rng.choice(some), self.facts[self.head(who)]
        before, after = self.facts[self.head(who, f"{one}^")], self.facts[one]
        if self.tries(who, "cherry-pick", "-X", self.rng.choice(("ours", "theirs")), one):
            self.facts[self.head(who)] = (now - (before - after)) | (after - before)
        elif not self.tries(who, "cherry-pick", "--abort"):
            self.git(who, "reset", "-q", "--hard")

    def revert(self, who: str) -> None:
        some = self.known(who, "--max-count=4", "HEAD")
        if not some:
            return
        one, now = self.rng.choice(some), self.facts[self.head(who)]
        before, after = self.facts[self.head(who, f"{one}^")], self.facts[one]
        if self.tries(who, "revert", "--no-edit", one):
            self.reverted = self.reverted or before != after
            self.facts[self.head(who)] = (now - (after - before)) | (before - after)
        elif not self.tries(who, "revert", "--abort"):
            self.git(who, "reset", "-q", "--hard")

    def sync(self, who: str) -> None:
        """The command."""
        theirs, ours = self.theirs(who), self.head(who)
        if self.is_crossed(who, theirs):
            return
        must = self.merged(who, ours, theirs)
        sides = Sides(**{self.rng.choice(("ours", "theirs")): ("all",)})
        repo = self.opened(who).repo
        done = sync(repo)
        if done.conflicts:
            done = sync(repo, sides=sides)
        assert done.is_good, done
        self.facts[self.head(who)] = must

    def play(self, steps: int) -> None:
        """Do things in any order, then let everybody exchange what they have."""
        acts: dict[Callable[[str], None], float] = {
            self.propose: 2,
            self.approve: 8,
            self.retire: 0.6,
            self.edit: 0.5,
            self.sync: 2.5,
            self.merge: 1.5,
            self.squash: 1.2,
            self.rebase: 1.2,
            self.pick: 1,
            self.revert: 0.5,
        }
        self.propose("ada")
        self.sync("ada")
        for who in PEOPLE[1:]:
            self.sync(who)
        for _ in range(steps):
            act = self.rng.choices([*acts], [*acts.values()])[0]
            act(self.rng.choice(PEOPLE))
            self.done[act.__name__] = self.done.get(act.__name__, 0) + 1

    def history(self, who: str) -> History:
        """What a clone must say, for the model."""
        facts = self.facts[self.head(who)]
        return History([self.said[one] for one in sorted(facts)], self.rules, [])

    @property
    def everything(self) -> Facts:
        """The ids of all statements."""
        return frozenset(self.said)

    def files(self, who: str) -> Facts:
        """The ids of the statements on the camera that a clone has."""
        return frozenset(map(id_in, self.git(who, "ls-files", f"events/{subject_of(CAMERA.path)}").split()))

    def is_torn(self, who: str) -> bool:
        """Whether two contents of equal rank are in force on some day, so that nobody can say which."""
        return REFUSED in expected(self.history(who), in_force, range(-1, 61)).values()
