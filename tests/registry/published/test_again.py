"""Publishing again: what differs is read, and the files are those of a publication into an empty folder."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path

import pytest

from calibrary.errors import InputError
from calibrary.records import replace
from calibrary.registry.configuration import configuration_yaml
from calibrary.registry.entry import Alias, Entry, Status, Validity
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.places import PUBLISHED_FILE
from calibrary.registry.published import write
from calibrary.registry.snapshot import Snapshot
from tests.registry.entries import an_entry
from tests.registry.git.repositories import git, packed
from tests.registry.published.publications import (
    FLEET,
    camera,
    commit,
    dated,
    files_of,
    manifest,
    nobodys_git,
    published,
)
from tests.thorough import every

__all__ = ["nobodys_git"]

P4R, SMALL, UNIT_ENTRY, FIRMWARE, RETIRED, NAMED, DRAFT = FLEET
DATED = an_entry(model="DATED")
ALL = {one.path for one in (*FLEET, DATED)} - {DRAFT.path}
MODEL = {P4R.path, SMALL.path, FIRMWARE.path}
"""Of one camera, so that they are read together."""
APRIL = Validity(first=date(2026, 4, 1), last=date(2026, 4, 30))


@dataclass(slots=True)
class Place:
    """A registry, what is published of it, and the cameras that the last run read.

    Attributes:
        folder: that both are in.
        read: paths of the entries that were read.
    """

    folder: Path
    read: list[str] = field(default_factory=list)

    @property
    def fleet(self) -> Path:
        return self.folder / "fleet"

    def publish(self) -> list[str]:
        """Publish again and into an empty folder, compare the two, and say what was read for the first."""
        published(self.fleet, self.folder / "out")
        read = self.read.copy()
        published(self.fleet, self.folder / "anew")
        assert files_of(self.folder / "out") == files_of(self.folder / "anew")
        shutil.rmtree(self.folder / "anew")
        self.read.clear()
        return read


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A registry and its publication, to copy."""
    folder = tmp_path_factory.mktemp("made")
    commit(folder / "fleet", *FLEET)
    dated(folder / "fleet")
    packed(folder / "fleet")
    published(folder / "fleet", folder / "out")
    return folder


