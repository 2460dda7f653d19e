"""Whose approval an entry has, and whose it takes: statements in the tree say so, under the rules in force."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from calibrary.cli.main import main
from calibrary.records import replace
from calibrary.registry.checks import check_range
from calibrary.registry.entry import Status
from calibrary.registry.entry_yaml import entry_yaml, parse_entry
from calibrary.registry.registry import Registry
from tests.cli.registry.direct import put_bytes
from tests.cli.registry.fleets import P4R, add, commit_of, held, looked_at, printed, run, xml
from tests.registry.entries import an_entry
from tests.registry.git.repositories import git

TWO = 'approvals: {by: ["Ada Keeper", "bob@example.com", "Cy"], count: 2}\n'


def asks(fleet: Path, rule: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Ask for approvals in registry.yaml, and approve that: what the command answers."""
    file = fleet / "registry.yaml"
    kept = file.read_text().partition("\npeople:")[0].partition("\napprovals:")[0].rstrip("\n")
    file.write_text(f"{kept}\n{rule}")
    git(fleet, "commit", "--quiet", "-am", "Ask for approvals")
    oid = git(fleet, "rev-parse", "HEAD:registry.yaml")
    code, _, err = run(capsys, "approve", "registry.yaml", "--digest", oid[:12])
    return code, " ".join(err.split())


