"""What is kept of a registry between runs answers as git does: after any history, and whatever became of the file."""

from __future__ import annotations

import random
import subprocess
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import msgspec
import pytest
from hypothesis import given, settings

from calibrary.calibration import CameraKey
from calibrary.records import replace
from calibrary.registry import contents
from calibrary.registry.cache import Cache, Memory
from calibrary.registry.checks import check_all
from calibrary.registry.contents import ALIAS, LABEL, Contents, stated_names
from calibrary.registry.entry import Alias, Entry
from calibrary.registry.entry_yaml import entry_yaml, parse_entry
from calibrary.registry.git.repository import Repository
from calibrary.registry.init import init
from calibrary.registry.paths import is_entry, model_folder
from calibrary.registry.registry import Registry, open_snapshot
from calibrary.validation import Finding
from tests.cli.registry.direct import put, put_bytes
from tests.registry.entries import KEY, an_entry, entries
from tests.registry.git.repositories import git, nobodys_git
from tests.thorough import examples

__all__ = ["nobodys_git"]

NAMED = an_entry(aliases=(Alias(make="Other", model="Name"),))


@pytest.fixture
def repo(tmp_path: Path) -> Repository:
    """A registry's repository, with one camera that has another name."""
    repo = Registry.open(init(tmp_path / "fleet").place).repo
    put(repo.path, NAMED, an_entry(model="Plain"))
    return repo


def tip(repo: Repository) -> str:
    found = repo.tip()
    assert found is not None
    return found


def require_what_git_says(repo: Repository, at: Contents, commit: str) -> None:
    """Compare the contents of a commit with a walk over all of its files."""
    files = repo.listing(commit, "cameras")
    assert dict(at.files) == files
    assert [*at.files] == sorted(files)
    entries = {path: oid for path, oid in files.items() if is_entry(path)}
    parsed = [(path, parse_entry(repo.blob(oid), path)) for path, oid in entries.items()]
    expected = sorted(mention for path, entry in parsed for mention in stated_names(path, entry))
    assert sorted(one for kind in (ALIAS, LABEL) for one in at.mentions(kind)) == expected
    read = ((oid, path, repo.blob(oid)) for path, oid in entries.items())
    assert [*at.parsed(read)] == parsed


def random_entry(dice: random.Random) -> Entry:
    aliases = tuple(Alias(make="Other", model=f"Name {n}") for n in range(dice.randrange(3)))
    old = dice.choice([None, None, "dji/m1/5472x3648+f8.8", "dji/m2/5472x3648+f8.8"])
    entry = an_entry(model=f"M{dice.randrange(6)}", aliases=aliases, fx=3600.0 + dice.randrange(100))
    label = dice.choice([None, "P4R-03", "M3E 01"])
    return replace(entry, supersedes=old if old != entry.id else None, label=label)


def step(root: Path, dice: random.Random) -> None:
    """One thing that a person may do with git."""
    there = sorted((root / "cameras").rglob("*.yaml"))
    branches = git(root, "branch", "--format=%(refname:short)").split()
    match dice.choice(["add", "add", "edit", "rename", "delete", "branch", "switch", "merge", "reset"]):
        case "add" | "edit":
            entry = random_entry(dice)
            file = root / entry.path
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(entry_yaml(entry))
        case "rename" if there:
            file = dice.choice(there)
            file.rename(file.with_name(f"{dice.randrange(10)}x10.yaml"))
        case "delete" if there:
            dice.choice(there).unlink()
        case "branch":
            git(root, "branch", f"b{len(branches)}")
        case "switch":
            git(root, "switch", "--quiet", dice.choice(branches))
        case "merge":
            # A conflict of two files is committed as it lies.
            merge = ("merge", "--quiet", "-X", "ours", "--no-edit", dice.choice(branches))
            subprocess.run(["git", "-C", str(root), *merge], capture_output=True, check=False)
        case "reset":
            behind = git(root, "rev-list", "--max-count=4", "HEAD").split()
            git(root, "reset", "--quiet", "--hard", dice.choice(behind))
    git(root, "add", "--all")
    if git(root, "status", "--porcelain") or (root / ".git/MERGE_HEAD").exists():
        git(root, "commit", "--quiet", "--message=step")


