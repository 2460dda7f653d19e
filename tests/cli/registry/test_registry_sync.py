"""``registry sync``: two keepers, one bare remote, and entries that both have changed."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from calibrary.arguments import Terms
from calibrary.cli.main import main
from calibrary.errors import RegistryError
from calibrary.records import replace
from calibrary.registry.entry import Entry, Status
from calibrary.registry.git import remotes
from calibrary.registry.git.remotes import Pulled, pull
from calibrary.registry.git.repository import Repository
from calibrary.registry.proposals import propose, save
from calibrary.registry.registry import Registry
from calibrary.schemas import require
from tests.cli.registry.direct import put, put_bytes
from tests.cli.registry.fleets import CAMERA, P4R, commit_of, held, printed, run, xml
from tests.cli.registry.test_registry_approvals import asks, by
from tests.registry.entries import an_entry
from tests.registry.git.repositories import git, packed, seclude

MINE = an_entry(focal_mm=None)
OTHER = an_entry(focal_mm=None, model="FC330")
TWINS = ("remote.git", "fleet", "twin")


@pytest.fixture(scope="module")
def twins(begun: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A registry with two entries, the bare remote that it was pushed to, and a clone of that; to copy."""
    folder = tmp_path_factory.mktemp("twins")
    with pytest.MonkeyPatch.context() as patch:
        seclude(patch, folder)
        put(Path(shutil.copytree(begun, folder / "fleet")), MINE, OTHER)
        git(folder, "init", "--quiet", "--bare", "--initial-branch=main", "remote.git")
        assert (
            main(["registry", "sync", str(folder / "remote.git"), "--registry", str(folder / "fleet")]) == 0
        )
        assert main(["registry", "init", str(folder / "twin"), "--remote", str(folder / "remote.git")]) == 0
        for name in TWINS:
            packed(folder / name)
    return folder


@pytest.fixture
def twin(fleet: Path, twins: Path, tmp_path: Path) -> Path:
    """The clone, beside the remote; the registry in use is the one that was pushed."""
    shutil.rmtree(fleet)
    for name in TWINS:
        shutil.copytree(twins / name, tmp_path / name)
    for name in ("fleet", "twin"):
        git(tmp_path / name, "remote", "set-url", "origin", str(tmp_path / "remote.git"))
    return tmp_path / "twin"


def changed(fx: float, entry: Entry = MINE) -> Entry:
    """The entry with another focal length."""
    calibration = entry.calibration
    K = replace(calibration.intrinsics, fx=fx)
    return replace(entry, calibration=replace(calibration, intrinsics=K))


def fx_of(place: Path, key: str = P4R) -> float:
    return held(place, key).entry.calibration.intrinsics.fx


def test_what_one_pushes_the_other_pulls(fleet: Path, twin: Path, capsys: pytest.CaptureFixture[str]) -> None:
    put(fleet, changed(3600.0))
    pushed = printed(capsys, "registry-sync-1", "sync")
    assert pushed["commit"] == commit_of(fleet)
    pulled = printed(capsys, "registry-sync-1", "sync", "--registry", twin)
    assert (pulled["commit"], pulled["replayed"]) == (commit_of(fleet), 0)
    assert fx_of(twin) == 3600.0
    assert git(twin, "status", "--porcelain") == ""
    _, out, _ = run(capsys, "sync", "--registry", twin)
    assert out.splitlines() == [
        "origin has nothing new",
        f"origin and this registry are at {commit_of(twin)[:12]}",
    ]


def test_a_sync_pulls_then_pushes_and_says_both(
    fleet: Path, twin: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, changed(3600.0))
    run(capsys, "sync")
    put(twin, changed(2300.0, OTHER), subject="Ours of the other")
    code, out, _ = run(capsys, "sync", "--registry", twin)
    tip = commit_of(twin)[:12]
    assert (code, out.splitlines()) == (
        0,
        [f"at {tip} now, 1 commit of ours made again on top", f"origin and this registry are at {tip}"],
    )
    synced = printed(capsys, "registry-sync-1", "sync")
    assert (synced["commit"], synced["theirs"], synced["unpushed"]) == (*[commit_of(twin)] * 2, None)
    assert (fx_of(fleet), fx_of(fleet, "dji/fc330")) == (3600.0, 2300.0)
    assert run(capsys, "sync")[1].splitlines()[0] == "origin has nothing new"


