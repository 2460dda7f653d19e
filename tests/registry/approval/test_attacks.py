"""What is done to approvals by plain git, on purpose or by accident, and what every reader answers then.

Every case is one camera of one registry, so that each reader runs once over all of them: two of Ada, Bob and Cy
approve, with their keys; who attacks can push, and has the key of at most one of them.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from datetime import date
from pathlib import Path

import pytest
from msgspec import structs

from calibrary.errors import RegistryError, UnknownCameraError
from calibrary.jobs.fleet import Fleet
from calibrary.known_camera import hashed
from calibrary.records import replace
from calibrary.registry import in_force, standing
from calibrary.registry.entry import Alias, Entry, Status, Validity
from calibrary.registry.git.writing import Person
from calibrary.registry.proposals import message_of, propose_approvals, save, write_changes
from calibrary.registry.registry import Registry
from calibrary.registry.sshsig import Signer
from calibrary.registry.statements import NAMESPACE, RULES, Body, approved_of, subject_of
from calibrary.registry.stating import state_rules
from tests.registry.approval.attacked import (
    PEOPLE,
    REFUSED,
    Answer,
    Desk,
    answers,
    camera,
    copied,
    founded,
    keys_in,
    pictures,
    with_fx,
)
from tests.registry.git.repositories import git, seclude

Attack = Callable[[Desk, Entry], object]
OLD = "old"
"""The K that was approved before the attack."""
NEW = "new"
"""The K of the newer revision that was approved before the attack."""
OWN = ("approved", "retired", "renewed", "proposed")


def copy_in(desk: Desk, entry: Entry) -> None:
    desk.put(with_fx(entry))


def restore(desk: Desk, entry: Entry) -> None:
    desk.put(entry)


def forged(key: str | None, *people: str) -> Attack:
    """A newer K with approvals of people, all signed by one key, or by none."""

    def attack(desk: Desk, entry: Entry) -> None:
        new = with_fx(entry)
        desk.put(new)
        for person in people:
            desk.forge(desk.body(new, person=person, email=f"{person}@example.com"), key)

    return attack


def edit(old: bytes, new: bytes, action: str = "retire") -> Attack:
    """A statement changed in place, and the former file brought back."""

    def attack(desk: Desk, entry: Entry) -> None:
        [file] = desk.statements(entry, action)
        data = file.read_bytes()
        assert old in data
        file.write_bytes(data.replace(old, new))
        desk.put(entry)

    return attack


def strip(desk: Desk, entry: Entry) -> None:
    [file] = desk.statements(entry, "retire")
    file.write_bytes(file.read_bytes().partition(b"-----BEGIN")[0])
    desk.put(entry)


def resign(desk: Desk, entry: Entry) -> None:
    [file] = desk.statements(entry, "retire")
    text = file.read_bytes().partition(b"-----BEGIN")[0]
    file.write_bytes(text + Signer(str(desk.keys / "eve")).sign(text, NAMESPACE).encode())
    desk.put(entry)


def rename(desk: Desk, entry: Entry) -> None:
    [file] = desk.statements(entry, "retire")
    file.rename(file.with_name("0" * 32))
    desk.put(entry)


def remove(action: str, *which: int) -> Attack:
    """Statements removed."""

    def attack(desk: Desk, entry: Entry) -> None:
        for number, file in enumerate(desk.statements(entry, action)):
            if number in which:
                file.unlink()

    return attack


def from_another(desk: Desk, entry: Entry) -> None:
    """A new camera with the statements of an approved one."""
    other = camera(1)
    desk.put(entry)
    folder = desk.fleet / "events" / entry.path.removesuffix(".yaml")
    folder.mkdir(parents=True)
    for file in desk.statements(other):
        shutil.copy(file, folder)


def roll_back(desk: Desk, entry: Entry) -> None:
    desk.put(entry)


def roll_back_with_one_approval(desk: Desk, entry: Entry) -> None:
    desk.put(entry)
    desk.forge(desk.body(entry), "ada")


def in_by_one(desk: Desk, entry: Entry) -> None:
    new = with_fx(entry)
    desk.put(new)
    desk.forge(desk.body(new), "ada")


def under(**more: str) -> Attack:
    """A newer K, approved by two with their own keys, but for another registry."""

    def attack(desk: Desk, entry: Entry) -> None:
        new = with_fx(entry)
        desk.put(new)
        for person in ("ada", "bob"):
            desk.forge(desk.body(new, person=person, **more), person)

    return attack


def in_parallel(desk: Desk, entry: Entry) -> None:
    """A newer K, approved by two who did not know that it was retired."""
    new = with_fx(entry)
    assert desk.statements(entry, "retire")
    desk.put(new)
    for person in ("ada", "bob"):
        desk.forge(desk.body(new, person=person, restores=()), person)


def written(name: str, data: bytes) -> Attack:
    """Something else among the statements."""

    def attack(desk: Desk, entry: Entry) -> None:
        folder = desk.fleet / "events" / entry.path.removesuffix(".yaml")
        (folder / name).write_bytes(data)

    return attack


def fields(**more: object) -> Attack:
    """Fields that decide which image gets the K, or what passes, changed by hand."""

    def attack(desk: Desk, entry: Entry) -> None:
        desk.put(replace(entry, **more))

    return attack


def content(data: bytes) -> Attack:
    def attack(desk: Desk, entry: Entry) -> None:
        (desk.fleet / entry.path).write_bytes(data)

    return attack


def as_a_link(desk: Desk, entry: Entry) -> None:
    (desk.fleet / entry.path).unlink()
    (desk.fleet / entry.path).symlink_to("/etc/hostname")


def remove_file(desk: Desk, entry: Entry) -> None:
    (desk.fleet / entry.path).unlink()


def of_another(desk: Desk, entry: Entry) -> None:
    """Two approve the K of another camera as this one's, which readers would not give to its images."""
    other = approved_of(camera(1))
    for person in ("ada", "eve"):
        desk.forge(desk.body(entry, person=person, content=other), person)


