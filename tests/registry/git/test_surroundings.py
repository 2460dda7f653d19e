"""Whatever is around a registry (variables, clocks, other users, a Ctrl-C), it answers with what it holds."""

from __future__ import annotations

import errno
import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from calibrary.errors import RegistryError
from calibrary.registry.git import locks
from calibrary.registry.git.history import commit_at, history, parse_rev
from calibrary.registry.git.program import run_git
from calibrary.registry.git.repository import Repository, create
from calibrary.registry.git.writing import identity
from tests.registry.git.repositories import ENTRY, OTHER, bare, checked_out, git, made, nobodys_git, now, put

__all__ = ["bare", "checked_out", "made", "nobodys_git"]


class _Interrupted:
    """Answers of git that somebody does not wait for once."""

    def __init__(self, answers: object) -> None:
        self._answers, self._is_first = answers, True

    def readline(self) -> bytes:
        if self._is_first:
            self._is_first = False
            raise KeyboardInterrupt
        line: bytes = self._answers.readline()  # type: ignore[attr-defined]  # a file
        return line

    def read(self, size: int) -> bytes:
        data: bytes = self._answers.read(size)  # type: ignore[attr-defined]  # a file
        return data


def test_an_answer_that_was_not_waited_for_is_not_taken_for_the_next(bare: Repository) -> None:
    put(bare, {OTHER: b"other\n"})
    tip = bare.tip()
    assert tip is not None
    reader = bare._reader()
    reader._answers = _Interrupted(reader._answers)  # type: ignore[assignment]  # as a file
    with pytest.raises(KeyboardInterrupt):
        bare.read(tip, ENTRY)
    found = bare.read(tip, OTHER)
    assert found is not None
    assert found.data == b"other\n"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("GIT_GLOB_PATHSPECS", "1"),
        ("GIT_NOGLOB_PATHSPECS", "1"),
        ("GIT_ICASE_PATHSPECS", "1"),
        ("GIT_OBJECT_DIRECTORY", "/nowhere/objects"),
        ("GIT_CONFIG_PARAMETERS", "'core.bare'='true'"),
        ("GIT_DEFAULT_HASH", "sha256"),
        ("GIT_COMMITTER_DATE", "2001-01-01T00:00Z"),
        ("GIT_EXTERNAL_DIFF", "false"),
        ("GIT_TRACE", "1"),
        ("TZ", "No/Such"),
        ("LC_ALL", "de_DE.UTF-8"),
    ],
)
def test_no_variable_around_us_changes_what_is_written_or_told(
    checked_out: Repository, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, value: str
) -> None:
    monkeypatch.setenv(name, value)
    repo = Repository.open(checked_out.path, durable=False)
    put(repo, {ENTRY: b"fx: 2.0\n"})
    put(repo, {OTHER: b"new\n"})
    tip = repo.tip()
    assert tip is not None
    assert [revision.subject for revision in history(repo, ENTRY, tip)] == ["Change it", "Change it"]
    assert (repo.path / OTHER).read_bytes() == b"new\n"
    assert put(create(tmp_path / "new", bare=True), {ENTRY: b"a\n"}).commit


def test_a_hook_that_judges_a_push_sees_what_was_pushed(bare: Repository, tmp_path: Path) -> None:
    git(tmp_path, "clone", "-q", str(bare.path), "clone")
    printed = tmp_path / "printed"
    (bare.git_dir / "hooks").mkdir(exist_ok=True)
    hook = bare.git_dir / "hooks" / "pre-receive"
    hook.write_text(
        f"#!{sys.executable}\nimport sys\nfrom pathlib import Path\n"
        "from calibrary.registry.git.repository import Repository\n"
        f"new = sys.stdin.read().split()[1]\nfound = Repository.open(Path({str(bare.path)!r})).read(new, {ENTRY!r})\n"
        f"Path({str(printed)!r}).write_bytes(found.data)\n"
    )
    hook.chmod(0o755)
    (tmp_path / "clone" / ENTRY).write_bytes(b"fx: 9.0\n")
    git(tmp_path / "clone", "commit", "-qam", "pushed")
    git(tmp_path / "clone", "push", "-q", "origin", "HEAD:main")
    assert printed.read_bytes() == b"fx: 9.0\n"