@pytest.fixture
def place(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Place:
    shutil.copytree(made, tmp_path / "place")
    found = Place(tmp_path / "place")

    def seen(snapshot: Snapshot, paths: Sequence[str]) -> Iterator[tuple[str, Entry | InputError]]:
        found.read.extend(paths)
        return real(snapshot, paths)

    real = Snapshot.parsed
    monkeypatch.setattr(Snapshot, "parsed", seen)
    return found


def retire(fleet: Path) -> None:
    commit(fleet, replace(P4R, status=Status.RETIRED, reason="sold"))


def approve(fleet: Path) -> None:
    """Put to use what was proposed."""
    better = replace(P4R, tolerance=0.02)
    commit(fleet, replace(better, status=Status.DRAFT))
    commit(fleet, better)


def there_and_back(fleet: Path) -> None:
    """Two commits that change nothing between them, but for what was in use in April."""
    data = (fleet / DATED.path).read_bytes()
    commit(fleet, replace(DATED, validity=APRIL))
    commit(fleet, raw={DATED.path: data})


def merge(fleet: Path) -> None:
    """A colleague's branch, merged by git alone."""
    git(fleet, "switch", "--quiet", "-c", "side")
    commit(fleet, replace(DATED, validity=APRIL))
    git(fleet, "switch", "--quiet", "-")
    commit(fleet, replace(RETIRED, reason="sold"))
    git(fleet, "merge", "--quiet", "--no-edit", "side")


CHANGES: dict[str, tuple[Callable[[Path], object], set[str] | None]] = {
    "nothing": (lambda _: None, set()),
    "another K": (lambda at: commit(at, an_entry(focal_mm=None, fx=3662.0)), MODEL),
    "a new model": (lambda at: commit(at, an_entry(model="NEW")), {an_entry(model="NEW").path}),
    "a new unit": (
        lambda at: commit(at, an_entry(focal_mm=None, serial="ab" * 8)),
        {an_entry(focal_mm=None, serial="ab" * 8).path},
    ),
    "approved": (approve, MODEL),
    "a draft approved": (lambda at: commit(at, replace(DRAFT, status=Status.APPROVED)), {DRAFT.path}),
    "retired": (retire, MODEL),
    "a label": (lambda at: commit(at, replace(UNIT_ENTRY, label="P4R-03")), {UNIT_ENTRY.path}),
    "the file removed": (lambda at: commit(at, raw={P4R.path: None}), MODEL),
    "a new period": (lambda at: commit(at, replace(DATED, validity=APRIL)), {DATED.path}),
    "a period for the first time": (lambda at: commit(at, replace(P4R, validity=APRIL)), MODEL),
    "no period any more": (lambda at: commit(at, DATED), {DATED.path}),
    "there and back": (there_and_back, {DATED.path}),
    "merged": (merge, {DATED.path, RETIRED.path}),
    "no alias any more": (lambda at: commit(at, replace(NAMED, aliases=())), {NAMED.path}),
    "an alias of a model with entries": (
        lambda at: commit(at, replace(NAMED, aliases=(Alias(make="dji", model="fc6310r"),))),
        {NAMED.path},
    ),
    "an alias of several cameras": (
        lambda at: commit(at, replace(P4R, aliases=(Alias(make="OTHER", model="p4 rtk"),))),
        MODEL,
    ),
    "a unit with an alias": (
        lambda at: commit(at, replace(UNIT_ENTRY, aliases=(Alias(make="other", model="P4 RTK"),))),
        {UNIT_ENTRY.path},
    ),
    "another spelling": (lambda at: commit(at, an_entry(focal_mm=None, size=(1, 1), model="fc6310R")), None),
    "what is not published": (
        lambda at: commit(at, raw={"registry.yaml": configuration_yaml() + b"# more\n"}),
        set(),
    ),
}


@pytest.mark.parametrize("change", every(3, CHANGES))
def test_only_what_differs_is_read_and_the_files_are_the_same(place: Place, change: str) -> None:
    make, read = CHANGES[change]
    make(place.fleet)
    found = place.publish()
    assert read is None or set(found) == read
    # What follows from the new state is as much of it.
    commit(place.fleet, an_entry(focal_mm=None, fx=3670.0), replace(NAMED, tolerance=0.01))
    assert set(place.publish()) >= {P4R.path, NAMED.path}


@pytest.mark.thorough
def test_many_changes_at_once_and_one_after_the_other_give_the_same(place: Place) -> None:
    for number, (make, _) in enumerate(CHANGES.values()):
        make(place.fleet)
        if number % 6 == 0:
            place.publish()
    place.publish()


class TestInDoubt:
    """What the former publication does not say well enough is read."""

    @pytest.mark.parametrize("damage", [b"{", None])
    @pytest.mark.parametrize("what", ["camera", "list", "manifest"])
    def test_where_a_file_is_not_as_recorded(self, place: Place, what: str, damage: bytes | None) -> None:
        out = place.folder / "out"
        files = {
            "camera": camera(out, "dji/fc330"),
            "list": out / f"data/{manifest(out)['cameras']}.json",
            "manifest": out / PUBLISHED_FILE,
        }
        files[what].unlink() if damage is None else files[what].write_bytes(damage)
        assert set(place.publish()) == ({RETIRED.path} if what == "camera" else ALL)

    def test_where_another_calibrary_wrote_it(self, place: Place, monkeypatch: pytest.MonkeyPatch) -> None:
        with monkeypatch.context() as patch:
            patch.setattr(write, "__version__", "99.0")
            assert set(place.publish()) == ALL
            assert place.publish() == []
        assert set(place.publish()) == ALL

    def test_not_where_a_file_is_at_no_camera_s_path(self, place: Place) -> None:
        commit(place.fleet, raw={"cameras/once.yaml": entry_yaml(replace(P4R, tolerance=0.02))})
        assert place.publish() == []

    def test_where_its_commit_is_gone(self, place: Place) -> None:
        git(place.fleet, "commit", "--quiet", "--amend", "-m", "Say it otherwise")
        git(place.fleet, "reflog", "expire", "--expire=now", "--all")
        git(place.fleet, "gc", "--quiet", "--prune=now")
        assert set(place.publish()) == ALL

    def test_where_history_was_rewritten(self, place: Place) -> None:
        git(place.fleet, "commit", "--quiet", "--amend", "-m", "Say it otherwise")
        assert set(place.publish()) == ALL

    def test_where_the_history_is_cut_off(self, place: Place) -> None:
        shallow = place.folder / "shallow"
        git(place.folder, "clone", "--quiet", "--depth=1", place.fleet.as_uri(), str(shallow))
        published(shallow, place.folder / "out")
        assert set(place.read) == ALL
        place.read.clear()
        # What was published of it knows less of the past than the registry itself.
        assert set(place.publish()) == ALL