def forged_ending(desk: Desk, entry: Entry) -> None:
    desk.forge(desk.body(entry, "retire"), "eve")


def mixed(desk: Desk, entry: Entry) -> None:
    """Ada has approved what was proposed; then the proposal is another one, and Bob approves that."""
    other = with_fx(entry)
    desk.put(other)
    desk.forge(desk.body(other, person="bob", email="bob@example.com"), "bob")


CASES: dict[str, tuple[str, Attack, str | None]] = {
    "a newer K is copied in": ("approved", copy_in, OLD),
    "a new camera is copied in": ("", restore, None),
    "a newer K with approvals that nobody signed": ("approved", forged(None, "ada", "bob"), OLD),
    "a stranger signs as two of them": ("approved", forged("eve", "ada", "bob"), OLD),
    "a stranger signs as a stranger": ("approved", forged("eve", "eve", "mallory"), OLD),
    "one key signs as three people": ("approved", forged("ada", "ada", "bob", "cy"), OLD),
    "one person approves twice": ("approved", forged("ada", "ada", "ada"), OLD),
    "one approves, and the file is moved in by hand": ("approved", in_by_one, OLD),
    "a new camera with one approval of two": ("", in_by_one, None),
    "a status of retired is written by hand": ("approved", fields(status=Status.RETIRED), OLD),
    "what was retired is brought back by hand": ("retired", restore, None),
    "what was retired is brought back with a newer K": ("retired", copy_in, None),
    "the retirement is approved away by one": ("retired", roll_back_with_one_approval, None),
    "retired while two approved something newer": ("retired", in_parallel, None),
    "one of two approvals is removed": ("approved", remove("approve", 1), None),
    "both approvals are removed": ("approved", remove("approve", 0, 1), None),
    "the approvals of another camera are copied": ("", from_another, None),
    "a file goes back to its former K": ("renewed", roll_back, NEW),
    "one approves the former K again": ("renewed", roll_back_with_one_approval, NEW),
    "approved for another registry": ("approved", under(registry="0" * 32), OLD),
    "a file among the statements is none": ("approved", written("a" * 32, b""), OLD),
    "a statement is much too large": ("approved", written("b" * 32, b"x" * (2 << 20)), OLD),
    "a statement is deep": ("approved", written("c" * 32, b"[" * 100_000), OLD),
    "a statement's name is not one": ("approved", written("notes", b"{}"), OLD),
    "its file is removed": ("approved", remove_file, OLD),
    "an approval is of another camera": ("approved", of_another, OLD),
    "the file is garbage": ("approved", content(b"\x00no yaml"), OLD),
    "the file is empty": ("approved", content(b""), OLD),
    "the file is much too large": ("approved", content(b"# " + b"x" * (2 << 20)), OLD),
    "its numbers are edited without their digest": ("approved", content(b"fx: 1"), OLD),
    "a link is in its place": ("approved", as_a_link, OLD),
    "an alias is added by hand": ("approved", fields(aliases=(Alias(make="Example", model="M77"),)), OLD),
    "its days are widened by hand": ("ended", fields(validity=None), OLD),
    "its tolerance is raised by hand": ("approved", fields(tolerance=0.9), OLD),
    "a contradiction is overridden by hand": ("approved", fields(override="trust me"), OLD),
    "it is to supersede another by hand": ("approved", fields(supersedes="example/m01/4000x3000"), OLD),
    "what two approved is not one content": ("proposed", mixed, None),
}
"""Name, what was stated before, what is done, and the K that readers answer with; None is that none may be used."""