def test_a_sync_that_pulled_and_could_not_push_says_so(
    fleet: Path, twin: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    put(fleet, changed(3600.0))
    run(capsys, "sync")
    put(twin, changed(2300.0, OTHER), subject="Ours of the other")

    def refused(*_: object) -> str:
        raise RegistryError("the network is gone")

    monkeypatch.setattr(remotes, "push", refused)
    code, out, err = run(capsys, "sync", "--registry", twin)
    assert (code, fx_of(twin)) == (4, 3600.0)
    assert "1 commit of ours made again on top" in out
    assert "not sent: the network is gone" in err
    document = json.loads(run(capsys, "sync", "--registry", twin, "--json")[1])
    require(document, "registry-sync-1")
    assert (document["commit"], document["unpushed"]) == (commit_of(twin), "the network is gone")


class TestBothChangedAnEntry:
    @pytest.fixture(autouse=True)
    def _both(self, fleet: Path, twin: Path, capsys: pytest.CaptureFixture[str]) -> None:
        put(fleet, changed(3600.0))
        run(capsys, "sync")
        put(twin, changed(3500.0), subject="Ours")
        put(twin, changed(2300.0, OTHER), subject="Ours of the other")

    def test_nothing_is_changed_and_both_values_are_shown(
        self, twin: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        before = commit_of(twin)
        code, out, err = run(capsys, "sync", "--registry", twin, "--json")
        assert code == 4
        assert commit_of(twin) == before
        [line] = [line for line in err.splitlines() if "intrinsics.fx" in line]
        assert line.split() == ["intrinsics.fx", "3661.25", "3500.0", "3600.0"]
        assert f"calibrary registry sync --theirs {P4R}" in err
        document = json.loads(out)
        require(document, "registry-sync-1")
        [conflict] = document["conflicts"]
        assert {"field": "intrinsics.fx", "base": 3661.25, "ours": 3500.0, "theirs": 3600.0} in conflict[
            "fields"
        ]
        assert document["commit"] is None

    def test_a_sync_leaves_both_sides_as_they_were(
        self, fleet: Path, twin: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        before = commit_of(twin), git(fleet.parent / "remote.git", "rev-parse", "main")
        code, out, err = run(capsys, "sync", "--registry", twin)
        assert (code, out) == (4, "")
        assert f"calibrary registry sync --theirs {P4R}" in err
        assert "not sent" in err
        assert before == (commit_of(twin), git(fleet.parent / "remote.git", "rev-parse", "main"))
        assert run(capsys, "sync", "--registry", twin, "--theirs", "all")[0] == 0
        assert commit_of(twin) == git(fleet.parent / "remote.git", "rev-parse", "main")

    @pytest.mark.parametrize(("side", "fx"), [("--theirs", 3600.0), ("--ours", 3500.0)])
    def test_the_side_that_is_chosen_stays_and_no_other_change_is_lost(
        self, twin: Path, capsys: pytest.CaptureFixture[str], side: str, fx: float
    ) -> None:
        pulled = printed(capsys, "registry-sync-1", "sync", "--registry", twin, side, "dji/fc6310r")
        assert fx_of(twin) == fx
        assert fx_of(twin, "dji/fc330") == 2300.0
        assert pulled["commit"] == commit_of(twin)
        assert "Take what the others say" not in git(twin, "log", "--format=%s")
        assert git(twin, "status", "--porcelain") == ""
        assert run(capsys, "sync", "--registry", twin)[0] == 0

    def test_ours_is_back_where_the_pull_does_not_come_through(
        self, twin: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        tried = []

        def fails_the_second_time(repo: Repository, remote: str, **terms: Any) -> Pulled:
            tried.append(remote)
            if len(tried) > 1:
                raise RegistryError("the network is gone")
            return pull(repo, remote, **terms)

        monkeypatch.setattr(remotes, "pull", fails_the_second_time)
        code, _, err = run(capsys, "sync", "--registry", twin, "--theirs", "all")
        assert (code, "the network is gone" in err) == (4, True)
        assert (fx_of(twin), fx_of(twin, "dji/fc330")) == (3500.0, 2300.0)

    def test_an_entry_of_no_conflict_cannot_be_chosen(
        self, twin: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        before = commit_of(twin)
        code, _, err = run(capsys, "sync", "--registry", twin, "--ours", "dji/fc330")
        assert (code, "no such" in err) == (4, True)
        code, _, err = run(capsys, "sync", "--registry", twin, "--theirs", "all", "--theirs", "dji/fc63lOr")
        assert (code, "no such" in err) == (4, True)
        code, _, err = run(capsys, "sync", "--registry", twin, "--ours", "all", "--theirs", "all")
        assert (code, "is named for both --ours and --theirs" in err) == (4, True)
        assert commit_of(twin) == before


def test_an_entry_that_one_removed_and_the_other_changed_is_decided_too(
    fleet: Path, twin: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put_bytes(fleet, {MINE.path: None})
    run(capsys, "sync")
    put(twin, changed(3500.0))
    code, _, err = run(capsys, "sync", "--registry", twin)
    assert (code, "theirs removed it" in err) == (4, True)
    assert run(capsys, "sync", "--registry", twin, "--theirs", "all")[0] == 0
    assert not (twin / MINE.path).exists()
    # What is approved needs no file.
    assert fx_of(twin) == 3500.0


def test_keeping_ours_of_an_entry_that_they_removed_brings_it_back(
    fleet: Path, twin: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put_bytes(fleet, {MINE.path: None})
    run(capsys, "sync")
    put(twin, changed(3500.0))
    assert run(capsys, "sync", "--registry", twin, "--ours", "all")[0] == 0
    assert fx_of(twin) == 3500.0


def test_uncommitted_work_is_not_touched(fleet: Path, twin: Path, capsys: pytest.CaptureFixture[str]) -> None:
    put(fleet, changed(3600.0))
    run(capsys, "sync")
    (twin / MINE.path).write_text("my unfinished edit")
    code, _, err = run(capsys, "sync", "--registry", twin)
    assert code == 4
    assert MINE.path in err
    assert (twin / MINE.path).read_text() == "my unfinished edit"


@pytest.mark.parametrize(
    ("word", "printed"),
    [
        ("backup", "no remote 'backup'"),
        ("ext::sh -c id", "expected"),
        ("--upload-pack=x", "expected"),
    ],
)
@pytest.mark.usefixtures("fleet")
def test_what_is_no_remote_is_one_clear_line(
    capsys: pytest.CaptureFixture[str], word: str, printed: str
) -> None:
    code, _, said = run(capsys, "sync", "--", word)
    assert (code, said.count("\n")) == (4, 1)
    assert printed in said


def test_a_remote_that_is_gone_is_one_clear_line(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, an_entry(status=Status.DRAFT))
    code, _, said = run(capsys, "sync", tmp_path / "gone.git")
    assert code == 4
    assert "gone.git" in said.splitlines()[-1]


def test_a_second_address_has_to_be_named_first(
    fleet: Path, twin: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert fleet.parent == twin.parent
    code, _, err = run(capsys, "sync", tmp_path / "elsewhere.git")
    assert (code, "remote add NAME" in err) == (4, True)
    assert run(capsys, "sync", tmp_path / "remote.git")[0] == 0


def tagged(entry: Entry, *tags: str, notes: tuple[str, ...] = ()) -> Entry:
    calibration = replace(entry.calibration, notes=(*entry.calibration.notes, *notes))
    return replace(entry, tags=(*entry.tags, *tags), calibration=calibration)


def test_two_labels_of_one_unit_are_a_conflict(
    fleet: Path, twin: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    unit = an_entry(focal_mm=None, serial="0V2CB0100017")
    put(fleet, unit)
    run(capsys, "sync")
    run(capsys, "sync", "--registry", twin)
    put(fleet, replace(unit, label="P4R-01"))
    run(capsys, "sync")
    put(twin, replace(unit, label="P4R-02"))
    code, _, err = run(capsys, "sync", "--registry", twin)
    assert code == 4
    assert "changed on both sides" in err


def rewind(place: Path, commit: str) -> None:
    """Take back the commits after one, here and by force at the remote."""
    git(place, "reset", "--quiet", "--hard", commit)
    git(place, "push", "--quiet", "--force", "origin", "main")


@pytest.fixture
def rewritten(fleet: Path, twin: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    """The twin has what the remote lost by a force push, and a change of its own."""
    before = commit_of(fleet)
    put(fleet, changed(3600.0), subject="A wrong K")
    run(capsys, "sync")
    run(capsys, "sync", "--registry", twin)
    rewind(fleet, before)
    put(twin, changed(2300.0, OTHER), subject="Ours of the other")
    return twin


@pytest.mark.thorough
def test_what_a_rewritten_remote_lost_does_not_come_back_unasked(
    rewritten: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = commit_of(rewritten)
    for _ in range(2):
        code, _, err = run(capsys, "sync", "--registry", rewritten)
        assert code == 4
        assert "A wrong K" in err
        assert "Ours of the other" not in err
        assert "--removed drop" in err
    assert commit_of(rewritten) == before


@pytest.mark.thorough
def test_it_is_given_up_or_made_again_as_one_says(
    fleet: Path, rewritten: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(capsys, "sync", "--removed", "drop", "--registry", rewritten)[0] == 0
    assert (fx_of(rewritten), fx_of(rewritten, "dji/fc330")) == (fx_of(fleet), 2300.0)
    assert git(rewritten, "status", "--porcelain") == ""
    assert "A wrong K" not in git(rewritten, "log", "--format=%s")


@pytest.mark.thorough
def test_kept_commits_stay_on_top_of_a_rewritten_remote(
    rewritten: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(capsys, "sync", "--removed", "keep", "--registry", rewritten)[0] == 0
    assert (fx_of(rewritten), fx_of(rewritten, "dji/fc330")) == (3600.0, 2300.0)
    assert run(capsys, "sync", "--registry", rewritten)[0] == 0


@pytest.mark.thorough
def test_a_squash_of_what_one_has_asks_nothing(
    fleet: Path, twin: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = commit_of(fleet)
    put(fleet, changed(3600.0), subject="First")
    put(fleet, changed(3601.0), subject="Second")
    run(capsys, "sync")
    run(capsys, "sync", "--registry", twin)
    git(fleet, "reset", "--quiet", "--soft", before)
    git(fleet, "commit", "--quiet", "--message", "Both in one")
    git(fleet, "push", "--quiet", "--force", "origin", "main")
    assert run(capsys, "sync", "--registry", twin)[0] == 0
    assert (commit_of(twin), fx_of(twin)) == (commit_of(fleet), 3601.0)


def test_proposed_commits_become_a_branch_and_leave_the_own_one(
    fleet: Path, twin: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = commit_of(twin)
    put(twin, changed(3600.0), subject="A new K")
    ours = commit_of(twin)
    done = printed(capsys, "registry-sync-1", "sync", "--propose", "--registry", twin)
    assert (done["commit"], done["theirs"], commit_of(twin)) == (ours, before, before)
    assert git(twin, "status", "--porcelain") == ""
    git(fleet, "fetch", "--quiet")
    assert git(fleet, "rev-parse", f"origin/{done['branch']}").strip() == ours
    assert run(capsys, "sync", "--propose", "--registry", twin)[0] == 4


@pytest.mark.thorough
def test_after_a_squash_merge_of_the_proposal_a_pull_goes_forward(
    fleet: Path, twin: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(twin, changed(3600.0), subject="A new K")
    branch = printed(capsys, "registry-sync-1", "sync", "--propose", "--registry", twin)["branch"]
    git(fleet, "fetch", "--quiet")
    git(fleet, "merge", "--quiet", "--squash", f"origin/{branch}")
    git(fleet, "commit", "--quiet", "--message", "A new K (#1)")
    run(capsys, "sync")
    assert run(capsys, "sync", "--registry", twin)[0] == 0
    assert (commit_of(twin), fx_of(twin)) == (commit_of(fleet), 3600.0)


def test_a_protected_branch_says_how_to_propose(
    twin: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hook = tmp_path / "remote.git" / "hooks" / "update"
    hook.write_text("#!/bin/sh\ntest $1 != refs/heads/main\n")
    hook.chmod(0o755)
    put(twin, changed(3600.0))
    code, _, err = run(capsys, "sync", "--registry", twin)
    assert (code, "sync --propose" in err) == (4, True)
    assert run(capsys, "sync", "--propose", "--registry", twin)[0] == 0


def test_who_may_only_read_gets_what_is_new_and_sends_nothing(
    fleet: Path, twin: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, changed(3600.0))
    assert run(capsys, "sync")[0] == 0
    hook = tmp_path / "remote.git" / "hooks" / "pre-receive"
    hook.write_text("#!/bin/sh\nexit 1\n")
    hook.chmod(0o755)
    assert run(capsys, "sync", "--registry", twin)[0] == 0
    assert fx_of(twin) == 3600.0


def test_a_proposal_takes_no_decision_about_theirs(twin: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = commit_of(twin)
    put(twin, changed(3600.0))
    code, _, err = run(capsys, "sync", "--propose", "--theirs", "all", "--registry", twin)
    assert (code, "--propose takes no" in err, commit_of(twin) == before) == (2, True, False)


def test_a_fetch_of_another_program_hides_no_rewriting(
    rewritten: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    git(rewritten, "fetch", "--quiet", "origin")
    for _ in range(2):
        code, _, err = run(capsys, "sync", "--registry", rewritten)
        assert (code, "A wrong K" in err) == (4, True)
    code, _, err = run(capsys, "sync", "--propose", "--registry", rewritten)
    assert (code, "A wrong K" in err) == (4, True)


def test_commits_of_another_registry_are_not_proposed(
    twin: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    git(tmp_path, "init", "--quiet", "--bare", "--initial-branch=main", "other.git")
    assert run(capsys, "init", tmp_path / "stranger")[0] == 0
    run(capsys, "sync", tmp_path / "other.git", "--registry", tmp_path / "stranger")
    git(twin, "remote", "set-url", "origin", str(tmp_path / "other.git"))
    before = commit_of(twin)
    code, _, err = run(capsys, "sync", "--propose", "--registry", twin)
    assert (code, "different registries" in err, commit_of(twin)) == (4, True, before)


class TestStatements:
    """What is approved and named where statements say so, after commits were moved or given up."""

    UNIT = an_entry(focal_mm=None, serial="0V2CB0100017")

    @pytest.fixture
    def two(self, fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> tuple[Path, Path]:
        put(fleet, MINE, self.UNIT)
        git(tmp_path, "init", "--quiet", "--bare", "--initial-branch=main", "remote.git")
        run(capsys, "sync", tmp_path / "remote.git")
        run(capsys, "init", tmp_path / "twin", "--remote", tmp_path / "remote.git")
        for place in (fleet, tmp_path / "twin"):
            assert run(capsys, "list", "--registry", place)[0] == 0
        return fleet, tmp_path / "twin"

    @staticmethod
    def approve(place: Path, fx: float) -> None:
        registry = Registry.open(place)
        entry = replace(changed(fx), status=Status.APPROVED)
        change = propose(registry.snapshot(), [entry], Terms(approve=True, reason="measured"))
        save(registry, change, Terms(reason="measured"))

    def approve_for_both(self, fleet: Path, twin: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.approve(fleet, 3700.0)
        run(capsys, "sync")
        run(capsys, "sync", "--registry", twin)

    def test_what_was_in_use_is_in_use_after_a_newer_one_was_proposed(
        self, two: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
    ) -> None:
        _, twin = two
        self.approve(twin, 3700.0)
        assert run(capsys, "list", "--registry", twin)[0] == 0
        assert fx_of(twin) == 3700.0
        assert run(capsys, "sync", "--propose", "--registry", twin)[0] == 0
        code, out, err = run(capsys, "list", "--registry", twin)
        assert (code, "not listed" in out + err) == (0, False)
        assert fx_of(twin) == MINE.calibration.intrinsics.fx

    @pytest.mark.thorough
    def test_and_after_it_was_given_up_with_the_remote(
        self, two: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
    ) -> None:
        fleet, twin = two
        before = commit_of(fleet)
        self.approve_for_both(fleet, twin, capsys)
        assert fx_of(twin) == 3700.0
        rewind(fleet, before)
        assert run(capsys, "sync", "--removed", "drop", "--registry", twin)[0] == 0
        assert fx_of(twin) == MINE.calibration.intrinsics.fx

    @pytest.mark.thorough
    def test_an_own_approval_after_one_that_is_given_up_counts(
        self, two: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
    ) -> None:
        fleet, twin = two
        before = commit_of(fleet)
        self.approve_for_both(fleet, twin, capsys)
        self.approve(twin, 3710.0)
        rewind(fleet, before)
        assert run(capsys, "sync", "--removed", "drop", "--ours", "all", "--registry", twin)[0] == 0
        assert fx_of(twin) == 3710.0

    @pytest.mark.thorough
    @pytest.mark.parametrize(("side", "label"), [("--theirs", "P4R-01"), ("--ours", "P4R-02")])
    def test_the_label_that_is_chosen_is_in_force(
        self, two: tuple[Path, Path], capsys: pytest.CaptureFixture[str], side: str, label: str
    ) -> None:
        _, twin = two
        key = self.UNIT.id
        assert run(capsys, "set", key, "label=P4R-01", "--yes")[0] == 0
        run(capsys, "sync")
        assert run(capsys, "set", key, "label=P4R-02", "--yes", "--registry", twin)[0] == 0
        assert run(capsys, "sync", side, "all", "--registry", twin)[0] == 0
        assert held(twin, key).entry.label == label
        assert git(twin, "status", "--porcelain") == ""

    def test_a_conflict_is_named_by_the_label_of_its_unit(
        self, two: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
    ) -> None:
        fleet, twin = two
        key = self.UNIT.id
        assert run(capsys, "set", key, "label=P4R-01", "--yes")[0] == 0
        run(capsys, "sync")
        run(capsys, "sync", "--registry", twin)
        for place, tolerance in ((fleet, 0.01), (twin, 0.02)):
            put(place, replace(held(place, key).entry, tolerance=tolerance), subject="Ours")
        run(capsys, "sync")
        assert run(capsys, "sync", "--theirs", "p4r-01", "--registry", twin)[0] == 0
        assert held(twin, key).entry.tolerance == 0.01


def test_a_new_unit_with_two_approvals_reaches_everybody_with_three_commands(
    fleet: Path,
    twin: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    third = tmp_path / "third"
    assert asks(fleet, "approvals: {count: 2}\n", capsys)[0] == 0
    assert main(["registry", "sync"]) == 0
    assert main(["registry", "init", str(third), "--remote", str(tmp_path / "remote.git")]) == 0
    unit = [*CAMERA, "--serial", "0V2LG3H0", "--label", "P4R-03"]

    assert main(["registry", "add", str(xml(tmp_path / "a.xml")), *unit, "--approve", "--sync", "--yes"]) == 0
    by(monkeypatch, "Bob")
    assert main(["registry", "approve", "P4R-03", "--sync", "--yes", "--registry", str(twin)]) == 0
    assert main(["registry", "sync", "--registry", str(third)]) == 0

    assert held(third, "P4R-03").entry.is_usable
    assert {git(place, "rev-parse", "HEAD") for place in (twin, third)} == {
        git(tmp_path / "remote.git", "rev-parse", "main")
    }


@pytest.mark.usefixtures("twin")
def test_nothing_is_written_where_the_exchange_before_it_fails(fleet: Path, tmp_path: Path) -> None:
    shutil.rmtree(tmp_path / "remote.git")
    before = git(fleet, "rev-parse", "HEAD")
    assert main(["registry", "add", str(xml(tmp_path / "a.xml")), *CAMERA, "--sync", "--yes"]) == 4
    assert git(fleet, "rev-parse", "HEAD") == before


@pytest.mark.usefixtures("twin")
def test_what_cannot_be_sent_stays_written(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    hook = tmp_path / "remote.git/hooks/pre-receive"
    hook.parent.mkdir(exist_ok=True)
    hook.write_text("#!/bin/sh\nexit 1\n")
    hook.chmod(0o755)
    add = (str(xml(tmp_path / "a.xml")), *CAMERA, "--serial", "0V2LG3H0", "--label", "P4R-03")
    code, _, err = run(capsys, "add", *add, "--approve", "--sync", "--yes")
    assert (code, "not sent" in err) == (4, True)
    assert held(fleet, "P4R-03").entry.is_usable


def test_two_who_approve_in_their_own_clones_put_it_to_use_whoever_syncs_last(
    fleet: Path,
    twin: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert asks(fleet, "approvals: {count: 2}\n", capsys)[0] == 0
    add = (str(xml(tmp_path / "a.xml")), *CAMERA, "--serial", "0V2LG3H0", "--label", "P4R-03")
    assert main(["registry", "add", *add, "--sync", "--yes"]) == 0
    assert main(["registry", "sync", "--registry", str(twin)]) == 0
    for who, place in (("Bob", twin), ("Cy", fleet)):
        by(monkeypatch, who)
        assert main(["registry", "approve", "P4R-03", "--yes", "--registry", str(place)]) == 0
    for place in (twin, fleet, twin):
        assert main(["registry", "sync", "--registry", str(place)]) == 0
    for place in (twin, fleet):
        assert held(place, "P4R-03").entry.is_usable
        assert main(["registry", "resolve", "0V2LG3H0", "--registry", str(place)]) == 0