def test_a_name_in_another_encoding_does_not_stop_a_write(
    bare: Repository, nobodys_git: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("GIT_COMMITTER_NAME", "GIT_COMMITTER_EMAIL"):
        monkeypatch.delenv(name)
    nobodys_git.write_bytes(b"[user]\n\tname = Jos\xe9\n\temail = jose@example.com\n")
    repo = Repository.open(bare.path, durable=False)
    put(repo, {ENTRY: b"fx: 2.0\n"})
    assert identity(repo)[0].name == "Jos\N{REPLACEMENT CHARACTER}"
    monkeypatch.setenv("GIT_COMMITTER_NAME", os.fsdecode(b"Jos\xe9"))
    assert identity(repo)[0].name == "Jos\N{REPLACEMENT CHARACTER}"


@pytest.mark.parametrize("day", ["0001-01-01", "1969-12-31", "1970-01-01", "1971-05-01", "1973-03-03"])
def test_a_day_before_there_was_a_registry_is_never_its_newest_state(bare: Repository, day: str) -> None:
    with pytest.raises(RegistryError, match="begins later"):
        commit_at(bare, parse_rev(day))


@pytest.mark.parametrize("moment", ["0001-01-01T00:00+14:00", "9999-12-31T23:59-10:00"])
def test_a_moment_outside_of_all_calendars_is_no_date(moment: str) -> None:
    with pytest.raises(RegistryError, match="not a date"):
        parse_rev(moment)


def test_a_name_of_two_things_is_told_and_not_guessed(bare: Repository) -> None:
    first = bare.tip()
    put(bare, {ENTRY: b"fx: 2.0\n"})
    git(bare.path, "branch", "season", "main")
    git(bare.path, "tag", "season", str(first))
    with pytest.raises(RegistryError, match="refs/tags/season or refs/heads/season"):
        commit_at(bare, parse_rev("season"))
    assert commit_at(bare, parse_rev("refs/tags/season")) == first


def test_a_tag_of_what_is_no_commit_is_no_revision(bare: Repository) -> None:
    git(bare.path, "tag", "-a", "thing", "-m", "a file", f"HEAD:{ENTRY}")
    with pytest.raises(RegistryError, match="no such revision"):
        commit_at(bare, parse_rev("thing"))


@pytest.mark.parametrize("date", ["99999999999999999999 +0000", "253402300800 +0000", "-5 +0000", "", "x"])
def test_a_commit_with_an_impossible_date_is_written_on(bare: Repository, date: str) -> None:
    tree, tip = git(bare.path, "rev-parse", "HEAD^{tree}"), bare.tip()
    text = f"tree {tree}\nparent {tip}\nauthor A <a@b> {date}\ncommitter A <a@b> {date}\n\nodd\0more\n"
    options = ("hash-object", "-t", "commit", "-w", "--stdin", "--literally")
    printed = run_git(options, folder=bare.path, environment=bare.environment, stdin=text.encode())
    git(bare.path, "update-ref", "refs/heads/main", printed.out.decode().strip())
    put(bare, {ENTRY: b"fx: 2.0\n"})
    assert now(bare) == b"fx: 2.0\n"
    newest = bare.tip()
    assert newest is not None
    assert [revision.subject for revision in history(bare, None, newest)] == ["Change it", "odd", "Change it"]


@pytest.mark.parametrize("umask", [0o077, 0o022])
def test_the_lock_of_a_shared_registry_is_shared(bare: Repository, umask: int) -> None:
    bare.git_dir.chmod(0o2775)
    (bare.git_dir / "calibrary.lock").unlink(missing_ok=True)
    before = os.umask(umask)
    try:
        put(bare, {ENTRY: b"fx: 2.0\n"})
    finally:
        os.umask(before)
    assert stat.S_IMODE((bare.git_dir / "calibrary.lock").stat().st_mode) & 0o060 == 0o060


@pytest.mark.skipif(os.geteuid() != 0, reason="only root gives files away")
def test_a_registry_of_another_user_is_not_opened_unasked(bare: Repository, nobodys_git: Path) -> None:
    subprocess.run(["chown", "-R", "65534", str(bare.path)], check=True)
    with pytest.raises(RegistryError, match=r"belongs to another user.*safe\.directory"):
        Repository.open(bare.path)
    with nobodys_git.open("a") as file:
        file.write(f"[safe]\n\tdirectory = {bare.path}\n")
    assert Repository.open(bare.path).tip() == bare.tip()


def test_a_bare_registry_opens_where_git_is_told_to_overlook_them(
    bare: Repository, nobodys_git: Path
) -> None:
    with nobodys_git.open("a") as file:
        file.write("[safe]\n\tbareRepository = explicit\n")
    assert Repository.open(bare.path).tip() == bare.tip()


def test_a_message_that_is_no_utf8_does_not_hide_the_history(bare: Repository) -> None:
    tree, tip = git(bare.path, "rev-parse", "HEAD^{tree}"), bare.tip()
    head = (
        f"tree {tree}\nparent {tip}\nauthor \xc4 <a@b> 2000000000 +0000\ncommitter A <a@b> 2000000000 +0000\n"
    )
    text = head.encode("latin-1") + b"\n\xff\xfe said\n"
    options = ("hash-object", "-t", "commit", "-w", "--stdin", "--literally")
    printed = run_git(options, folder=bare.path, environment=bare.environment, stdin=text)
    git(bare.path, "update-ref", "refs/heads/main", printed.out.decode().strip())
    newest = bare.tip()
    assert newest is not None
    revisions = history(bare, None, newest)
    assert len(revisions) == 2
    assert revisions[0].subject.endswith("said")


def test_a_day_before_the_cut_of_a_shallow_clone_says_how_to_get_the_rest(
    bare: Repository, tmp_path: Path
) -> None:
    git(tmp_path, "clone", "-q", "--bare", "--depth=1", bare.path.as_uri(), "shallow")
    with pytest.raises(RegistryError, match="--unshallow"):
        commit_at(Repository.open(tmp_path / "shallow"), parse_rev("2001-01-01"))


def test_a_disk_without_locks_is_said_and_nothing_is_written(
    bare: Repository, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuses(_: int) -> None:
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    before = bare.tip()
    monkeypatch.setattr(locks, "_try_lock", refuses)
    with pytest.raises(RegistryError, match=r"grants no locks \(No locks available\)"):
        put(bare, {OTHER: b"other\n"})
    assert bare.tip() == before
