"""What a commit says, by whom and when; disks, locks, signatures and maintenance."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from calibrary.errors import RegistryError
from calibrary.registry.git.locks import writer_lock
from calibrary.registry.git.repository import Repository, create, is_due, maintain
from calibrary.registry.git.writing import ANY, FileChange, Person, identity, write
from tests.registry.git.repositories import ENTRY, OTHER, bare, checked_out, git, made, nobodys_git, now, put

__all__ = ["bare", "checked_out", "made", "nobodys_git"]


def test_a_lock_that_a_killed_writer_left_is_healed(bare: Repository) -> None:
    for name in ("HEAD.lock", "refs/heads/main.lock"):
        lock = bare.common_dir / name
        lock.touch()
        long_ago = time.time() - 60
        os.utime(lock, (long_ago, long_ago))
        put(bare, {ENTRY: name.encode()})
        assert now(bare) == name.encode()
        assert not lock.exists()


def test_a_lock_dated_in_the_future_is_healed_too(bare: Repository) -> None:
    lock = bare.common_dir / "refs/heads/main.lock"
    lock.touch()
    os.utime(lock, (time.time() + 3600,) * 2)
    put(bare, {ENTRY: b"fx: 2.0\n"})
    assert not lock.exists()


def test_a_young_lock_and_the_lock_of_the_index_are_left_alone(bare: Repository) -> None:
    with writer_lock(bare.common_dir, wait_s=1.0) as lock:
        for name, age_s in (("refs/heads/main.lock", 1), ("index.lock", 3600), ("../outside.lock", 3600)):
            path = bare.common_dir / name
            path.touch()
            os.utime(path, (time.time() - age_s,) * 2)
            assert not lock.remove_stale(path, older_than_s=10.0)
            assert path.exists()
            path.unlink()


def test_a_writer_that_waits_too_long_is_told_for_whom(bare: Repository) -> None:
    with (
        writer_lock(bare.common_dir, wait_s=1.0),
        pytest.raises(RegistryError, match="another process"),
        writer_lock(bare.common_dir, wait_s=0.05),
    ):
        pass


def test_a_clock_that_runs_behind_does_not_date_a_commit_before_its_parent(bare: Repository) -> None:
    ahead = datetime.now(UTC) + timedelta(hours=3)
    put(bare, {ENTRY: b"fx: 2.0\n"}, now=ahead)
    written = put(bare, {ENTRY: b"fx: 3.0\n"})
    assert bare.committed_at(written.commit) == int(ahead.timestamp())
    assert written.warnings == ()


def test_a_parent_from_the_far_future_is_told_and_not_followed(bare: Repository) -> None:
    put(bare, {ENTRY: b"fx: 2.0\n"}, now=datetime(2090, 1, 1, tzinfo=UTC))
    written = put(bare, {ENTRY: b"fx: 3.0\n"})
    assert any("ahead of this machine's clock" in warning for warning in written.warnings)
    assert bare.committed_at(written.commit) < time.time() + 60


def test_the_history_names_whom_git_knows(
    bare: Repository, monkeypatch: pytest.MonkeyPatch, nobodys_git: Path
) -> None:
    monkeypatch.delenv("GIT_COMMITTER_NAME")
    monkeypatch.delenv("GIT_COMMITTER_EMAIL")
    with nobodys_git.open("a") as file:
        file.write("[user]\n\tname = Grace Keeper\n\temail = grace@example.com\n")
    repo = Repository.open(bare.path)
    assert put(repo, {ENTRY: b"fx: 2.0\n"}).warnings == ()
    assert git(repo.path, "log", "-1", "--format=%cn <%ce>") == "Grace Keeper <grace@example.com>"


def test_whom_git_does_not_know_commits_by_the_login_and_is_told(
    bare: Repository, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("GIT_COMMITTER_NAME")
    monkeypatch.delenv("GIT_COMMITTER_EMAIL")
    person, warnings = identity(bare)
    assert "@" in person.email
    assert "git config --global user.name" in warnings[0]
    assert put(bare, {ENTRY: b"fx: 2.0\n"}).warnings == warnings


def test_a_name_cannot_break_out_of_its_line(bare: Repository) -> None:
    author = Person(name="Eve>\ncommitter x <y", email="<e\n@x>")
    write(bare, [FileChange(path=OTHER, data=b"x\n")], "x\n", author=author)
    assert git(bare.path, "log", "-1", "--format=%an|%ae") == "Evecommitter x y|e@x"
    git(bare.path, "fsck", "--strict")


def test_a_commit_before_the_first_needs_no_parent_and_the_second_has_it(tmp_path: Path) -> None:
    repo = create(tmp_path / "new", bare=True, durable=True)
    first = put(repo, {"registry.yaml": b"layout: 1\n"})
    assert first.parent is None
    assert put(repo, {ENTRY: b"x\n"}).parent == first.commit
    with pytest.raises(RegistryError, match="nothing to write"):
        write(create(tmp_path / "other", bare=True), [], "x\n")


def test_files_of_calibrarys_own_may_be_written_from_whatever_stands_there(bare: Repository) -> None:
    write(bare, [FileChange(path="README.md", data=b"1\n", base=ANY)], "x\n")
    write(bare, [FileChange(path="README.md", data=b"2\n", base=ANY)], "x\n")
    assert now(bare, "README.md") == b"2\n"


@pytest.mark.skipif(os.name != "posix", reason="file permissions are POSIX's")
def test_a_disk_that_may_not_be_written_is_told_and_still_read(bare: Repository) -> None:
    if os.geteuid() == 0:
        if _unshared("true").returncode:
            pytest.skip("root ignores permissions, and no read-only mount is allowed here")
        script = 'mount --bind $1 $1 && mount -o remount,ro,bind $1 && exec $0 -c "$2" $1'
        printed = _unshared(script, str(bare.path), WRITE_ONE).stdout
    else:
        for path in (bare.path, *bare.path.rglob("*")):
            path.chmod(path.stat().st_mode & ~0o222)
        printed = _run(WRITE_ONE, bare.path).stdout
        for path in (bare.path, *bare.path.rglob("*")):
            path.chmod(path.stat().st_mode | 0o200)
    assert "read: b'fx: 1.0" in printed
    assert "RegistryError" in printed
    assert "cannot be written" in printed
    assert now(bare) == b"fx: 1.0\n"


@pytest.mark.skipif(os.name != "posix", reason="limits of resources are POSIX's")
def test_a_full_disk_leaves_the_old_state_and_says_so(bare: Repository, tmp_path: Path) -> None:
    place = tmp_path / "small"
    place.mkdir()
    script = 'mount -t tmpfs -o size=400k tmpfs $1 && cp -r $2/. $1 && exec $0 -c "$3" $1 large'
    printed, why = _unshared(script, str(place), str(bare.path), WRITE_ONE).stdout, "the disk is full"
    if not printed:
        why = "may not grow"
        limited = f"import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (300_000,) * 2)\n{WRITE_ONE}"
        printed = _run(limited, bare.path, "large").stdout
    assert "RegistryError" in printed, printed
    assert why in printed
    assert "after: b'fx: 1.0" in printed
    assert "crash" not in printed.partition("left:")[2]


WRITE_ONE = """
import os, random, sys
from pathlib import Path
from calibrary.errors import RegistryError
from calibrary.registry.git.objects import blob_id
from calibrary.registry.git.repository import Repository
from calibrary.registry.git.writing import FileChange, write
repo = Repository.open(Path(sys.argv[1]))
entry = "cameras/dji/fc6310/5472x3648.yaml"
print("read:", repo.read(repo.tip(), entry).data)
data = b"fx: 2.0" if len(sys.argv) == 2 else random.Random(1).randbytes(900_000)
try:
    write(repo, [FileChange(path=entry, data=data, base=blob_id(b"fx: 1.0\\n"))], "x")
