"""The work tree follows every commit and is never overwritten."""

from __future__ import annotations

import os
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from calibrary.errors import RegistryError
from calibrary.registry.git import writing
from calibrary.registry.git.repository import Repository, create
from tests.registry.git.repositories import ENTRY, OTHER, bare, checked_out, git, made, nobodys_git, now, put

__all__ = ["bare", "checked_out", "made", "nobodys_git"]


def test_a_commit_shows_in_the_files_and_leaves_nothing_staged(checked_out: Repository) -> None:
    put(checked_out, {ENTRY: b"fx: 2.0\n", OTHER: b"new\n"})
    assert (checked_out.path / ENTRY).read_bytes() == b"fx: 2.0\n"
    assert (checked_out.path / OTHER).read_bytes() == b"new\n"
    put(checked_out, {OTHER: None})
    assert not (checked_out.path / OTHER).exists()
    assert git(checked_out.path, "status", "--porcelain") == ""


@pytest.mark.parametrize("how", ["edited", "staged", "removed", "untracked", "ignored", "a folder's link"])
def test_a_persons_work_in_the_way_stops_the_write_before_anything_is_committed(
    checked_out: Repository, how: str, tmp_path: Path
) -> None:
    folder, entry = checked_out.path, checked_out.path / ENTRY
    path = ENTRY
    match how:
        case "edited":
            entry.write_bytes(b"by hand\n")
        case "staged":
            entry.write_bytes(b"by hand\n")
            git(folder, "add", ENTRY)
            entry.write_bytes(b"fx: 1.0\n")
        case "removed":
            entry.unlink()
        case "untracked" | "ignored":
            path = OTHER
            (folder / OTHER).parent.mkdir()
            (folder / OTHER).write_bytes(b"by hand\n")
            (folder / ".git" / "info").mkdir(exist_ok=True)
            (folder / ".git" / "info" / "exclude").write_text("fc330\n" if how == "ignored" else "")
        case "a folder's link":
            path = OTHER
            (folder / OTHER).parent.symlink_to(tmp_path)
    before, seen = checked_out.tip(), files_of(folder)
    with pytest.raises(RegistryError, match="edited and not committed; nothing was written"):
        put(checked_out, {path: b"fx: 2.0\n"})
    assert checked_out.tip() == before
    assert files_of(folder) == seen


def files_of(folder: Path) -> dict[str, bytes]:
    return {
        str(path): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and ".git" not in path.relative_to(folder).parts
    }


def test_a_persons_work_elsewhere_is_left_as_it_is(checked_out: Repository) -> None:
    put(checked_out, {OTHER: b"other\n"})
    (checked_out.path / OTHER).write_bytes(b"by hand\n")
    (checked_out.path / "notes.txt").write_text("mine")
    (checked_out.path / "staged.txt").write_text("mine")
    git(checked_out.path, "add", "staged.txt")
    put(checked_out, {ENTRY: b"fx: 2.0\n"})
    assert (checked_out.path / OTHER).read_bytes() == b"by hand\n"
    status = git(checked_out.path, "status", "--porcelain").splitlines()
    assert sorted(line.strip() for line in status) == ["?? notes.txt", "A  staged.txt", f"M {OTHER}"]
    assert (checked_out.path / ENTRY).read_bytes() == b"fx: 2.0\n"


def test_the_first_commit_keeps_what_a_person_has_staged(tmp_path: Path) -> None:
    repo = create(tmp_path / "new", durable=False)
    (repo.path / "staged.txt").write_text("mine")
    git(repo.path, "add", "staged.txt")
    put(repo, {ENTRY: b"fx: 1.0\n"})
    assert git(repo.path, "status", "--porcelain") == "A  staged.txt"
    assert (repo.path / "staged.txt").read_text() == "mine"


def test_a_merge_under_way_is_finished_by_the_person_first(checked_out: Repository) -> None:
    (checked_out.git_dir / "MERGE_HEAD").write_text(f"{checked_out.tip()}\n")
    with pytest.raises(RegistryError, match="a merge is in progress"):
        put(checked_out, {ENTRY: b"fx: 2.0\n"})


def test_a_git_that_holds_the_index_is_waited_for_and_then_named(
    checked_out: Repository, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writing, "INDEX_WAIT_S", 0.05)
    (checked_out.git_dir / "index.lock").touch()
    before = checked_out.tip()
    with pytest.raises(RegistryError, match=r"index.lock: another git command"):
        put(checked_out, {ENTRY: b"fx: 2.0\n"})
    assert checked_out.tip() == before


