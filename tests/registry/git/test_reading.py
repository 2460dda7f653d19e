"""What is read from a registry is what was written, at any revision, by anybody, or an error."""

from __future__ import annotations

import os
import signal
import threading
import time
from datetime import UTC, datetime
from pathlib import Path

import pytest

from calibrary.errors import RegistryError
from calibrary.registry.git.errors import TooLargeError
from calibrary.registry.git.history import (
    OnDate,
    commit_at,
    newest_where,
    parse_rev,
)
from calibrary.registry.git.objects import LARGEST_FILE, blob_id
from calibrary.registry.git.repository import AT_ONCE, Repository, create
from tests.registry.git.repositories import ENTRY, OTHER, bare, checked_out, git, made, nobodys_git, now, put

__all__ = ["bare", "checked_out", "made", "nobodys_git"]


def test_an_entry_is_read_as_it_was_at_any_commit(bare: Repository) -> None:
    first = bare.tip()
    put(bare, {ENTRY: b"fx: 2.0\n"})
    second = bare.tip()
    assert first is not None
    assert second is not None
    old, new = bare.read(first, ENTRY), bare.read(second, ENTRY)
    assert (old and old.data, new and new.data) == (b"fx: 1.0\n", b"fx: 2.0\n")
    assert new is not None
    assert new.oid == blob_id(b"fx: 2.0\n") == git(bare.path, "rev-parse", f"main:{ENTRY}")


def test_a_file_that_is_not_there_is_none_and_a_commit_an_error(bare: Repository) -> None:
    tip = bare.tip()
    assert tip is not None
    assert bare.read(tip, OTHER) is None
    assert bare.read(tip, "cameras/dji") is None
    with pytest.raises(RegistryError, match="has no commit 1111"):
        bare.read("1" * 40, ENTRY)


def test_a_damaged_object_is_an_error_and_not_another_k(bare: Repository) -> None:
    oid = blob_id(b"fx: 8.0\n")
    other = blob_id(b"fx: 9.0\n")
    put(bare, {ENTRY: b"fx: 8.0\n", OTHER: b"fx: 9.0\n"})
    tip = bare.tip()
    assert tip is not None
    objects = bare.common_dir / "objects"
    place = objects / oid[:2] / oid[2:]
    place.chmod(0o644)
    place.write_bytes((objects / other[:2] / other[2:]).read_bytes())
    bare.close()
    with pytest.raises(RegistryError):
        bare.read(tip, ENTRY)
    with pytest.raises(RegistryError):
        list(bare.objects([oid]))


def test_many_contents_come_in_the_order_they_were_asked_for(bare: Repository) -> None:
    files: dict[str, bytes | None] = {f"cameras/m/m{i}/a.yaml": b"n: %d\n" % i for i in range(50)}
    put(bare, files)
    tip = bare.tip()
    assert tip is not None
    paths = bare.listing(tip, "cameras")
    assert set(paths) == {ENTRY, *files}
    asked = sorted(files, reverse=True)
    assert list(bare.objects([paths[path] for path in asked])) == [files[path] for path in asked]
    with pytest.raises(RegistryError, match="fsck --full"):
        list(bare.objects(["1" * 40]))


def test_a_file_that_is_much_too_large_is_refused_among_many_and_the_others_are_read(
    bare: Repository,
) -> None:
    small = [blob_id(b"n: %d\n" % i) for i in range(2 * AT_ONCE)]
    put(bare, {f"cameras/m/m{i}/a.yaml": b"n: %d\n" % i for i in range(2 * AT_ONCE)})
    written = bare.run("hash-object", "-w", "--stdin", stdin=b"x" * (LARGEST_FILE + 1)).out
    asked = [*small, written.decode().strip()]
    with pytest.raises(TooLargeError, match="expected at most"):
        list(bare.objects(asked))
    assert list(bare.readable(asked))[-2:] == [b"n: %d\n" % (2 * AT_ONCE - 1), b""]


def test_a_link_in_a_tree_is_no_entry(checked_out: Repository) -> None:
    (checked_out.path / "cameras" / "dji" / "link.yaml").symlink_to("/etc/passwd")
    git(checked_out.path, "add", "-A")
    git(checked_out.path, "commit", "-m", "a link")
    tip = checked_out.tip()
    assert tip is not None
    assert set(checked_out.listing(tip, "cameras")) == {ENTRY}


