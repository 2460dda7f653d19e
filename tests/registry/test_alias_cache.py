"""What is kept of a registry between runs: other names, brought up to date by what has changed since."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from calibrary.calibration import CameraKey
from calibrary.records import replace
from calibrary.registry import alias_cache
from calibrary.registry.alias_cache import names_at, names_kept
from calibrary.registry.entry import Alias
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.git.repository import Repository
from calibrary.registry.init import init
from calibrary.registry.registry import open_snapshot
from calibrary.registry.resolution import scan_aliases
from tests.cli.registry.direct import put, put_bytes
from tests.registry.entries import KEY, an_entry
from tests.registry.git.repositories import git, nobodys_git

__all__ = ["nobodys_git"]

NAMED = an_entry(aliases=(Alias(make="Other", model="Name"),))


@pytest.fixture
def repo(tmp_path: Path) -> Repository:
    """A registry's repository, with one camera that has another name."""
    repo = init(tmp_path / "fleet").registry.repo
    put(repo.path, NAMED, an_entry(model="Plain"))
    return repo


def tip(repo: Repository) -> str:
    found = repo.tip()
    assert found is not None
    return found


def test_it_knows_what_a_scan_of_everything_finds(repo: Repository, tmp_path: Path) -> None:
    snapshot = open_snapshot(repo.path)
    assert names_at(repo, tip(repo), folder=tmp_path / "kept").alias_map == scan_aliases(snapshot.files())


def test_only_what_changed_is_read_again(
    repo: Repository, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = tmp_path / "kept"
    names_at(repo, tip(repo), folder=kept)
    put(repo.path, replace(NAMED, aliases=(Alias(make="Third", model="Name"),)), an_entry(model="New"))
    put_bytes(repo.path, {an_entry(model="Plain").path: None})

    def refuse(*_: object) -> None:
        raise AssertionError("everything was read again")

    monkeypatch.setattr(alias_cache, "_read_whole", refuse)
    names = names_at(repo, tip(repo), folder=kept)
    assert [*names.alias_map] == [("third", "name")]
    assert names_kept(repo, names.commit, folder=kept) == names


def test_a_look_into_the_past_is_right_too(repo: Repository, tmp_path: Path) -> None:
    before = tip(repo)
    put(repo.path, replace(NAMED, aliases=()))
    assert names_at(repo, tip(repo), folder=tmp_path / "kept").alias_map == {}
    assert [*names_at(repo, before, folder=tmp_path / "kept").alias_map] == [("other", "name")]


@pytest.mark.parametrize(
    "left",
    [
        b"",
        b"[]",
        b'{"version": 1}',
        b'{"version": 99, "commit": "%s"}',
        b'{"version": 1, "commit": "x", "aliases": {}, "irregular": []}',
        b'{"version": 1, "commit": "%s", "aliases": {"a": [[1, 2]]}, "irregular": []}',
        b"[" * 100_000,
        b"\xff\xfe",
    ],
)
def test_anything_else_in_its_place_is_read_over(repo: Repository, tmp_path: Path, left: bytes) -> None:
    kept = tmp_path / "kept"
    names_at(repo, tip(repo), folder=kept)
    [file] = kept.iterdir()
    file.write_bytes(left.replace(b"%s", tip(repo).encode()))
    assert [*names_at(repo, tip(repo), folder=kept).alias_map] == [("other", "name")]
    assert json.loads(file.read_bytes())["commit"] == tip(repo)


def test_a_commit_that_was_rewritten_away_costs_a_whole_look(repo: Repository, tmp_path: Path) -> None:
    kept = tmp_path / "kept"
    names_at(repo, tip(repo), folder=kept)
    [file] = kept.iterdir()
    file.write_bytes(file.read_bytes().replace(tip(repo).encode(), b"0" * 40))
    assert names_kept(repo, tip(repo), folder=kept) is None
    assert [*names_at(repo, tip(repo), folder=kept).alias_map] == [("other", "name")]


def test_a_cache_that_cannot_be_written_does_no_harm(repo: Repository, tmp_path: Path) -> None:
    in_the_way = tmp_path / "kept"
    in_the_way.write_text("no folder")
    assert [*names_at(repo, tip(repo), folder=in_the_way).alias_map] == [("other", "name")]


@pytest.mark.parametrize("key", [KEY, replace(KEY, make="Other", model="Name"), replace(KEY, model="odd")])
def test_asking_for_one_camera_finds_what_asking_all_finds(repo: Repository, key: CameraKey) -> None:
    odd = an_entry(model="odd")
    put_bytes(repo.path, {"cameras/misplaced/x.yaml": entry_yaml(odd)})
    snapshot = open_snapshot(repo.path)
    whole = snapshot.index().resolve(key)
    names_at(repo, tip(repo))
    narrow = snapshot.index_for(key)
    assert whole is not None
    assert narrow.resolve(key) == whole
    assert len(narrow.paths) < len(snapshot.index().paths)


def test_git_alone_can_have_written_it(repo: Repository) -> None:
    entry = an_entry(model="By Git")
    file = repo.path / entry.path
    file.parent.mkdir(parents=True)
    file.write_bytes(entry_yaml(entry))
    git(repo.path, "add", ".")
    git(repo.path, "commit", "--quiet", "-m", "by hand")
    assert names_at(repo, tip(repo)).commit == git(repo.path, "rev-parse", "HEAD")
