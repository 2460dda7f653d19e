"""A write is whole or not at all, overwrites nobody, and says what it did."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from calibrary.errors import ConflictError, RegistryError
from calibrary.registry.git import writing
from calibrary.registry.git.commits import File, Person, Step, land, stream
from calibrary.registry.git.errors import FileConflictError
from calibrary.registry.git.locks import writer_lock
from calibrary.registry.git.maintenance import create, is_due, maintain
from calibrary.registry.git.names import check_branch
from calibrary.registry.git.objects import LARGEST_FILE, blob_id
from calibrary.registry.git.repository import Repository
from calibrary.registry.git.signatures import signatures
from calibrary.registry.git.writing import ANY, Change, identity, write
from calibrary.registry.paths import check_path
from tests.registry.git.repositories import ENTRY, OTHER, bare, checked_out, git, made, nobodys_git, now, put

__all__ = ["bare", "checked_out", "made", "nobodys_git"]

ADA = Person(name="Ada", email="ada@example.com")


def test_a_change_made_from_old_content_is_a_conflict_with_all_three_versions(bare: Repository) -> None:
    base = blob_id(b"fx: 1.0\n")
    put(bare, {ENTRY: b"fx: 2.0\n"})
    before = bare.tip()
    with pytest.raises(FileConflictError, match="changed by another writer; nothing was written") as caught:
        write(bare, [Change(path=ENTRY, data=b"fx: 3.0\n", base=base)], "too late\n")
    assert isinstance(caught.value, ConflictError)
    (conflict,) = caught.value.conflicts
    assert (conflict.base, conflict.ours, conflict.theirs) == (b"fx: 1.0\n", b"fx: 3.0\n", b"fx: 2.0\n")
    assert conflict.theirs_oid == blob_id(b"fx: 2.0\n")
    assert bare.tip() == before


@pytest.mark.parametrize(
    ("base", "data", "expected"),
    [
        (None, b"new\n", "was added by another writer"),
        ("1" * 40, b"new\n", "was changed by another writer"),
        ("1" * 40, None, "was changed by another writer"),
    ],
)
def test_an_entry_is_neither_added_twice_nor_removed_unseen(
    bare: Repository, base: str | None, data: bytes | None, expected: str
) -> None:
    with pytest.raises(FileConflictError, match=expected):
        write(bare, [Change(path=ENTRY, data=data, base=base)], "x\n")


def test_a_change_of_what_was_removed_is_a_conflict(bare: Repository) -> None:
    put(bare, {ENTRY: None})
    with pytest.raises(FileConflictError, match="was removed by another writer"):
        write(bare, [Change(path=ENTRY, data=b"new\n", base=blob_id(b"fx: 1.0\n"))], "x\n")


def test_one_conflict_among_many_changes_writes_none_of_them(bare: Repository) -> None:
    before = bare.tip()
    with pytest.raises(FileConflictError):
        write(bare, [Change(path=OTHER, data=b"x\n"), Change(path=ENTRY, data=b"x\n")], "x\n")
    assert bare.tip() == before
    assert now(bare, OTHER) is None


def test_what_stands_there_already_is_not_written_again(bare: Repository) -> None:
    before = bare.tip()
    written = put(bare, {ENTRY: b"fx: 1.0\n"}, subject="the same")
    assert (written.commit, written.paths) == (before, {})
    assert bare.tip() == before


def test_many_entries_are_one_commit(bare: Repository) -> None:
    files: dict[str, bytes | None] = {f"cameras/m/m{i}/a.yaml": b"n: %d\n" % i for i in range(300)}
    before = bare.tip()
    written = put(bare, files | {ENTRY: None})
    assert git(bare.path, "rev-list", "--count", f"{before}..{written.commit}") == "1"
    assert bare.listing(written.commit) == {path: blob_id(data) for path, data in files.items() if data}
    assert written.paths[ENTRY] is None


def test_a_rename_is_one_commit_and_the_old_path_is_free(bare: Repository) -> None:
    base = blob_id(b"fx: 1.0\n")
    moves = [Change(path=ENTRY, data=None, base=base), Change(path=OTHER, data=b"fx: 1.0\n")]
    write(bare, moves, "rename\n")
    assert (now(bare), now(bare, OTHER)) == (None, b"fx: 1.0\n")


def test_a_file_may_take_the_place_of_a_folder_that_the_same_commit_empties(bare: Repository) -> None:
    put(bare, {"cameras/a/b/c.yaml": b"1\n"})
    moves = {"cameras/a/b/c.yaml": None, "cameras/a/d.yaml": b"1\n"}
    put(bare, moves)
    assert git(bare.path, "ls-tree", "-r", "--name-only", "main", "cameras/a/") == "cameras/a/d.yaml"
    git(bare.path, "fsck", "--strict")


@pytest.mark.parametrize(
    "path",
    [
        "../x.yaml",
        "cameras/../x.yaml",
        "cameras/./x.yaml",
        ".git/config",
        "cameras/.git/x.yaml",
        "cameras/git~1/x.yaml",
        "/etc/x.yaml",
        "cameras//x.yaml",
        "cameras/a.yaml/b.yaml",
        "cameras/a b.yaml",
        "cameras/a\nM 100644 inline x.yaml",
        "cameras/a\0.yaml",
        "cameras/DJI/x.yaml",
        "cameras/con/x.yaml",
        "cameras/nul.txt/x.yaml",
        "cameras/-x.yaml",
        "cameras/a./x.yaml",
        "cameras/a..b/x.yaml",
        "cameras/a/x.yaml.lock",
        "cameras/é/x.yaml",
        "cameras/" + "a" * 200 + ".yaml",
        "cameras/" + "a/" * 20 + "x.yaml",
        "cameras/x.exe",
        "cameras",
        "README.md/x",
        ".github/workflows/../x.yml",
        '"cameras/x.yaml"',
        "",
    ],
)
def test_a_path_outside_the_registry_is_refused(bare: Repository, path: str) -> None:
    before = bare.tip()
    with pytest.raises(RegistryError, match="not allowed in a registry"):
        write(bare, [Change(path=path, data=b"x\n")], "x\n")
    assert bare.tip() == before


@pytest.mark.parametrize(
    "path",
    [
        "registry.yaml",
        "README.md",
        ".gitattributes",
        ".github/workflows/check.yml",
        "schema/entry-1.schema.json",
        "cameras/dji/fc6310/sn-0123456789ab/5472x3648_photo_f8.8.yaml",
        "cameras/dji/x~9cdf6a5010/a.yaml",
        "cameras/console/compact/x.yaml",
    ],
)
def test_the_paths_of_a_registry_are_taken(path: str) -> None:
    assert check_path(path) == path


@pytest.mark.parametrize(
    "name", ["-x", "a..b", "x.lock", "a//b", "refs heads", "HEAD", "a\n", "a/.b", "x@{1}", ""]
)
def test_a_branch_that_git_would_misread_is_refused(name: str) -> None:
    with pytest.raises(RegistryError, match="not a branch name"):
        check_branch(name)


def test_a_file_too_large_or_changed_twice_is_refused(bare: Repository) -> None:
    with pytest.raises(RegistryError, match="expected at most"):
        put(bare, {OTHER: b"x" * (LARGEST_FILE + 1)})
    with pytest.raises(RegistryError, match="changed twice"):
        write(bare, [Change(path=OTHER, data=b"1"), Change(path=OTHER, data=b"2")], "x\n")


def test_the_content_of_a_stream_cannot_speak_to_git(bare: Repository) -> None:
    data = b"done\nreset refs/heads/main\n\nfrom 0000000000000000000000000000000000000000\ndone\n"
    before = bare.tip()
    put(bare, {OTHER: data}, subject="x\ndata 5\nfeature force")
    assert now(bare, OTHER) == data
    assert git(bare.path, "rev-parse", "main~1") == before


def test_a_stream_that_breaks_off_anywhere_changes_nothing(bare: Repository) -> None:
    before = bare.tip()
    moment = datetime.now(UTC)
    step = Step(
        files=[File(path=OTHER, data=b"half\n")],
        message="m\n",
        author=ADA,
        authored=moment,
        committer=ADA,
        committed=moment,
    )
    whole = stream("refs/heads/main", before, [step])
    for cut in range(1, len(whole) - 1, 29):
        code = bare.run(
            "fast-import", "--quiet", "--date-format=raw", stdin=whole[:cut], good=(0, 1, 128)
        ).code
        assert code != 0, whole[:cut]
        assert bare.tip() == before
    # What is left of it is reachable from nowhere, and goes with the next gc.
    git(bare.path, "fsck", "--strict", "--connectivity-only")


def test_a_branch_moved_by_plain_git_in_between_is_not_lost(
    checked_out: Repository, monkeypatch: pytest.MonkeyPatch
) -> None:
    bare_copy = create(checked_out.path.parent / "race", bare=True, durable=False)
    put(bare_copy, {ENTRY: b"fx: 1.0\n"})
    rival = Repository.open(bare_copy.path)
    overtaken: list[str] = []

    def slow(repo: Repository, ref: str, parent: str | None, steps: list[Step], old: str | None) -> object:
        if not overtaken:
            tree = git(rival.path, "rev-parse", "main^{tree}")
            theirs = git(rival.path, "commit-tree", "-p", "main", "-m", "theirs", tree)
            git(rival.path, "update-ref", "refs/heads/main", theirs)
            overtaken.append(theirs)
        return land(repo, ref, parent, steps, old)

    monkeypatch.setattr(writing, "land", slow)
    put(bare_copy, {OTHER: b"fx: 3.0\n"})
    assert git(bare_copy.path, "rev-parse", "main~1") == overtaken[0]


def test_an_entry_changed_by_plain_git_in_between_is_a_conflict(
    bare: Repository, monkeypatch: pytest.MonkeyPatch
) -> None:
    def slow(repo: Repository, ref: str, parent: str | None, steps: list[Step], old: str | None) -> object:
        if now(bare) == b"fx: 1.0\n":
            theirs = f"commit refs/heads/main\ncommitter T <t@t> 2000000000 +0000\ndata 1\nt\nfrom {old}\n"
            theirs += f"M 100644 inline {ENTRY}\ndata 8\nfx: 9.0\n\n"
            bare.run("fast-import", "--quiet", stdin=theirs.encode())
        return land(repo, ref, parent, steps, old)

    monkeypatch.setattr(writing, "land", slow)
    with pytest.raises(FileConflictError) as raised:
        put(bare, {ENTRY: b"fx: 2.0\n"})
    assert [conflict.theirs for conflict in raised.value.conflicts] == [b"fx: 9.0\n"]
    assert now(bare) == b"fx: 9.0\n"


def test_another_branch_begins_where_the_main_one_stands(checked_out: Repository) -> None:
    before = checked_out.tip()
    written = put(checked_out, {OTHER: b"x\n"}, branch="onboard/fc330")
    assert checked_out.tip() == before == written.parent
    assert checked_out.tip("refs/heads/onboard/fc330") == written.commit
    assert git(checked_out.path, "status", "--porcelain") == ""
    change = Change(path=OTHER, data=b"y\n", base=blob_id(b"x\n"))
    write(checked_out, [change], "again\n", branch="onboard/fc330")
    assert git(checked_out.path, "rev-list", "--count", "main..onboard/fc330") == "2"


def test_a_detached_head_is_read_but_not_written(checked_out: Repository) -> None:
    git(checked_out.path, "switch", "-q", "--detach")
    assert now(checked_out) == b"fx: 1.0\n"
    with pytest.raises(RegistryError, match="HEAD is detached"):
        put(checked_out, {ENTRY: b"fx: 2.0\n"})
    put(checked_out, {ENTRY: b"fx: 2.0\n"}, branch="main")
    assert git(checked_out.path, "show", f"main:{ENTRY}") == "fx: 2.0"
    assert now(checked_out) == b"fx: 1.0\n"


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
            assert not lock.heal(path, older_than_s=10.0)
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
    write(bare, [Change(path=OTHER, data=b"x\n")], "x\n", author=author)
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
    write(bare, [Change(path="README.md", data=b"1\n", base=ANY)], "x\n")
    write(bare, [Change(path="README.md", data=b"2\n", base=ANY)], "x\n")
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
from calibrary.registry.git.writing import Change, write
repo = Repository.open(Path(sys.argv[1]))
entry = "cameras/dji/fc6310/5472x3648.yaml"
print("read:", repo.read(repo.tip(), entry).data)
data = b"fx: 2.0" if len(sys.argv) == 2 else random.Random(1).randbytes(900_000)
try:
    write(repo, [Change(path=entry, data=data, base=blob_id(b"fx: 1.0\\n"))], "x")
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
    states = signatures(repo, [written.commit, again.commit, unsigned], signing)
    assert [state.state for state in states] == ["G", "G", "N"]
    assert states[0].signer == "ada@example.com"
    assert git(bare.path, "for-each-ref", "--format=%(refname)") == "refs/heads/main"
    assert git(bare.path, "log", "--format=%s", "-2", "--reverse") == "Signed — ✓\nChange it"


def test_a_signature_by_a_stranger_is_not_good(bare: Repository, signing: Path, tmp_path: Path) -> None:
    repo = Repository.open(bare.path, durable=False)
    written = put(repo, {OTHER: b"x\n"})
    nobody = tmp_path / "nobody"
    nobody.write_text("")
    git(bare.path, "config", "gpg.ssh.allowedSignersFile", str(signing))
    git(bare.path, "config", "gpg.ssh.program", "true")
    repo = Repository.open(bare.path)
    assert "gpg.ssh.program" in repo.silenced
    assert signatures(repo, [written.commit], signing)[0].is_good
    assert [state.is_good for state in signatures(repo, [written.commit], nobody)] == [False]
    assert [state.is_good for state in signatures(repo, [written.commit], None)] == [False]