DAMAGED: dict[str, tuple[str, Attack]] = {
    "the signature of a retirement is damaged": ("retired", edit(b"AAAA", b"AAAB")),
    "the signature of a retirement is taken off": ("retired", strip),
    "a retirement is signed by a stranger instead": ("retired", resign),
    "a retirement says something else": ("retired", edit(b"looked at", b"looked up")),
    "a retirement has another name": ("retired", rename),
    "line ends of a statement are converted": ("retired", edit(b"\n", b"\r\n")),
    "a stranger states that it is retired": ("approved", forged_ending),
    "a file with the name of a retirement is none": (
        "approved",
        written(f"2026-05-01-retire-ada-{'a' * 32}.json", b""),
    ),
}
"""The same for what may hide that an approval has ended: the entry is refused, and nothing else is."""


@pytest.fixture(scope="module", autouse=True)
def secluded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        seclude(patch, tmp_path_factory.mktemp("home"))
        yield


@pytest.fixture(scope="module")
def keys(tmp_path_factory: pytest.TempPathFactory, secluded: None) -> Path:  # noqa: ARG001  before it
    return keys_in(tmp_path_factory.mktemp("keys"))


def before(name: str, number: int) -> Entry:
    """The camera of a case, as it was first approved."""
    is_ended = name == "ended"
    return camera(number, validity=Validity(last=date(2026, 5, 1))) if is_ended else camera(number)


def prepared(desk: Desk, stories: list[tuple[str, Entry]]) -> None:
    """State what was stated before the attacks, each person in one commit."""
    every = {
        name: [entry for story, entry in stories if story == name] for name in {one for one, _ in stories}
    }
    desk.approves(*(entry for story, entry in stories if story and story != "proposed"))
    desk.states("ada", *(("approve", entry) for entry in every.get("proposed", ())), files=False)
    for who in ("ada", "bob"):
        desk.states(who, *(("approve", with_fx(entry, 7.0)) for entry in every.get("renewed", ())))
    desk.states(
        "cy", *(("retire", replace(entry, status=Status.RETIRED)) for entry in every.get("retired", ()))
    )


@pytest.fixture(scope="module")
def stories() -> list[tuple[str, Entry]]:
    told = [story for story, *_ in CASES.values()] + [story for story, _ in DAMAGED.values()]
    return [
        ("approved", camera(1)),
        *((one, before(one, number)) for number, one in enumerate(told, start=2)),
    ]


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory, keys: Path, stories: list[tuple[str, Entry]]) -> Desk:
    """A registry before anything was done to it."""
    desk = founded(tmp_path_factory.mktemp("template") / "fleet", keys)
    prepared(desk, stories)
    assert Fleet(desk.fleet).check().is_good
    return desk


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory, keys: Path) -> Desk:
    """The same with one camera."""
    desk = founded(tmp_path_factory.mktemp("small") / "fleet", keys)
    desk.approves(camera(1))
    return desk


@pytest.fixture(scope="module")
def said(
    tmp_path_factory: pytest.TempPathFactory, template: Desk, stories: list[tuple[str, Entry]]
) -> dict[str, dict[str, Answer]]:
    """What every reader answers after all attacks whose entries can be answered for."""
    folder = tmp_path_factory.mktemp("attacked")
    desk = copied(template, folder / "fleet")
    own = stories[1 : 1 + len(CASES)]
    for (_, attack, _), (_, entry) in zip(CASES.values(), own, strict=True):
        attack(desk, entry)
    desk.commit()
    shown = [entry for _, entry in own]
    return answers(desk.fleet, pictures(folder / "flight", shown), folder / "out")