def test_a_checkout_with_other_line_ends_is_no_edit_and_changes_no_bytes(
    tmp_path: Path, nobodys_git: Path
) -> None:
    with nobodys_git.open("a") as file:
        file.write("[core]\n\tautocrlf = true\n")
    plain = create(tmp_path / "plain", durable=False)
    put(plain, {ENTRY: b"fx: 1.0\nfy: 1.0\n"})
    assert (plain.path / ENTRY).read_bytes() == b"fx: 1.0\r\nfy: 1.0\r\n"
    put(plain, {ENTRY: b"fx: 2.0\nfy: 2.0\n"})
    assert now(plain) == b"fx: 2.0\nfy: 2.0\n"
    assert git(plain.path, "status", "--porcelain") == ""
    put(plain, {".gitattributes": b"*.yaml text eol=lf\n"})
    put(plain, {OTHER: b"a\nb\n"})
    assert (plain.path / OTHER).read_bytes() == b"a\nb\n"


KILLED = """
import os, sys
from pathlib import Path
from typing import Any
from calibrary.registry.git import writing
from calibrary.registry.git.objects import blob_id
from calibrary.registry.git.repository import Repository
from calibrary.registry.git.writing import FileChange, write

writing.update_work_tree = lambda *_: os._exit(9)
repo = Repository.open(Path(sys.argv[1]))
write(repo, [FileChange(path=sys.argv[2], data=b"fx: 2.0\\n", base=blob_id(b"fx: 1.0\\n"))], "killed\\n")
"""


def killed_between_commit_and_files(repo: Repository) -> None:
    done = subprocess.run([sys.executable, "-c", KILLED, str(repo.path), ENTRY], check=False)
    assert done.returncode == 9
    assert now(repo) == b"fx: 2.0\n"
    assert (repo.path / ENTRY).read_bytes() == b"fx: 1.0\n"


def test_files_that_a_killed_writer_left_behind_are_brought_up_by_the_next(checked_out: Repository) -> None:
    killed_between_commit_and_files(checked_out)
    put(checked_out, {OTHER: b"next\n"})
    assert (checked_out.path / ENTRY).read_bytes() == b"fx: 2.0\n"
    assert git(checked_out.path, "status", "--porcelain") == ""


@pytest.mark.parametrize("is_staged", [False, True])
def test_files_left_behind_and_edited_since_are_not_overwritten_and_what_is_advised_leads_on(
    checked_out: Repository, tmp_path: Path, is_staged: bool
) -> None:
    killed_between_commit_and_files(checked_out)
    edited = checked_out.path / ENTRY
    edited.write_bytes(b"by hand\n")
    if is_staged:
        git(checked_out.path, "add", ENTRY)
    with pytest.raises(RegistryError, match="older than its last commit") as refused:
        put(checked_out, {OTHER: b"next\n"})
    assert edited.read_bytes() == b"by hand\n"
    assert ENTRY in str(refused.value)
    edited.rename(tmp_path / "mine")
    git(checked_out.path, "restore", "--staged", "--worktree", "--", ENTRY)
    put(checked_out, {OTHER: b"next\n"})
    assert edited.read_bytes() == b"fx: 2.0\n"


@pytest.mark.parametrize("left", [b"", b"fx: ", b"fx: 0.5\n"], ids=["empty", "half", "of an older commit"])
def test_a_file_that_a_killed_writer_or_its_git_left_half_or_older_is_written_again(
    checked_out: Repository, left: bytes
) -> None:
    for data in (b"fx: 0.5\n", b"fx: 1.0\n"):
        put(checked_out, {ENTRY: data})
    killed_between_commit_and_files(checked_out)
    (checked_out.path / ENTRY).write_bytes(left)
    put(checked_out, {OTHER: b"next\n"})
    assert (checked_out.path / ENTRY).read_bytes() == b"fx: 2.0\n"
    assert git(checked_out.path, "status", "--porcelain") == ""


@pytest.mark.parametrize("how", ["changed later", "after a reset", "staged"])
def test_an_older_version_that_a_person_put_back_after_a_kill_is_not_overwritten(
    checked_out: Repository, how: str
) -> None:
    for data in (b"fx: 0.5\n", b"fx: 1.0\n"):
        put(checked_out, {ENTRY: data})
    killed_between_commit_and_files(checked_out)
    if how == "after a reset":
        git(checked_out.path, "reset", "--hard")
    entry = checked_out.path / ENTRY
    entry.write_bytes(b"fx: 0.5\n")
    match how:
        case "changed later":
            later = entry.stat().st_mtime + 2 * writing.LATE_GIT_S
            os.utime(entry, (later, later))
        case "staged":
            git(checked_out.path, "add", ENTRY)
    with suppress(RegistryError):
        put(checked_out, {OTHER: b"next\n"})
    assert entry.read_bytes() == b"fx: 0.5\n"