def by(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """Who is at the keyboard now."""
    for role in ("AUTHOR", "COMMITTER"):
        monkeypatch.setenv(f"GIT_{role}_NAME", name)
        monkeypatch.setenv(f"GIT_{role}_EMAIL", f"{name.split(maxsplit=1)[0].lower()}@example.com")


def unapproved(fleet: Path, base: str) -> list[str]:
    found = check_range(Registry.open(fleet).snapshot(), base, None).findings
    return [finding.message for finding in found if finding.rule == "approval"]


def test_yes_approves_what_is_proposed_now(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    add(xml(tmp_path / "a.xml"))
    code, out, _ = run(capsys, "approve", P4R, "--yes")
    assert code == 0
    assert "approved" in out
    assert held(fleet).entry.status is Status.APPROVED
    assert main(["k", P4R]) == 0
    assert capsys.readouterr().out.startswith("3660.5 0.0 2731.5\n")
    assert main(["k", "nobody/nothing"]) == 4
    rules = fleet / "registry.yaml"
    rules.write_text(rules.read_text() + 'approvals: {by: ["Ada Keeper"], count: 1}\n')
    git(fleet, "commit", "--quiet", "-am", "Ask for approvals")
    assert run(capsys, "approve", "registry.yaml", "--yes")[0] == 0


def test_who_proposed_and_who_approved_are_two_things_and_both_are_shown(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    add(xml(tmp_path / "a.xml"))
    by(monkeypatch, "Bob")
    run(capsys, "approve", *looked_at(fleet, P4R), "--reason", "test field")
    for document in (
        printed(capsys, "registry-show-1", "show", P4R),
        printed(capsys, "resolution-1", "resolve", P4R)["entry"],
    ):
        assert document["recorded"]["by"] == "Ada Keeper"
        [approval] = document["approved"]
        assert (approval["by"], approval["email"], approval["reason"]) == (
            "Bob",
            "bob@example.com",
            "test field",
        )
        assert approval["commit"] == commit_of(fleet)
    assert "by Bob, commit" in " ".join(run(capsys, "show", P4R)[1].split())


class TestRules:
    def test_two_of_the_listed_people_put_it_to_use(
        self,
        fleet: Path,
        tmp_path: Path,
        capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        assert asks(fleet, TWO, capsys)[0] == 0
        base = commit_of(fleet)
        add(xml(tmp_path / "a.xml"))
        shown = looked_at(fleet, P4R)
        by(monkeypatch, "Eve")
        code, _, err = run(capsys, "approve", *shown)
        assert (code, "is not among those who approve" in err) == (4, True)
        by(monkeypatch, "Bob")
        code, out, err = run(capsys, "approve", *shown)
        assert (code, "1 of 2 approvals" in " ".join((out + err).split())) == (0, True)
        assert held(fleet).is_pending
        # Once more by the same person is one person.
        run(capsys, "approve", *shown)
        assert held(fleet).is_pending
        by(monkeypatch, "Cy")
        assert run(capsys, "approve", *shown)[0] == 0
        assert not held(fleet).is_pending
        approved = printed(capsys, "registry-show-1", "show", P4R)["approved"]
        assert {one["by"] for one in approved} == {"Bob", "Cy"}
        assert unapproved(fleet, base) == []

    def test_what_one_adds_and_approves_at_once_waits_for_the_other(
        self,
        fleet: Path,
        tmp_path: Path,
        capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        asks(fleet, "approvals: {count: 2}\n", capsys)
        add(xml(tmp_path / "a.xml"), "--approve")
        assert held(fleet).is_pending
        by(monkeypatch, "Bob")
        assert run(capsys, "approve", *looked_at(fleet, P4R))[0] == 0
        assert not held(fleet).is_pending

    def test_what_is_written_by_hand_is_proposed_until_somebody_approves_it(
        self, fleet: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        put_bytes(fleet, {an_entry().path: entry_yaml(an_entry())})
        assert run(capsys, "check")[0] == 0
        assert held(fleet, "fc6310r").entry.status is Status.DRAFT
        assert run(capsys, "approve", *looked_at(fleet, "fc6310r"))[0] == 0
        assert held(fleet, "fc6310r").entry.status is Status.APPROVED

    def test_a_file_that_cannot_be_read_takes_nothing_out_of_use(
        self, fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        add(xml(tmp_path / "a.xml"))
        run(capsys, "approve", *looked_at(fleet, P4R))
        stored = held(fleet)
        put_bytes(fleet, {stored.path: entry_yaml(stored.entry).replace(b"fx: 3660.5", b"fx: 3160.5")})
        code, out, _ = run(capsys, "check")
        [broken] = (line for line in out.splitlines() if line.startswith(stored.path))
        assert (code, broken.endswith("(digest)")) == (1, True)
        assert held(fleet).entry == stored.entry

    def test_what_registry_yaml_asks_for_is_in_force_once_it_is_approved(
        self, fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        file = fleet / "registry.yaml"
        file.write_text(f"{file.read_text()}{TWO}")
        git(fleet, "commit", "--quiet", "-am", "Ask for approvals")
        add(xml(tmp_path / "a.xml"), "--approve")
        assert "asks for other rules than those in force" in run(capsys, "check")[1]
        with pytest.raises(SystemExit):
            run(capsys, "approve", "registry.yaml")
        assert "--digest" in capsys.readouterr().err
        oid = git(fleet, "rev-parse", "HEAD:registry.yaml")
        assert run(capsys, "approve", "registry.yaml", "--digest", oid)[0] == 0
        # What was approved under the former rules stays so.
        code, out, _ = run(capsys, "check")
        assert (code, "0 warnings" in out) == (0, True)
        code, _, err = run(capsys, "approve", "registry.yaml", "--digest", oid)
        assert (code, "in force already" in err) == (4, True)

    def test_rules_are_loosened_by_those_alone_who_approve_under_them(
        self, fleet: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        asks(fleet, TWO, capsys)
        by(monkeypatch, "Eve")
        code, err = asks(fleet, "", capsys)
        assert (code, "not among those who approve" in err) == (4, True)
        by(monkeypatch, "Bob")
        file = fleet / "registry.yaml"
        oid = git(fleet, "rev-parse", "HEAD:registry.yaml")
        said = run(capsys, "approve", "registry.yaml", "--digest", oid)
        assert "1 of 2 approvals" in " ".join(said[2].split()), said
        assert Registry.open(fleet).snapshot().book.rulebook.people.rules.approvals.count == 2
        by(monkeypatch, "Cy")
        run(capsys, "approve", "registry.yaml", "--digest", oid)
        assert Registry.open(fleet).snapshot().book.rulebook.people.rules.approvals.count == 1
        assert file.read_text().count('approvals: {by: ["Ada Keeper') == 0


class TestKeys:
    @pytest.fixture
    def keys(self, tmp_path_factory: pytest.TempPathFactory) -> Path:
        """A folder with the keys of Ada, Bob and Eve."""
        folder = tmp_path_factory.mktemp("keys")
        for name in ("ada", "bob", "eve"):
            command = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", name, "-f", str(folder / name)]
            subprocess.run(command, check=True)
        return folder

    def test_where_people_have_keys_what_they_state_is_signed(
        self, fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], keys: Path
    ) -> None:
        people = ", ".join(
            f'{{name: "{name}", keys: ["{(keys / f"{name}.pub").read_text().strip()}"]}}'
            for name in ("ada", "bob")
        )
        assert asks(fleet, f"people: [{people}]\n", capsys)[0] == 0
        add(xml(tmp_path / "a.xml"))
        # An approval that no reader would count is not written.
        code, _, err = run(capsys, "approve", *looked_at(fleet, P4R))
        assert (code, "git names no key" in " ".join(err.split())) == (4, True)
        assert held(fleet).is_pending
        git(fleet, "config", "--global", "user.signingKey", str(keys / "eve"))
        code, _, err = run(capsys, "approve", *looked_at(fleet, P4R))
        assert (code, "is a key of none of them" in " ".join(err.split())) == (4, True)
        git(fleet, "config", "--global", "user.signingKey", str(keys / "ada.pub"))
        assert run(capsys, "approve", *looked_at(fleet, P4R))[0] == 0
        assert run(capsys, "check")[0] == 0
        [approval] = printed(capsys, "registry-show-1", "show", P4R)["approved"]
        assert approval["by"] == "ada"

    @pytest.mark.parametrize(
        ("rule", "said"),
        [
            ('people: [{name: "a", keys: ["ADA"]}, {name: "b", keys: ["ADA"]}]', "a key is of one person"),
            ('people: [{name: "a", keys: ["ADA"]}, {name: "a", keys: ["BOB"]}]', "stands twice"),
            ('people: [{name: "a", keys: ["none"]}]', "is no public ssh key"),
            ('people: [{name: "a", keys: ["ADA"]}]\napprovals: {count: 2}', "cannot come together"),
            ('people: [{name: "a", keys: ["ADA"]}]\napprovals: {by: ["b"]}', "who has no key"),
            ('approvals: {by: ["ADA"]}', "their keys stand in people:"),
        ],
    )
    def test_rules_that_nobody_could_fulfil_or_that_count_one_as_two_are_refused(
        self, fleet: Path, capsys: pytest.CaptureFixture[str], keys: Path, rule: str, said: str
    ) -> None:
        for name in ("ada", "bob"):
            rule = rule.replace(name.upper(), (keys / f"{name}.pub").read_text().strip())
        code, err = asks(fleet, f"{rule}\n", capsys)
        assert (code, said in err) == (4, True)


class TestWithoutApprovals:
    """Rules that ask for nobody's approval: what stands in cameras/ is used."""

    @pytest.fixture
    def free(self, fleet: Path, capsys: pytest.CaptureFixture[str]) -> Path:
        assert asks(fleet, "approvals: {count: 0}\n", capsys)[0] == 0
        return fleet

    def test_what_is_added_is_used_and_edited_by_hand(self, free: Path, tmp_path: Path) -> None:
        add(xml(tmp_path / "a.xml"))
        assert held(free).entry.status is Status.APPROVED
        data = (free / held(free).path).read_bytes()
        other = replace(parse_entry(data, "x"), tolerance=0.02, label="Hugo")
        put_bytes(free, {other.path: entry_yaml(other)})
        assert held(free, "Hugo").entry == replace(other, status=Status.APPROVED)
        assert git(free, "log", "--format=%s", "-2").splitlines()[-1].startswith("Add")

    def test_a_retirement_ends_it_until_it_is_approved_again(
        self, free: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        add(xml(tmp_path / "a.xml"))
        assert run(capsys, "retire", P4R, "--reason", "sold")[0] == 0
        assert held(free).entry.status is Status.RETIRED
        assert run(capsys, "resolve", P4R)[0] == 4
        assert run(capsys, "approve", P4R, "--yes")[0] == 0
        assert held(free).entry.status is Status.APPROVED

    def test_a_file_that_cannot_be_read_is_refused(
        self, free: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        add(xml(tmp_path / "a.xml"))
        put_bytes(free, {held(free).path: b"fx: [1"})
        assert run(capsys, "resolve", P4R)[0] == 4