@pytest.mark.parametrize("number", range(len(CASES)), ids=CASES)
def test_readers_answer_with_what_is_properly_approved(
    said: dict[str, dict[str, Answer]], stories: list[tuple[str, Entry]], number: int
) -> None:
    entry = stories[1 + number][1]
    fx, expected = entry.calibration.intrinsics.fx, [*CASES.values()][number][2]
    right = {OLD: fx, NEW: fx + 7.0}.get(expected or "")
    model = entry.calibration.camera.model or ""
    # The flights are of a day on which that camera's K is over.
    dated = ("resolve", "audit", "extract") if entry.validity is not None else ()
    found = {reader: those.get(model, those.get("*")) for reader, those in said.items()}
    assert found == {reader: None if reader in dated else right for reader in said}


@pytest.mark.thorough
def test_none_of_it_passes_the_check(
    template: Desk, tmp_path: Path, stories: list[tuple[str, Entry]]
) -> None:
    desk = copied(template, tmp_path / "fleet")
    own = stories[1 : 1 + len(CASES)]
    for (_, attack, _), (_, entry) in zip(CASES.values(), own, strict=True):
        attack(desk, entry)
    desk.commit()
    for found in (Fleet(desk.fleet).check(), Fleet(desk.fleet).check("HEAD~1..HEAD")):
        told = {finding.place for finding in found.findings}
        subjects = {place.removeprefix("events/").rpartition("/")[0] + ".yaml" for place in told if place}
        missed = [
            name for name, (_, entry) in zip(CASES, own, strict=True) if entry.path not in told | subjects
        ]
        assert missed == []


@pytest.mark.parametrize("span", [None, "HEAD~1..HEAD"])
def test_a_link_in_place_of_a_statement_is_an_error_of_its_path(
    small: Desk, tmp_path: Path, span: str | None
) -> None:
    desk = copied(small, tmp_path / "fleet")
    file = desk.statements(camera(1), "approve")[0]
    file.rename(tmp_path / "elsewhere")
    file.symlink_to(tmp_path / "elsewhere")
    desk.commit()
    found = Fleet(desk.fleet).check(*filter(None, [span]))
    place = file.relative_to(desk.fleet).as_posix()
    assert ("regular-file", place) in {(one.rule, one.place) for one in found.errors}


@pytest.fixture(scope="module")
def damaged(
    tmp_path_factory: pytest.TempPathFactory, template: Desk, stories: list[tuple[str, Entry]]
) -> tuple[Desk, Path]:
    folder = tmp_path_factory.mktemp("damaged")
    desk = copied(template, folder / "fleet")
    own = stories[1 + len(CASES) :]
    for (_, attack), (_, entry) in zip(DAMAGED.values(), own, strict=True):
        attack(desk, entry)
    desk.commit()
    return desk, pictures(folder / "flight", [entry for _, entry in (stories[0], *own)])


@pytest.fixture(scope="module")
def damaged_said(damaged: tuple[Desk, Path]) -> dict[str, dict[str, Answer]]:
    desk, flight = damaged
    return answers(desk.fleet, flight, flight.parent / "out")


class TestDamaged:
    @pytest.mark.parametrize("number", range(len(DAMAGED)), ids=DAMAGED)
    def test_an_entry_is_refused_where_nobody_can_say_whether_its_approval_ended(
        self, damaged_said: dict[str, dict[str, Answer]], stories: list[tuple[str, Entry]], number: int
    ) -> None:
        model = stories[1 + len(CASES) + number][1].calibration.camera.model or ""
        found = {reader: those.get(model, those.get("*")) for reader, those in damaged_said.items()}
        # An audit, an extract, an export and a lock go on without that entry, and give no K of it.
        assert set(found.values()) <= {REFUSED, None}, found
        assert {found[reader] for reader in ("resolve", "python", "show", "list")} == {REFUSED}

    def test_no_other_entry_is(self, damaged_said: dict[str, dict[str, Answer]]) -> None:
        single = {reader: those["M01"] for reader, those in damaged_said.items() if "*" not in those}
        assert {*single} == {*damaged_said}
        assert set(single.values()) == {3001.0}

    def test_the_check_says_where(self, damaged: tuple[Desk, Path], stories: list[tuple[str, Entry]]) -> None:
        found = Fleet(damaged[0].fleet).check()
        told = {finding.place for finding in found.errors}
        assert {entry.path for _, entry in stories[1 + len(CASES) :]} <= told