except RegistryError as error:
    print("RegistryError", error)
print("after:", repo.read(repo.tip(), entry).data[:8])
print("left:", os.listdir(repo.git_dir))
"""


def _run(code: str, *arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def _unshared(script: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """A script with mounts of its own, where that is allowed; $0 is this Python."""
    command = ["unshare", "--mount", "--map-root-user", "sh", "-c", script, sys.executable, *arguments]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return subprocess.CompletedProcess(command, 127, "", "")


def test_maintenance_packs_and_changes_nothing(bare: Repository) -> None:
    for number in range(3):
        put(bare, {ENTRY: b"fx: %d\n" % number})
    before = bare.tip()
    assert not is_due(bare)
    maintain(bare)
    assert (bare.tip(), now(bare)) == (before, b"fx: 2\n")
    assert (bare.common_dir / "objects" / "info" / "commit-graph").exists()
    assert git(bare.path, "count-objects").startswith("0 objects")


def test_maintenance_is_due_after_some_hundreds_of_writes(bare: Repository) -> None:
    sample = bare.common_dir / "objects" / "17"
    sample.mkdir(exist_ok=True)
    for number in range(10):
        (sample / f"{number:038x}").touch()
    assert is_due(bare)


@pytest.fixture
def signing(nobodys_git: Path, tmp_path: Path) -> Path:
    """A user who signs with an ssh key; the file that trusts it."""
    if shutil.which("ssh-keygen") is None:
        pytest.skip("ssh-keygen is not installed")
    key = tmp_path / "key"
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(key)], check=True)
    with nobodys_git.open("a") as file:
        file.write(f"[commit]\n\tgpgSign = true\n[gpg]\n\tformat = ssh\n[user]\n\tsigningKey = {key}\n")
    signers = tmp_path / "signers"
    signers.write_text(f"ada@example.com {key.with_suffix('.pub').read_text()}")
    return signers


def test_a_user_who_signs_gets_signed_commits_and_no_ref_stays_behind(
    bare: Repository, signing: Path
) -> None:
    unsigned = bare.tip()
    assert unsigned is not None
    repo = Repository.open(bare.path, durable=False)
    written = put(repo, {OTHER: b"x\n"}, subject="Signed — ✓")
    again = put(repo, {OTHER: b"y\n"})
    signers = f"gpg.ssh.allowedSignersFile={signing}"
    command = ("-c", signers, "log", "--no-walk=unsorted", "--format=%G? %GS")
    shown = git(bare.path, *command, written.commit, again.commit, unsigned).splitlines()
    assert shown == ["G ada@example.com", "G ada@example.com", "N"]
    assert git(bare.path, "for-each-ref", "--format=%(refname)") == "refs/heads/main"
    assert git(bare.path, "log", "--format=%s", "-2", "--reverse") == "Signed — ✓\nChange it"