def test_threads_that_share_a_store_read_the_right_bytes(bare: Repository) -> None:
    files: dict[str, bytes | None] = {f"cameras/m/m{i}/a.yaml": b"n: %d\n" % i for i in range(20)}
    put(bare, files)
    tip = bare.tip()
    assert tip is not None
    wrong: list[object] = []

    def read_all() -> None:
        for path, data in [*files.items()] * 3:
            blob = bare.read(tip, path)
            if blob is None or blob.data != data:
                wrong.append((path, blob))
        bare.close()

    threads = [threading.Thread(target=read_all) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == []


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")  # of other libraries' threads, since 3.12
def test_both_sides_of_a_fork_read_the_right_bytes(bare: Repository) -> None:
    files: dict[str, bytes | None] = {f"cameras/m/m{i}/a.yaml": b"n: %d\n" % i for i in range(20)}
    put(bare, files)
    tip = bare.tip()
    assert tip is not None

    def all_right() -> bool:
        return all(
            (blob := bare.read(tip, path)) is not None and blob.data == data for path, data in files.items()
        )

    def cancel_update(*_: object) -> None:
        raise TimeoutError

    assert all_right()
    # Whoever shares a reader waits for an answer that another has taken.
    signal.signal(signal.SIGALRM, cancel_update)
    signal.alarm(30)
    children = []
    for _ in range(3):
        pid = os.fork()
        if pid == 0:
            code = 1
            try:
                signal.alarm(20)
                code = 0 if all_right() else 2
            finally:
                os._exit(code)
        children.append(pid)
    assert all_right()
    assert [os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) for pid in children] == [0, 0, 0]
    signal.alarm(0)
    assert all_right()


def test_a_reader_that_was_killed_is_started_again(bare: Repository) -> None:
    assert now(bare) == b"fx: 1.0\n"
    process = bare._own.reader._process
    process.kill()
    while process.poll() is None:
        time.sleep(0.001)
    assert now(bare) == b"fx: 1.0\n"


def test_what_others_commit_is_seen_at_once(bare: Repository) -> None:
    assert now(bare) == b"fx: 1.0\n"
    put(Repository.open(bare.path), {ENTRY: b"fx: 2.0\n"})
    assert now(bare) == b"fx: 2.0\n"
    git(bare.path, "gc", "--quiet", "--prune=now")
    git(bare.path, "pack-refs", "--all")
    assert now(bare) == b"fx: 2.0\n"


@pytest.mark.parametrize(
    "hostile", ["--output=/nowhere/x", "-1", "main\n--all", "", "main..", "a b", "\x00", ":/fx", "x" * 300]
)
def test_a_hostile_revision_is_refused_and_writes_nothing(bare: Repository, hostile: str) -> None:
    with pytest.raises(RegistryError, match=r"not a revision|no such revision"):
        commit_at(bare, parse_rev(hostile))
    with pytest.raises(RegistryError):
        bare.commit_of(hostile)


def test_revisions_are_commits_tags_and_branches(bare: Repository) -> None:
    first = bare.tip()
    assert first is not None
    git(bare.path, "tag", "-a", "v1", "-m", "first", first)
    git(bare.path, "branch", "old", first)
    put(bare, {ENTRY: b"fx: 2.0\n"})
    for rev in ("v1", "old", "main~1", first, first[:10], "HEAD^", "refs/tags/v1"):
        assert commit_at(bare, parse_rev(rev)) == first
    assert bare.newest() == bare.tip()


def test_a_date_means_the_end_of_that_day_in_utc(bare: Repository) -> None:
    for day, fx in ((10, b"2"), (11, b"3")):
        put(bare, {ENTRY: b"fx: %s\n" % fx}, now=datetime(2031, 5, day, 12, tzinfo=UTC))

    def at(text: str) -> bytes | None:
        blob = bare.read(commit_at(bare, parse_rev(text)), ENTRY)
        return blob.data if blob is not None else None

    assert at("2031-05-10") == b"fx: 2\n"
    assert at("2031-05-10T11:59Z") == b"fx: 1.0\n"
    assert at("2031-05-11T14:00+02:00") == b"fx: 3\n"
    assert at("2031-05-12") == b"fx: 3\n"
    with pytest.raises(RegistryError, match="begins later"):
        at("2001-01-01")
    with pytest.raises(RegistryError, match="not a date"):
        at("2031-02-30")