class TestHistory:
    """A history that is written anew, or cut, keeps the approvals: they are content."""

    @pytest.mark.parametrize("how", ["squash", "rebase", "shallow", "orphan"])
    def test_approvals_survive(self, small: Desk, tmp_path: Path, how: str) -> None:
        desk = copied(small, tmp_path / "fleet")
        before = {one.path: one.entry for one in Fleet(desk.fleet).snapshot.entries()}
        if how == "squash":
            root = git(desk.fleet, "rev-list", "--max-parents=0", "HEAD")
            git(desk.fleet, "reset", "-q", "--soft", root)
            git(desk.fleet, "commit", "-qm", "squashed")
        elif how == "orphan":
            tree = git(desk.fleet, "commit-tree", "HEAD^{tree}", "-m", "new")
            git(desk.fleet, "reset", "-q", "--hard", tree)
        elif how == "rebase":
            git(desk.fleet, "rebase", "-q", "--root", "--force-rebase")
        else:
            git(tmp_path, "clone", "-q", "--depth", "1", f"file://{desk.fleet}", "cut")
            desk = Desk(tmp_path / "cut", desk.keys)
        assert {one.path: one.entry for one in Fleet(desk.fleet).snapshot.entries()} == before
        assert Fleet(desk.fleet).check().is_good

    def test_a_cherry_picked_approval_is_one(self, small: Desk, tmp_path: Path) -> None:
        desk, entry = copied(small, tmp_path / "fleet"), with_fx(camera(1), 3.0)
        start = git(desk.fleet, "rev-parse", "HEAD")
        desk.approves(entry)
        new = git(desk.fleet, "rev-list", "--reverse", f"{start}..HEAD").split()
        git(desk.fleet, "reset", "-q", "--hard", start)
        fresh = copied(desk, tmp_path / "picked")
        git(fresh.fleet, "cherry-pick", *new)
        assert fx_of(fresh) == entry.calibration.intrinsics.fx

    def test_what_is_approved_needs_no_file_and_no_history(self, small: Desk, tmp_path: Path) -> None:
        desk, entry = copied(small, tmp_path / "fleet"), camera(1)
        desk.put(with_fx(entry))
        desk.commit()
        git(tmp_path, "clone", "-q", "--depth", "1", f"file://{desk.fleet}", "cut")
        assert fx_of(Desk(tmp_path / "cut", desk.keys)) == 3001.0


def fx_of(desk: Desk, key: str = "example/m01") -> Answer:
    try:
        entry = Fleet(desk.fleet).show(key).stored.entry  # type: ignore[union-attr]
    except RegistryError:
        return REFUSED
    return entry.calibration.intrinsics.fx if entry.is_usable else None


class TestWhoHasReadIt:
    """A reader that keeps what it has read sees what the tree alone does not show."""

    def act(self, desk: Desk, what: str) -> None:
        entry = camera(1)
        if what == "the retirement is removed":
            desk.states("cy", ("retire", replace(entry, status=Status.RETIRED)))
            assert fx_of(desk) is None
            [file] = desk.statements(entry, "retire")
            file.unlink()
            desk.put(entry)
            desk.commit()
        elif what == "a force push takes the retirement back":
            start = git(desk.fleet, "rev-parse", "HEAD")
            desk.states("cy", ("retire", replace(entry, status=Status.RETIRED)))
            assert fx_of(desk) is None
            git(desk.fleet, "reset", "-q", "--hard", start)
        else:
            fx_of(desk)
            git(desk.fleet, "rm", "-rq", "events")
            body = desk_of_eve(desk)
            desk.forge(body, "eve")
            desk.commit()

    @pytest.mark.parametrize(
        "what",
        [
            "the retirement is removed",
            "a force push takes the retirement back",
            "another foundation takes the place of the first",
        ],
    )
    def test_it_refuses_and_one_who_reads_it_for_the_first_time_cannot(
        self, small: Desk, tmp_path: Path, what: str
    ) -> None:
        desk = copied(small, tmp_path / "fleet")
        self.act(desk, what)
        assert fx_of(desk) == REFUSED
        # The known limit: nothing in the tree shows it.
        first = copied(desk, tmp_path / "first")
        assert fx_of(first) != REFUSED