@pytest.mark.parametrize("seed", range(examples(4)))
def test_after_any_history_it_says_what_git_says(repo: Repository, tmp_path: Path, seed: int) -> None:
    dice, kept, seen = random.Random(seed), tmp_path / "kept", [tip(repo)]  # noqa: S311  not a secret
    for _ in range(10):
        step(repo.path, dice)
        seen.append(tip(repo))
        # Now and then it is asked for the past, and now and then it has missed some commits.
        if dice.random() < 0.7:
            commit = dice.choice([seen[-1], seen[-1], dice.choice(seen)])
            require_what_git_says(repo, Contents(repo, commit, folder=kept), commit)
    require_what_git_says(repo, Contents(repo, seen[-1], folder=kept), seen[-1])


@pytest.mark.thorough
@settings(max_examples=examples(12))
@given(entry=entries())
def test_an_entry_that_is_kept_is_the_entry(entry: Entry) -> None:
    again = msgspec.msgpack.decode(msgspec.msgpack.encode(entry), type=Entry)
    assert again == entry
    assert entry_yaml(again) == entry_yaml(entry)


def test_only_what_changed_is_read_again(
    repo: Repository, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = tmp_path / "kept"
    assert [*Contents(repo, tip(repo), folder=kept).aliases] == [("other", "name")]
    plain, new = an_entry(model="Plain"), an_entry(model="New")
    put(repo.path, replace(NAMED, aliases=(Alias(make="Third", model="Name"),)), new)
    put_bytes(repo.path, {plain.path: None})
    at, read = Contents(repo, tip(repo), folder=kept), set[str]()
    listed = Repository.files_in

    def noted(own: Repository, some: Sequence[tuple[str, str]]) -> dict[str, str]:
        read.update(path for path, _ in some)
        return listed(own, some)

    monkeypatch.setattr(Repository, "files_in", noted)
    assert [*at.aliases] == [("third", "name")]
    assert read == {f"{model_folder(NAMED.path)}/", f"{model_folder(new.path)}/"}
    # What was read as an entry is not parsed again either.
    files = [(oid, path, repo.blob(oid)) for path, oid in at.files.items()]
    first = [*at.parsed(files)]
    monkeypatch.setattr(contents, "parsed_or_error", None)
    assert [*Contents(repo, tip(repo), folder=kept).parsed(files)] == first


def damaged(file: Path) -> Iterator[bytes]:
    """What may lie in the place of the file."""
    whole = file.read_bytes()
    yield from (
        b"",
        b"[]",
        b"\xff\xfe",
        whole[: len(whole) // 2],
        whole[:100],
        whole + b"more",
        whole + whole,
    )
    path, other = an_entry(model="Plain").path.encode(), an_entry(model="Plane").path.encode()
    assert whole.count(path) > 0
    yield whole.replace(path, other)
    yield whole.replace(b"other\nname", b"order\nname")
    dice = random.Random(1)  # noqa: S311  not a secret
    for _ in range(20):
        at = dice.randrange(len(whole))
        yield whole[:at] + bytes([whole[at] ^ 0xFF]) + whole[at + 1 :]


def test_anything_else_in_its_place_is_thrown_away(repo: Repository, tmp_path: Path) -> None:
    kept = tmp_path / "kept"
    require_what_git_says(repo, Contents(repo, tip(repo), folder=kept), tip(repo))
    [file] = kept.iterdir()
    for left in [*damaged(file)]:
        file.write_bytes(left)
        require_what_git_says(repo, Contents(repo, tip(repo), folder=kept), tip(repo))
        require_what_git_says(repo, Contents(repo, tip(repo), folder=kept), tip(repo))


@pytest.fixture
def cache(tmp_path: Path) -> Cache:
    """A cache with one value."""
    found = Cache(tmp_path / "of one", "1")
    found.keep({"name": 1})
    return found


NUMBER = msgspec.msgpack.Decoder(int)


def test_a_cache_of_another_version_is_none(cache: Cache) -> None:
    assert Cache(cache.file, "1").get(NUMBER, ["name", "other"]) == {"name": 1}
    assert Cache(cache.file, "2").get(NUMBER, ["name"]) == {}


def test_two_that_write_keep_what_both_found(cache: Cache) -> None:
    Cache(cache.file, "1").keep({"other": 2})
    cache.keep({"third": 3})
    every = {"name": 1, "other": 2, "third": 3}
    assert Cache(cache.file, "1").get(NUMBER, every) == every


def test_a_cache_that_cannot_be_written_or_has_grown_too_large_does_no_harm(
    repo: Repository, tmp_path: Path, cache: Cache, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_the_way = tmp_path / "way"
    in_the_way.write_text("no folder")
    require_what_git_says(repo, Contents(repo, tip(repo), folder=in_the_way), tip(repo))
    monkeypatch.setattr("calibrary.registry.cache.LARGEST", 3)
    large = Cache(cache.file, "1")
    assert large.get(NUMBER, ["name"]) == {"name": 1}
    large.keep({"new": 2})
    assert Cache(cache.file, "1").get(NUMBER, ["name", "new"]) == {"new": 2}


def test_what_was_seen_is_of_its_branch_and_registry_until_it_is_given_up(
    repo: Repository, tmp_path: Path
) -> None:
    kept, now = tmp_path / "kept", tip(repo)
    Memory(repo, kept).remember(now, "main", {"one": ["a", "b"], "two": ["c"]})
    Memory(repo, kept).remember(now, "other", {"one": ["d"]})
    [file] = kept.iterdir()
    file.write_bytes(file.read_bytes() + b"half a line")
    Memory(repo, kept).give_up(now, "main", ["b", "c"])
    Memory(repo, kept).remember(now, "main", {"two": ["c"]})
    assert Memory(repo, kept).seen("main") == {"one": {"a"}, "two": {"c"}}
    assert Memory(repo, kept).seen("other") == {"one": {"d"}}
    file.write_bytes(file.read_bytes().replace(now.encode(), b"0" * 40))
    assert Memory(repo, kept).seen("main") == {}
    Memory(repo, kept).remember(now, "main", {"one": ["e"]})
    assert Memory(repo, kept).seen("main") == {"one": {"e"}}


@pytest.mark.thorough
def test_a_check_finds_what_it_finds_without_anything_kept_whatever_became_of_that(repo: Repository) -> None:
    """Two units of one label, in models of which the first is kept and the second is changed or damaged."""
    label = partial(replace, label="P4R-03")
    put(repo.path, label(an_entry(model="One", serial="1")), an_entry(model="Two", serial="2"))

    def found() -> tuple[Finding, ...]:
        return check_all(open_snapshot(repo.path)).findings

    file = Contents(repo, tip(repo)).cache.file
    assert found() == ()
    put(repo.path, label(an_entry(model="Two", serial="2")))
    after = found()
    assert "label" in {one.rule for one in after}
    for left in [*damaged(file)]:
        file.write_bytes(left)
        assert found() == after
    file.unlink()
    assert found() == after


@pytest.mark.parametrize("key", [KEY, replace(KEY, make="Other", model="Name")])
def test_asking_for_one_camera_finds_what_asking_all_finds(repo: Repository, key: CameraKey) -> None:
    put_bytes(repo.path, {"cameras/misplaced/x.yaml": entry_yaml(an_entry(model="odd"))})
    snapshot = open_snapshot(repo.path)
    whole = snapshot.index().resolve(key)
    narrow = snapshot.index_for(key)
    assert whole is not None
    assert narrow.resolve(key) == whole
    assert len(narrow.paths) < len(snapshot.index().paths)
