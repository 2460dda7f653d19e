"""Whose approval an entry has, and whose it takes: derived from the commits, judged by what the base asks for."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from pathlib import Path

import pytest

from calibrary.registry.approvals import missing_approvals
from calibrary.registry.checks import check_range
from calibrary.registry.configuration import ApprovalRule
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.registry import Registry
from tests.cli.registry.direct import put_bytes
from tests.cli.registry.fleets import P4R, add, commit_of, held, looked_at, printed, run, xml
from tests.registry.entries import an_entry
from tests.registry.git.repositories import git

TWO = '{by: ["Ada Keeper", "bob@example.com", "Cy"], count: 2, not_author: true}'


def asks(fleet: Path, rule: str) -> str:
    """What registry.yaml asks for from now on; the commit."""
    file = fleet / "registry.yaml"
    file.write_text(f"{file.read_text()}approvals: {rule}\n")
    git(fleet, "commit", "--quiet", "-am", "Ask for approvals")
    return commit_of(fleet)


def by(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    """Who is at the keyboard now."""
    for role in ("AUTHOR", "COMMITTER"):
        monkeypatch.setenv(f"GIT_{role}_NAME", name)
        monkeypatch.setenv(f"GIT_{role}_EMAIL", f"{name.split(maxsplit=1)[0].lower()}@example.com")


def unapproved(fleet: Path, base: str) -> list[str]:
    found = check_range(Registry.open(fleet).snapshot(), base, None).findings
    return [finding.message for finding in found if finding.rule == "approval"]


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


def test_of_an_older_registry_it_is_whoever_put_it_to_use(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put_bytes(fleet, {an_entry().path: entry_yaml(an_entry())})
    [approval] = printed(capsys, "registry-show-1", "show", "fc6310r")["approved"]
    assert approval["by"] == "Ada Keeper"


class TestARule:
    def test_two_of_the_listed_people_and_not_the_author_put_it_to_use(
        self,
        fleet: Path,
        tmp_path: Path,
        capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch,
    ) -> None:
        base = asks(fleet, TWO)
        add(xml(tmp_path / "a.xml"))
        shown = looked_at(fleet, P4R)
        code, _, err = run(capsys, "approve", *shown)
        assert (code, "Ada Keeper proposed it" in err) == (4, True)
        by(monkeypatch, "Eve")
        code, _, err = run(capsys, "approve", *shown)
        assert (code, "is not among those who approve" in err) == (4, True)
        by(monkeypatch, "Bob")
        code, err, _ = run(capsys, "approve", *shown)
        assert (code, "1 of 2 approvals" in " ".join(err.split())) == (0, True)
        assert held(fleet).path.startswith("proposals/")
        # Once more by the same person is one person.
        run(capsys, "approve", *shown)
        assert held(fleet).path.startswith("proposals/")
        by(monkeypatch, "Cy")
        assert run(capsys, "approve", *shown)[0] == 0
        assert held(fleet).path.startswith("cameras/")
        approved = printed(capsys, "registry-show-1", "show", P4R)["approved"]
        assert [one["by"] for one in approved] == ["Bob", "Cy"]
        assert unapproved(fleet, base) == []

    def test_at_once_is_not_approved_by_another(
        self, fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        asks(fleet, "{not_author: true}")
        code, _, err = run(
            capsys,
            "add",
            xml(tmp_path / "a.xml"),
            "--make",
            "DJI",
            "--model",
            "FC6310R",
            "--approve",
            "--yes",
        )
        assert (code, "without --approve" in err) == (4, True)

    def test_a_status_written_by_hand_is_an_error(self, fleet: Path) -> None:
        base = asks(fleet, "{count: 1}")
        put_bytes(fleet, {an_entry().path: entry_yaml(an_entry())})
        [printed] = unapproved(fleet, base)
        assert "0 of 1 approvals" in printed

    def test_an_approval_is_of_one_content(
        self, fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        base = asks(fleet, "{count: 1}")
        add(xml(tmp_path / "a.xml"))
        run(capsys, "approve", *looked_at(fleet, P4R))
        assert unapproved(fleet, base) == []
        entry = held(fleet).entry
        put_bytes(
            fleet, {entry.path: entry_yaml(entry).replace(b'grade: "adjusted"', b'grade: "calibrated"')}
        )
        assert len(unapproved(fleet, base)) == 1

    def test_a_change_does_not_loosen_the_rules_it_is_judged_by(
        self, fleet: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        base = asks(fleet, TWO)
        file = fleet / "registry.yaml"
        file.write_text(file.read_text().partition('approvals: {by: ["Ada Keeper"')[0])
        git(fleet, "commit", "--quiet", "-am", "Ask for nothing")
        put_bytes(fleet, {an_entry().path: entry_yaml(an_entry())})
        code, out, _ = run(capsys, "check", f"{base}..HEAD")
        assert (code, "0 of 2 approvals" in out, "registry.yaml: warning: changes" in out) == (
            1,
            True,
            True,
        )

    def test_where_keys_are_listed_the_approval_is_signed(
        self, fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        if shutil.which("ssh-keygen") is None:
            pytest.skip("ssh-keygen is not installed")
        key = tmp_path / "key"
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(key)], check=True)
        base = asks(fleet, f'{{by: ["{key.with_suffix(".pub").read_text().strip()}"]}}')
        add(xml(tmp_path / "a.xml"))
        # An approval that no check would count is not written.
        code, _, err = run(capsys, "approve", *looked_at(fleet, P4R))
        assert (code, "git signs none here" in " ".join(err.split())) == (4, True)
        assert held(fleet).is_pending
        for name, value in (("gpg.format", "ssh"), ("user.signingKey", str(key)), ("commit.gpgSign", "true")):
            git(fleet, "config", "--global", name, value)
        assert run(capsys, "approve", *looked_at(fleet, P4R))[0] == 0
        assert unapproved(fleet, base) == []
        assert run(capsys, "check")[0] == 0
        other = tmp_path / "other"
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(other)], check=True)
        git(fleet, "config", "--global", "user.signingKey", str(other))
        add(xml(tmp_path / "b.xml", 3662.0))
        code, _, err = run(capsys, "approve", *looked_at(fleet, P4R), "--reason", "a new lens")
        assert (code, "user.signingkey is another one" in " ".join(err.split())) == (4, True)

    def test_an_openpgp_key_is_listed_by_its_fingerprint(
        self,
        fleet: Path,
        capsys: pytest.CaptureFixture[str],
        monkeypatch: pytest.MonkeyPatch,
        tmp_path_factory: pytest.TempPathFactory,
    ) -> None:
        if shutil.which("gpg") is None:
            pytest.skip("gpg is not installed")
        # The socket of gpg's agent lies in it, and a socket's path is short.
        with tempfile.TemporaryDirectory(prefix="gpg") as home:
            monkeypatch.setenv("GNUPGHOME", home)
            gpg = ("gpg", "--batch", "--quiet", "--pinentry-mode", "loopback", "--passphrase", "")
            person = "Ada Keeper <ada@example.com>"
            made = subprocess.run([*gpg, "--quick-gen-key", person, "ed25519", "sign", "never"], check=False)
            if made.returncode:
                pytest.skip("gpg makes no key here")
            listed = subprocess.run(
                ["gpg", "--with-colons", "-K"], capture_output=True, text=True, check=True
            )
            fingerprint = next(
                line.split(":")[9] for line in listed.stdout.splitlines() if line.startswith("fpr:")
            )
            base = asks(fleet, f'{{by: ["{fingerprint}"]}}')
            add(xml(tmp_path_factory.mktemp("lab") / "a.xml"))
            git(fleet, "config", "--global", "commit.gpgSign", "true")
            git(fleet, "config", "--global", "user.signingKey", fingerprint)
            assert run(capsys, "approve", *looked_at(fleet, P4R))[0] == 0
            assert unapproved(fleet, base) == []
            assert run(capsys, "check")[0] == 0
            # A key that is not listed counts for nothing, however good the signature is.
            registry, stored = Registry.open(fleet), held(fleet)
            assert missing_approvals(registry.repo, stored, ApprovalRule(by=(fingerprint,))) is None
            assert "0 of 1" in str(missing_approvals(registry.repo, stored, ApprovalRule(by=("0" * 40,))))
            subprocess.run(["gpgconf", "--kill", "all"], check=False)

    def test_a_check_of_everything_finds_what_was_never_approved(
        self, fleet: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        put_bytes(fleet, {an_entry().path: entry_yaml(an_entry())})
        asks(fleet, "{count: 1}")
        # What was in use before approvals were asked for is judged by what was asked for then.
        assert run(capsys, "check")[0] == 0
        by_hand = an_entry(model="FC330")
        put_bytes(fleet, {by_hand.path: entry_yaml(by_hand)})
        code, out, _ = run(capsys, "check")
        assert (code, f"{by_hand.path}: error: is approved with 0 of 1 approvals" in out) == (1, True)
        assert an_entry().path not in out