def told_of(desk: Desk, entry: Entry) -> list[str]:
    """What the check says of the statements on an entry."""
    findings = Fleet(desk.fleet).check().findings
    return [one.message for one in findings if subject_of(entry.path) in (one.place or "")]


def merged(desk: Desk, other: Desk) -> None:
    """Two registries come together by plain git; of files that both changed, the first one's count."""
    git(desk.fleet, "fetch", "-q", str(other.fleet), "HEAD")
    git(desk.fleet, "merge", "-q", "-X", "ours", "--no-edit", "FETCH_HEAD")


def desk_of_eve(desk: Desk) -> Body:
    key = (desk.keys / "eve.pub").read_text().strip()
    terms = {"people": [{"name": "eve", "keys": [key]}], "approvals": {"count": 1}}
    return Body(action="found", subject=RULES, terms=terms, person="eve", made="2026-05-01T10:00:00+00:00")


class TestRules:
    def approved_by_one(self, desk: Desk, who: str, **more: str) -> None:
        new = with_fx(camera(1))
        desk.put(new)
        desk.forge(desk.body(new, person=who, email=f"{who}@example.com", **more), who)
        desk.commit()

    def test_rules_relaxed_by_hand_approved_and_restored_approve_nothing(
        self, small: Desk, tmp_path: Path
    ) -> None:
        desk = copied(small, tmp_path / "fleet")
        text = (desk.fleet / "registry.yaml").read_text()
        desk.asks("approvals: {count: 1}\n")
        self.approved_by_one(desk, "ada")
        (desk.fleet / "registry.yaml").write_text(text)
        desk.commit()
        assert fx_of(desk) == 3001.0

    def test_rules_are_changed_by_two_and_by_one_are_not(self, small: Desk, tmp_path: Path) -> None:
        desk = copied(small, tmp_path / "fleet")
        desk.asks("approvals: {count: 1}\n", "ada")
        self.approved_by_one(desk, "ada")
        assert fx_of(desk) == 3001.0
        registry = desk.by("bob")
        found = state_rules(registry.snapshot(), registry.configuration.rules, None)
        write_changes(registry.repo, found.changes, message_of("bob"))
        # What one approved before is enough now.
        assert fx_of(desk) == 3501.0

    def test_who_has_left_approves_nothing_under_the_former_rules(self, small: Desk, tmp_path: Path) -> None:
        desk = copied(small, tmp_path / "fleet")
        desk.asks("approvals: {count: 1}\n", "ada", "bob", people=("ada", "bob"))
        self.approved_by_one(desk, "cy")
        assert fx_of(desk) == 3001.0
        assert Fleet(desk.fleet).check().errors

    def test_an_address_is_no_approval_where_people_have_keys(self, small: Desk, tmp_path: Path) -> None:
        desk, new = copied(small, tmp_path / "fleet"), with_fx(camera(1))
        desk.asks('approvals: {by: ["ada"], count: 1}\n', "ada", "bob")
        desk.put(new)
        desk.forge(desk.body(new, person="cy", email="ada"), "cy")
        desk.commit()
        assert fx_of(desk) == 3001.0

    def test_who_has_left_retires_nothing_under_the_former_rules(self, small: Desk, tmp_path: Path) -> None:
        desk = copied(small, tmp_path / "fleet")
        desk.asks("approvals: {count: 1}\n", "ada", "bob", people=("ada", "bob"))
        desk.forge(desk.body(camera(1), "retire", person="cy"), "cy")
        desk.commit()
        assert fx_of(desk) == 3001.0
        assert any("by a key of nobody in those in force" in why for why in told_of(desk, camera(1)))
        desk.forge(desk.body(camera(1), "retire", person="bob"), "bob")
        desk.commit()
        assert fx_of(desk) is None

    def test_who_was_taken_out_does_not_come_back_by_a_change_in_an_older_clone(
        self, small: Desk, tmp_path: Path
    ) -> None:
        desk = copied(small, tmp_path / "fleet")
        desk.asks("approvals: {count: 1}\n", "ada", "bob")
        older = copied(desk, tmp_path / "older")
        desk.asks("approvals: {count: 1}\n", "ada", people=("ada", "bob"))
        older.asks("approvals: {count: 1}\n", "cy", people=("cy",))
        assert fx_of(desk) == 3001.0
        followed = Registry.open(desk.fleet).snapshot().book.rulebook.current
        merged(desk, older)
        self.approved_by_one(desk, "cy")
        assert Registry.open(desk.fleet).snapshot().book.rulebook.current == followed
        assert fx_of(desk) == 3001.0
        first = copied(desk, tmp_path / "first")
        with pytest.raises(RegistryError, match=r"take out each other's signers.*remove the file"):
            Fleet(first.fleet).check()
        desk.asks("approvals: {count: 2}\n", "ada", people=("ada", "bob"))
        assert Registry.open(desk.fleet).snapshot().book.rulebook.current != followed

    def test_a_change_that_takes_a_signer_of_another_one_out_goes_before_it(
        self, small: Desk, tmp_path: Path
    ) -> None:
        desk = copied(small, tmp_path / "fleet")
        older = copied(desk, tmp_path / "older")
        desk.asks("approvals: {count: 2}\n", "ada", "bob", people=("ada", "bob"))
        older.asks("approvals: {count: 1}\n", "bob", "cy")
        merged(desk, older)
        first = Registry.open(copied(desk, tmp_path / "first").fleet).snapshot().book.rulebook
        assert [one.name for one in first.people.rules.people] == ["ada", "bob"]

    def test_a_stranger_changes_no_rules(self, small: Desk, tmp_path: Path) -> None:
        desk = copied(small, tmp_path / "fleet")
        book = Registry.open(desk.fleet).snapshot().book.rulebook
        body = structs.replace(
            desk_of_eve(desk), action="rules", registry=book.foundation, previous=book.current
        )
        desk.forge(body, "eve")
        desk.commit()
        self.approved_by_one(desk, "eve")
        assert fx_of(desk) == 3001.0

    def test_two_changes_at_the_same_time_change_nothing(self, small: Desk, tmp_path: Path) -> None:
        desk = copied(small, tmp_path / "fleet")
        before = Registry.open(desk.fleet).snapshot().book.rulebook
        for count in (1, 3):
            base = desk_of_eve(desk)
            people = [
                {"name": one, "keys": [(desk.keys / f"{one}.pub").read_text().strip()]} for one in PEOPLE
            ]
            terms = {"people": people, "approvals": {"count": count}}
            for who in ("ada", "bob"):
                more = {"action": "rules", "terms": terms, "person": who}
                desk.forge(
                    structs.replace(base, registry=before.foundation, previous=before.current, **more), who
                )
        desk.commit()
        after = Registry.open(desk.fleet).snapshot().book.rulebook
        assert after.current == before.current
        assert any("neither counts" in why for _, why in after.problems)
        desk.asks('approvals: {by: ["ada", "bob"], count: 2}\n', "ada", "bob")
        third = Registry.open(copied(desk, tmp_path / "first").fleet).snapshot().book.rulebook
        assert third.people.rules.approvals.by == ("ada", "bob")

    def test_without_its_statements_a_registry_answers_nothing(self, small: Desk, tmp_path: Path) -> None:
        desk = copied(small, tmp_path / "fleet")
        git(desk.fleet, "rm", "-rq", "events")
        desk.commit()
        assert fx_of(desk) == REFUSED
        with pytest.raises(RegistryError, match="the statement that it was founded with is missing"):
            Fleet(desk.fleet).check()

    def test_of_two_foundations_a_new_reader_takes_neither(self, small: Desk, tmp_path: Path) -> None:
        desk = copied(small, tmp_path / "fleet")
        assert fx_of(desk) == 3001.0
        desk.forge(desk_of_eve(desk), "eve")
        desk.commit()
        assert fx_of(desk) == 3001.0
        assert fx_of(copied(desk, tmp_path / "first")) == REFUSED


