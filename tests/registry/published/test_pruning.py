"""The cache of published registries stays bounded, and keeps what the last roots lead to."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import pytest

from calibrary.calibration import CameraKey
from calibrary.records import replace
from calibrary.registry.published import cache as published_cache
from calibrary.registry.published.cache import Cache, prune
from calibrary.registry.published.layout import sha256
from calibrary.registry.published.read import Published
from tests.registry.entries import an_entry
from tests.registry.published.publications import commit, dated, nobodys_git, published
from tests.registry.published.server import Server, serving

__all__ = ["nobodys_git"]

MODELS = [f"M {number}" for number in range(300)]
ASKED = (*MODELS[::50], "DATED")
DAY = 86_400


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A registry with a tree, and its publication."""
    folder = tmp_path_factory.mktemp("made")
    commit(folder / "fleet", *(an_entry(model=model) for model in MODELS))
    dated(folder / "fleet")
    published(folder / "fleet", folder / "out")
    return folder


@pytest.fixture
def server(made: Path) -> Iterator[Server]:
    with serving(made / "out") as server:
        yield server


@pytest.fixture
def cache(tmp_path: Path) -> Cache:
    return Cache(tmp_path / "cache")


def ask(server: Server, cache: Cache) -> list[str]:
    """Resolve some cameras; what the server was asked for."""
    server.asked.clear()
    registry = Published(server.url, cache=cache)
    for model in ASKED:
        key = CameraKey(make="DJI", model=model)
        assert registry.index_for(key).resolve(key) is not None
    return server.paths


def litter(cache: Cache, count: int, *, age_days: float = 0.0, size: int = 1000) -> list[Path]:
    """Files that no root leads to."""
    found = []
    for number in range(count):
        data = os.urandom(size)
        cache.keep(data, sha256(data))
        file = cache.folder / "files" / sha256(data)[:2] / sha256(data)
        when = time.time() - (age_days + number / 1e3) * DAY
        os.utime(file, (when, when))
        found.append(file)
    return found


def test_what_the_last_root_leads_to_stays_however_old_and_much_it_is(server: Server, cache: Cache) -> None:
    assert len(ask(server, cache)) > len(ASKED)
    for file in cache.folder.rglob("*"):
        os.utime(file, (1e9, 1e9))
    assert prune(cache.folder, limit=0) == 0
    cache.documents.clear()
    assert ask(server, cache) == ["calibrary.json"]


def test_of_the_rest_the_oldest_go_first(cache: Cache) -> None:
    files = litter(cache, 10)
    assert prune(cache.folder, limit=4500) == 6
    assert [file.exists() for file in files] == [True] * 4 + [False] * 6


def test_what_is_old_goes_even_where_there_is_room(server: Server, cache: Cache) -> None:
    ask(server, cache)
    old, new = litter(cache, 3, age_days=31), litter(cache, 3, age_days=29)
    half = cache.folder / "files/ab/.half-written.1234"
    half.parent.mkdir(exist_ok=True)
    half.write_bytes(b"{")
    os.utime(half, (1e9, 1e9))
    assert prune(cache.folder) == 4
    assert not any(file.exists() for file in (*old, half))
    assert all(file.exists() for file in new)


def test_a_root_that_is_not_read_for_a_year_goes_unless_it_is_the_last(server: Server, cache: Cache) -> None:
    ask(server, cache)
    own = cache.root(server.url)
    assert own is not None
    [file] = (cache.folder / "roots").iterdir()
    os.utime(file, (1e9, 1e9))
    prune(cache.folder)
    assert cache.root(server.url) is not None
    other = replace(own, url="https://other.example/", read=own.read + timedelta(days=1))
    cache.keep_root(other)
    os.utime(file, (1e9, 1e9))
    prune(cache.folder)
    assert (cache.root(server.url), cache.root(other.url)) == (None, other)


def test_it_happens_on_writing_once_a_day_and_after_much(
    cache: Cache, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = []
    real = published_cache.prune
    monkeypatch.setattr(published_cache, "prune", lambda folder: done.append(real(folder)))
    monkeypatch.setenv("CALIBRARY_CACHE_MIB", "1")
    litter(cache, 20)
    assert len(done) == 1
    assert cache.written == 19_000
    litter(cache, 1, size=(1 << 20) // 16)
    assert (len(done), cache.written) == (2, 0)
    litter(Cache(cache.folder), 1)
    assert len(done) == 2
    os.utime(cache.folder / "pruned", (1e9, 1e9))
    litter(Cache(cache.folder), 1)
    assert len(done) == 3


def test_the_bound_is_stated_in_the_environment(cache: Cache, monkeypatch: pytest.MonkeyPatch) -> None:
    litter(cache, 3, size=1 << 19)
    monkeypatch.setenv("CALIBRARY_CACHE_MIB", "1")
    assert prune(cache.folder) == 1
    monkeypatch.setenv("CALIBRARY_CACHE_MIB", "much")
    assert prune(cache.folder) == 0