def test_the_git_of_a_killed_writer_that_goes_on_changes_no_later_index(
    checked_out: Repository, monkeypatch: pytest.MonkeyPatch
) -> None:
    older, given, real = checked_out.newest(), list[Any](), Repository.run

    def run(repo: Repository, *arguments: str, **options: Any) -> Any:
        done = real(repo, *arguments, **options)
        if "GIT_INDEX_FILE" in (options.get("extra") or {}):
            given.append(options["extra"])
            if len(given) > 1:
                real(repo, "read-tree", older, extra=given[0])
        return done

    monkeypatch.setattr(Repository, "run", run)
    put(checked_out, {ENTRY: b"fx: 2.0\n"})
    put(checked_out, {ENTRY: b"fx: 3.0\n"})
    assert len(given) > 1
    assert git(checked_out.path, "status", "--porcelain") == ""


def test_a_branch_that_another_work_tree_shows_is_written_there_only(
    checked_out: Repository, tmp_path: Path
) -> None:
    git(checked_out.path, "worktree", "add", "-q", "-b", "side", str(tmp_path / "side"))
    with pytest.raises(RegistryError, match="checked out in another work tree"):
        put(checked_out, {ENTRY: b"fx: 2.0\n"}, branch="side")
    side = Repository.open(tmp_path / "side", durable=False)
    put(side, {ENTRY: b"fx: 2.0\n"})
    assert (side.path / ENTRY).read_bytes() == b"fx: 2.0\n"
    assert git(side.path, "status", "--porcelain") == ""
    assert (now(side), now(checked_out)) == (b"fx: 2.0\n", b"fx: 1.0\n")


@pytest.mark.skipif(os.name != "posix", reason="links to folders")
def test_a_registry_opened_through_a_link_is_the_same(checked_out: Repository, tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to(checked_out.path)
    put(Repository.open(tmp_path / "link", durable=False), {ENTRY: b"fx: 2.0\n"})
    assert now(checked_out) == b"fx: 2.0\n"
    assert git(checked_out.path, "status", "--porcelain") == ""


KILLED_WITH_FILES = """
import os, sys
from pathlib import Path
from typing import Any
from calibrary.registry.git.objects import blob_id
from calibrary.registry.git.repository import Repository
from calibrary.registry.git.writing import FileChange, write

link = os.link
def dies(own, lock):
    if sys.argv[3] == "locked":
        link(own, lock)
    os._exit(9)
os.link = dies
repo = Repository.open(Path(sys.argv[1]))
write(repo, [FileChange(path=sys.argv[2], data=b"fx: 2.0\\n", base=blob_id(b"fx: 1.0\\n"))], "killed\\n")
"""


@pytest.mark.parametrize("when", ["before the lock", "locked"])
def test_files_that_a_killed_writer_wrote_and_did_not_enter_are_no_edits(
    checked_out: Repository, when: str
) -> None:
    command = [sys.executable, "-c", KILLED_WITH_FILES, str(checked_out.path), ENTRY, when]
    assert subprocess.run(command, check=False).returncode == 9
    assert (checked_out.path / ENTRY).read_bytes() == b"fx: 2.0\n"
    assert git(checked_out.path, "diff", "--cached", "--name-only") == ENTRY
    assert (checked_out.git_dir / "index.lock").exists() == (when == "locked")
    put(checked_out, {OTHER: b"next\n"})
    assert now(checked_out) == b"fx: 2.0\n"
    assert git(checked_out.path, "status", "--porcelain") == ""
    assert not [*checked_out.git_dir.glob("calibrary-index*")]


def test_files_follow_a_commit_that_the_git_of_a_killed_writer_makes_while_the_next_one_writes(
    checked_out: Repository, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = checked_out.tip()
    put(checked_out, {ENTRY: b"fx: 3.0\n"})
    orphan = checked_out.tip()
    git(checked_out.path, "reset", "--quiet", "--hard", str(before))
    land = writing.land

    def late(*arguments: Any) -> Any:
        monkeypatch.undo()
        git(checked_out.path, "update-ref", "refs/heads/main", str(orphan))
        return land(*arguments)

    monkeypatch.setattr(writing, "land", late)
    put(checked_out, {OTHER: b"next\n"})
    assert (checked_out.path / ENTRY).read_bytes() == b"fx: 3.0\n"
    assert (checked_out.path / OTHER).read_bytes() == b"next\n"
    assert git(checked_out.path, "status", "--porcelain") == ""