def test_a_date_does_not_find_a_side_branch_that_was_merged_later(
    checked_out: Repository, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, folder = checked_out.path / ENTRY, checked_out.path
    before = checked_out.tip()
    git(folder, "switch", "-q", "-c", "side")
    path.write_bytes(b"fx: 7.0\n")
    monkeypatch.setenv("GIT_COMMITTER_DATE", "2031-01-01T00:00Z")
    git(folder, "commit", "-aqm", "side")
    git(folder, "switch", "-q", "main")
    monkeypatch.setenv("GIT_COMMITTER_DATE", "2035-01-01T00:00Z")
    git(folder, "merge", "-q", "--no-ff", "side", "-m", "merge it")
    assert commit_at(checked_out, OnDate(datetime(2034, 1, 1, tzinfo=UTC))) == before


def test_the_newest_revision_made_for_a_firmware_is_found(bare: Repository) -> None:
    for number in (1, 2, 3):
        put(bare, {ENTRY: b"firmware: 01.0%d\nfx: 5\n" % number})
    put(bare, {ENTRY: b"firmware: 01.02\nfx: 6\n"})
    tip = bare.tip()
    assert tip is not None
    found = newest_where(bare, ENTRY, tip, lambda data: b"01.02" in data)
    assert found is not None
    assert found[1].data == b"firmware: 01.02\nfx: 6\n"
    assert newest_where(bare, ENTRY, tip, lambda data: b"09.09" in data) is None


@pytest.mark.parametrize("is_bare", [True, False])
def test_an_empty_registry_has_no_tip_and_says_so(tmp_path: Path, is_bare: bool) -> None:
    repo = create(tmp_path / "empty", bare=is_bare)
    assert repo.tip() is None
    with pytest.raises(RegistryError, match="empty registry"):
        repo.newest()


def test_a_folder_that_is_no_repository_is_told_so(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "missing"):
        with pytest.raises(RegistryError, match="expected a registry"):
            Repository.open(path)


def test_a_folder_inside_a_repository_is_not_that_repository(checked_out: Repository) -> None:
    with pytest.raises(RegistryError, match="not a git repository"):
        Repository.open(checked_out.path / "cameras")


def test_a_repository_of_sha256_is_refused_in_words(tmp_path: Path) -> None:
    git(tmp_path, "init", "-q", "--object-format=sha256", "other")
    with pytest.raises(RegistryError, match="sha256 object names"):
        Repository.open(tmp_path / "other")


def test_a_repository_of_reftables_is_refused_in_words(bare: Repository) -> None:
    git(bare.path, "config", "core.repositoryformatversion", "1")
    with (bare.path / "config").open("a") as file:
        file.write("[extensions]\n\trefstorage = reftable\n")
    with pytest.raises(RegistryError, match=r"(?i)refstorage|reftable"):
        Repository.open(bare.path)


def test_a_git_that_is_too_old_is_refused_in_words(bare: Repository, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("calibrary.registry.git.program._version", lambda _: (2, 20))
    with pytest.raises(RegistryError, match=r"found git 2\.20, expected 2\.24 or newer"):
        Repository.open(bare.path)


def test_the_variables_of_a_hook_around_us_do_not_lead_elsewhere(
    bare: Repository, checked_out: Repository, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(bare, {ENTRY: b"fx: 2.0\n"})
    monkeypatch.setenv("GIT_DIR", str(checked_out.git_dir))
    monkeypatch.setenv("GIT_INDEX_FILE", str(checked_out.git_dir / "nowhere"))
    monkeypatch.setenv("GIT_OBJECT_DIRECTORY", str(checked_out.git_dir / "objects"))
    monkeypatch.setenv("GIT_WORK_TREE", "/nowhere")
    repo = Repository.open(bare.path)
    assert now(repo) == b"fx: 2.0\n"
    put(repo, {ENTRY: b"fx: 3.0\n"})
    assert now(checked_out) == b"fx: 1.0\n"
    assert now(bare) == b"fx: 3.0\n"


def test_a_locale_without_utf8_changes_nothing(bare: Repository, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LC_ALL", "C")
    monkeypatch.setenv("GIT_COMMITTER_NAME", "Ådå Kéeper")
    data = 'name: "Ölüdeniz — 相机"\n'.encode()
    put(bare, {ENTRY: data}, subject="Größe geändert")
    assert now(bare) == data
    assert git(bare.path, "log", "-1", "--encoding=UTF-8", "--format=%cn %s") == "Ådå Kéeper Größe geändert"
