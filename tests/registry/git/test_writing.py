"""A write is whole or not at all, overwrites nobody, and says what it did."""

from __future__ import annotations

from datetime import UTC, datetime

import pytest

from calibrary.errors import ConflictError, RegistryError
from calibrary.registry.git import writing
from calibrary.registry.git.errors import FileConflictError
from calibrary.registry.git.objects import LARGEST_FILE, blob_id
from calibrary.registry.git.program import check_branch, check_url
from calibrary.registry.git.repository import Repository, create
from calibrary.registry.git.writing import File, FileChange, Person, Step, land, stream, write
from calibrary.registry.paths import check_path
from tests.registry.git.repositories import ENTRY, OTHER, bare, checked_out, git, made, nobodys_git, now, put

__all__ = ["bare", "checked_out", "made", "nobodys_git"]

ADA = Person(name="Ada", email="ada@example.com")


def test_a_change_made_from_old_content_is_a_conflict_with_all_three_versions(bare: Repository) -> None:
    base = blob_id(b"fx: 1.0\n")
    put(bare, {ENTRY: b"fx: 2.0\n"})
    before = bare.tip()
    with pytest.raises(FileConflictError, match="changed by another writer; nothing was written") as caught:
        write(bare, [FileChange(path=ENTRY, data=b"fx: 3.0\n", base=base)], "too late\n")
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
        write(bare, [FileChange(path=ENTRY, data=data, base=base)], "x\n")


def test_a_change_of_what_was_removed_is_a_conflict(bare: Repository) -> None:
    put(bare, {ENTRY: None})
    with pytest.raises(FileConflictError, match="was removed by another writer"):
        write(bare, [FileChange(path=ENTRY, data=b"new\n", base=blob_id(b"fx: 1.0\n"))], "x\n")


def test_one_conflict_among_many_changes_writes_none_of_them(bare: Repository) -> None:
    before = bare.tip()
    with pytest.raises(FileConflictError):
        write(bare, [FileChange(path=OTHER, data=b"x\n"), FileChange(path=ENTRY, data=b"x\n")], "x\n")
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
    moves = [FileChange(path=ENTRY, data=None, base=base), FileChange(path=OTHER, data=b"fx: 1.0\n")]
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
        write(bare, [FileChange(path=path, data=b"x\n")], "x\n")
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


def test_an_address_has_two_thousand_letters_at_most() -> None:
    longest = "https://example.com/".ljust(2000, "a")
    assert check_url(longest) == longest
    with pytest.raises(RegistryError, match="too long"):
        check_url(f"{longest}a")


def test_a_name_has_a_hundred_and_twenty_letters_at_most() -> None:
    assert check_path(f"cameras/{'a' * 115}.yaml") == f"cameras/{'a' * 115}.yaml"
    with pytest.raises(RegistryError):
        check_path(f"cameras/{'a' * 116}.yaml")
    assert check_branch("a" * 120) == "a" * 120
    with pytest.raises(RegistryError):
        check_branch("a" * 121)


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
        write(bare, [FileChange(path=OTHER, data=b"1"), FileChange(path=OTHER, data=b"2")], "x\n")


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
    change = FileChange(path=OTHER, data=b"y\n", base=blob_id(b"x\n"))
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
