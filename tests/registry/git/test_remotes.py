"""Copies of a registry: brought together entry by entry, and none of them runs anything here."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrary.errors import ConflictError, RegistryError
from calibrary.registry.git import remotes
from calibrary.registry.git.errors import FileConflictError
from calibrary.registry.git.program import Output
from calibrary.registry.git.remotes import clone, fetch, pull, push, review_address, set_remote
from calibrary.registry.git.repository import Repository, create
from tests.registry.git.repositories import ENTRY, OTHER, bare, checked_out, git, made, nobodys_git, now, put

__all__ = ["bare", "checked_out", "made", "nobodys_git"]

THIRD = "cameras/sony/ilce-7/6000x4000.yaml"


@pytest.fixture
def pair(bare: Repository, tmp_path: Path) -> tuple[Repository, Repository]:
    """Two checked-out clones of one bare registry."""
    one, two = (clone(str(bare.path), tmp_path / name, durable=False) for name in ("one", "two"))
    return one, two


def test_a_clone_holds_the_same_and_is_clean(bare: Repository, pair: tuple[Repository, Repository]) -> None:
    one, _ = pair
    assert one.tip() == bare.tip()
    assert (one.path / ENTRY).read_bytes() == b"fx: 1.0\n"
    assert git(one.path, "status", "--porcelain") == ""
    assert git(one.path, "remote", "-v").splitlines()[0] == f"origin\t{bare.path} (fetch)"


def test_a_clone_follows_the_branch_that_the_remote_stands_for(tmp_path: Path) -> None:
    repo = create(tmp_path / "trunked", bare=True, branch="trunk", durable=False)
    put(repo, {ENTRY: b"x\n"})
    assert clone(repo.path.as_uri(), tmp_path / "copy", bare=True).head_ref == "refs/heads/trunk"


def test_a_failed_clone_leaves_nothing_behind(tmp_path: Path) -> None:
    with pytest.raises(RegistryError):
        clone(str(tmp_path / "nowhere"), tmp_path / "copy")
    assert not (tmp_path / "copy").exists()
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "x").touch()
    with pytest.raises(RegistryError, match="new or empty folder"):
        clone(str(tmp_path / "nowhere"), tmp_path / "full")
    assert (tmp_path / "full" / "x").exists()


def test_a_clone_of_an_empty_registry_is_an_empty_registry(tmp_path: Path) -> None:
    origin = create(tmp_path / "origin", bare=True, durable=False)
    copy = clone(str(origin.path), tmp_path / "copy", durable=False)
    assert copy.tip() is None
    put(copy, {ENTRY: b"x\n"})
    push(copy)
    assert now(origin) == b"x\n"


def test_a_pull_goes_forward_and_the_files_with_it(pair: tuple[Repository, Repository]) -> None:
    one, two = pair
    put(one, {ENTRY: b"fx: 2.0\n"})
    push(one)
    pulled = pull(two)
    assert (pulled.replayed, pulled.commit) == (0, one.tip())
    assert (two.path / ENTRY).read_bytes() == b"fx: 2.0\n"
    assert git(two.path, "status", "--porcelain") == ""
    assert pull(two).commit == pulled.commit


def test_what_both_sides_did_to_different_entries_is_brought_together(
    pair: tuple[Repository, Repository],
) -> None:
    one, two = pair
    put(one, {ENTRY: b"fx: 2.0\n"}, subject="theirs")
    push(one)
    put(two, {OTHER: b"a\n"}, subject="ours 1")
    put(two, {OTHER: b"b\n", THIRD: b"c\n"}, subject="ours 2")
    pulled = pull(two)
    assert pulled.replayed == 2
    assert git(two.path, "log", "--format=%s %an", "--reverse", "-3").splitlines() == [
        "theirs Ada Keeper",
        "ours 1 Ada Keeper",
        "ours 2 Ada Keeper",
    ]
    assert [now(two, path) for path in (ENTRY, OTHER, THIRD)] == [b"fx: 2.0\n", b"b\n", b"c\n"]
    assert git(two.path, "status", "--porcelain") == ""
    assert git(two.path, "for-each-ref", "--format=%(refname)", "refs/calibrary/build") == ""
    assert push(two) == two.tip()
    assert pull(one).commit == two.tip()


def test_an_entry_that_both_sides_changed_is_a_conflict_and_nothing_moves(
    pair: tuple[Repository, Repository],
) -> None:
    one, two = pair
    put(one, {ENTRY: b"k: theirs\nd: same\n"})
    push(one)
    put(two, {ENTRY: b"k: same\nd: ours\n", OTHER: b"x\n"})
    before = two.tip()
    with pytest.raises(FileConflictError) as caught:
        pull(two)
    (conflict,) = caught.value.conflicts
    assert conflict.path == ENTRY
    assert conflict.base == b"fx: 1.0\n"
    assert (conflict.ours, conflict.theirs) == (b"k: same\nd: ours\n", b"k: theirs\nd: same\n")
    assert two.tip() == before
    assert (two.path / ENTRY).read_bytes() == b"k: same\nd: ours\n"


def test_the_same_change_on_both_sides_is_no_conflict(pair: tuple[Repository, Repository]) -> None:
    one, two = pair
    put(one, {ENTRY: b"fx: 2.0\n"})
    push(one)
    put(two, {ENTRY: b"fx: 1.5\n"})
    put(two, {ENTRY: b"fx: 2.0\n"})
    assert pull(two).replayed == 0
    assert two.tip() == one.tip()


def test_a_pull_does_not_overwrite_a_persons_edit(pair: tuple[Repository, Repository]) -> None:
    one, two = pair
    put(one, {ENTRY: b"fx: 2.0\n"})
    push(one)
    (two.path / ENTRY).write_bytes(b"by hand\n")
    before = two.tip()
    with pytest.raises(RegistryError, match="edited and not committed"):
        pull(two)
    assert (two.tip(), (two.path / ENTRY).read_bytes()) == (before, b"by hand\n")


def test_a_failure_of_the_network_is_tried_three_times_more_and_no_other_is(
    pair: tuple[Repository, Repository], monkeypatch: pytest.MonkeyPatch
) -> None:
    said: list[str] = []

    def answer(_: Repository, *arguments: str) -> Output:
        said.append(arguments[0])
        return answers.pop(0)

    monkeypatch.setattr(remotes, "_over_network", answer)
    monkeypatch.setattr("time.sleep", lambda _: None)
    away, gone, done = (
        Output(128, b"", "fatal: Could not resolve host: example.com"),
        Output(128, b"", "fatal: no such repository"),
        Output(0, b"", ""),
    )
    answers = [away, away, away, done]
    fetch(pair[0])
    assert answers == []
    answers = [away, away, away, away, done]
    with pytest.raises(RegistryError, match="resolve host"):
        fetch(pair[0])
    assert answers == [done]
    answers = [gone, done]
    with pytest.raises(RegistryError, match="no such repository"):
        fetch(pair[0])
    assert answers == [done]
    assert {*said} == {"fetch"}


def test_our_merges_are_left_to_git(pair: tuple[Repository, Repository]) -> None:
    one, two = pair
    put(one, {ENTRY: b"fx: 2.0\n"})
    push(one)
    put(two, {OTHER: b"x\n"}, branch="side")
    put(two, {THIRD: b"x\n"})
    git(two.path, "merge", "-q", "--no-ff", "-m", "merge", "side")
    with pytest.raises(RegistryError, match="is a merge"):
        pull(two)


def test_two_registries_without_a_common_commit_are_not_mixed(bare: Repository, tmp_path: Path) -> None:
    other = create(tmp_path / "other", bare=True, durable=False)
    put(other, {OTHER: b"x\n"})
    set_remote(other, "origin", str(bare.path))
    with pytest.raises(RegistryError, match="different registries"):
        pull(Repository.open(other.path))


def test_a_push_never_drops_what_others_pushed(bare: Repository, pair: tuple[Repository, Repository]) -> None:
    one, two = pair
    put(one, {ENTRY: b"fx: 2.0\n"})
    theirs = push(one)
    put(two, {OTHER: b"x\n"})
    with pytest.raises(ConflictError, match="has moved on; nothing was sent"):
        push(two)
    fetch(two)
    with pytest.raises(ConflictError, match="nothing was sent"):
        push(two)
    assert bare.tip() == theirs
    pull(two)
    assert push(two) == bare.tip()
    assert git(bare.path, "merge-base", "--is-ancestor", theirs, "main") == ""


def test_a_remote_that_was_rewritten_is_not_taken_for_the_one_we_saw(
    bare: Repository, pair: tuple[Repository, Repository]
) -> None:
    one, _ = pair
    put(one, {ENTRY: b"fx: 2.0\n"})
    push(one)
    git(bare.path, "update-ref", "refs/heads/main", "main~1")
    put(one, {ENTRY: b"fx: 3.0\n"})
    with pytest.raises(ConflictError):
        push(one)


def test_a_push_to_a_branch_that_is_checked_out_there_is_told_in_words(
    checked_out: Repository, tmp_path: Path
) -> None:
    copy = clone(str(checked_out.path), tmp_path / "copy", durable=False)
    put(copy, {ENTRY: b"fx: 2.0\n"})
    with pytest.raises(RegistryError, match="checked out there"):
        push(copy)
    assert now(checked_out) == b"fx: 1.0\n"


def test_a_shallow_clone_reads_writes_and_knows_that_it_is_one(bare: Repository, tmp_path: Path) -> None:
    first = bare.tip()
    assert first is not None
    put(bare, {ENTRY: b"fx: 2.0\n"})
    copy = clone(bare.path.as_uri(), tmp_path / "shallow", depth=1, durable=False)
    assert copy.is_shallow
    assert now(copy) == b"fx: 2.0\n"
    with pytest.raises(RegistryError, match="unshallow"):
        copy.commit_of(first)
    put(copy, {OTHER: b"x\n"})
    push(copy)
    assert now(bare, OTHER) == b"x\n"


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        (
            "git@github.com:ada/fleet.git",
            "https://github.com/ada/fleet/compare/main...proposal/ada-1?expand=1",
        ),
        (
            "https://ada:PW@github.com/ada/fleet",
            "https://github.com/ada/fleet/compare/main...proposal/ada-1?expand=1",
        ),
        (
            "ssh://git@gitlab.example.com:2222/geo/fleet.git",
            "https://gitlab.example.com/geo/fleet/-/merge_requests/new"
            "?merge_request%5Bsource_branch%5D=proposal%2Fada-1",
        ),
        (
            "https://codeberg.org/ada/fleet.git",
            "https://codeberg.org/ada/fleet/compare/main...proposal/ada-1",
        ),
        ("git@git.example.com:fleet.git", None),
        (
            "git@github.com-work:ada/fleet",
            "https://github.com/ada/fleet/compare/main...proposal/ada-1?expand=1",
        ),
        ("http://gitea.local:3000/a/b.git", "http://gitea.local:3000/a/b/compare/main...proposal/ada-1"),
        ("../gitlab/x:y", None),
        ("/srv/fleet.git", None),
        ("file:///srv/github.com/fleet.git", None),
    ],
)
def test_a_branch_is_opened_at_the_page_of_its_host(url: str, expected: str | None) -> None:
    assert review_address(url, "main", "proposal/ada-1") == expected