class TestMany:
    def test_more_statements_than_are_read_refuse_their_entry(
        self, small: Desk, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        desk, entry = copied(small, tmp_path / "fleet"), camera(1)
        desk.states("cy", ("retire", replace(entry, status=Status.RETIRED)))
        for module in (standing, in_force):
            monkeypatch.setattr(module, "MOST", 8)
        for n in range(8):
            desk.forge(desk.body(entry, person=f"nobody {n}"), None)
        desk.commit()
        with pytest.raises(RegistryError, match="has 11 statements, and 8 are read"):
            Fleet(desk.fleet).show("example/m01")

    def test_a_new_camera_that_two_approve_in_their_own_clones_is_in_force_once_they_are_merged(
        self, small: Desk, tmp_path: Path
    ) -> None:
        desk, new = copied(small, tmp_path / "fleet"), camera(77)
        desk.put(new)
        desk.commit()
        other = copied(desk, tmp_path / "other")
        for one, who in ((desk, "ada"), (other, "bob")):
            registry, person = one.by(who), Person(name=who, email=f"{who}@example.com")
            proposals = propose_approvals(registry.snapshot(), registry.snapshot(), [new.id])
            save(registry, proposals, author=person)
        merged(desk, other)
        fleet, fx = Fleet(desk.fleet), new.calibration.intrinsics.fx
        [row] = [one for one in fleet.listing().chosen.rows if one["id"] == new.id]
        assert (row["status"], row["intrinsics.fx"]) == ("approved", fx)
        found = fleet.snapshot.resolve(new.calibration.camera)
        assert found is not None
        assert found.entry.calibration.intrinsics.fx == fx
        assert fleet.check().errors == ()
        assert new.path in {pin.path for pin in fleet.lock(out=tmp_path / "a.lock").pins}
        assert fleet.status().matters == ()
        desk.put(with_fx(new))
        desk.commit()
        found = Fleet(desk.fleet).snapshot.resolve(new.calibration.camera)
        assert found is not None
        assert found.entry.calibration.intrinsics.fx == fx

    def test_what_two_approve_in_their_own_clones_is_in_force_though_nobody_moved_its_file(
        self, small: Desk, tmp_path: Path
    ) -> None:
        desk, new = copied(small, tmp_path / "fleet"), with_fx(camera(1))
        desk.put(new)
        desk.commit()
        other = copied(desk, tmp_path / "other")
        desk.states("ada", ("approve", new), files=False)
        other.states("bob", ("approve", new), files=False)
        assert fx_of(desk) == 3001.0
        merged(desk, other)
        assert fx_of(desk) == 3501.0


class TestLabels:
    @pytest.fixture
    def desk(self, small: Desk, tmp_path: Path) -> Desk:
        desk = copied(small, tmp_path / "fleet")
        desk.approves(self.unit("A1", "Eins", 10.0), self.unit("B2", "Zwei", 20.0))
        return desk

    def unit(self, serial: str, label: str | None, more: float) -> Entry:
        entry = camera(1)
        calibration = replace(
            entry.calibration, camera=hashed(replace(entry.calibration.camera, serial=serial))
        )
        return with_fx(replace(entry, calibration=calibration, label=label), more)

    def test_labels_that_are_exchanged_by_hand_stay_where_they_are(self, desk: Desk) -> None:
        desk.put(self.unit("A1", "Zwei", 10.0))
        desk.put(self.unit("B2", "Eins", 20.0))
        desk.commit()
        assert (fx_of(desk, "Eins"), fx_of(desk, "Zwei")) == (3011.0, 3021.0)

    def test_a_label_is_not_taken_by_a_camera_that_is_copied_in(self, desk: Desk) -> None:
        desk.put(self.unit("C3", "Eins", 30.0))
        desk.commit()
        assert fx_of(desk, "Eins") == 3011.0

    def test_a_label_is_given_by_a_statement(self, desk: Desk) -> None:
        desk.states("cy", ("set", self.unit("A1", "Drei", 10.0)))
        assert fx_of(desk, "Drei") == 3011.0
        with pytest.raises(UnknownCameraError):
            Fleet(desk.fleet).show("Eins")


class TestDays:
    def test_a_unit_that_is_sold_keeps_its_k_for_the_flights_before(
        self, small: Desk, tmp_path: Path
    ) -> None:
        desk = copied(small, tmp_path / "fleet")
        change = Fleet(desk.by("ada").repo.path).propose_retirement(
            ["example/m01"], "sold", start=date(2026, 6, 1)
        )
        change.write()
        camera_key = camera(1).calibration.camera
        for day, fx in ((date(2026, 5, 31), 3001.0), (date(2026, 6, 1), None)):
            K = Fleet(desk.fleet).resolve(camera_key, on=day).calibration
            assert (K.intrinsics.fx if K is not None else None) == fx
        assert Fleet(desk.fleet).check().is_good
        assert git(desk.fleet, "status", "--porcelain") == ""
