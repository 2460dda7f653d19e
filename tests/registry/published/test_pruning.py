"""The cache of published registries stays bounded, and keeps what is used."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from calibrary.registry.published import cache as published_cache
from calibrary.registry.published.cache import Cache, prune
from calibrary.registry.published.manifest import sha256

DAY = 86_400


@pytest.fixture
def cache(tmp_path: Path) -> Cache:
    return Cache(tmp_path / "cache")


def litter(cache: Cache, count: int, *, age_days: float = 0.0, size: int = 1000) -> list[Path]:
    """Files that were last used some days ago."""
    found = []
    for number in range(count):
        data = os.urandom(size)
        cache.keep(data, sha256(data))
        file = cache.folder / "files" / sha256(data)[:2] / sha256(data)
        when = time.time() - (age_days + number / 1e3) * DAY
        os.utime(file, (when, when))
        found.append(file)
    return found


def test_what_was_not_used_for_the_longest_goes_first(cache: Cache) -> None:
    files = litter(cache, 10)
    assert prune(cache.folder, limit=4500) == 6
    assert [file.exists() for file in files] == [True] * 4 + [False] * 6


def test_what_is_used_stays(cache: Cache) -> None:
    used, other = litter(cache, 2, age_days=40)
    assert cache.get(used.name) is not None
    assert prune(cache.folder, limit=1500) == 1
    assert (used.exists(), other.exists()) == (True, False)


def test_what_is_old_goes_even_where_there_is_room(cache: Cache) -> None:
    old, new = litter(cache, 3, age_days=366), litter(cache, 3, age_days=364)
    half = cache.folder / "files/ab/.half-written.1234"
    half.parent.mkdir(exist_ok=True)
    half.write_bytes(b"{")
    os.utime(half, (1e9, 1e9))
    assert prune(cache.folder) == 4
    assert not any(file.exists() for file in (*old, half))
    assert all(file.exists() for file in new)


def test_it_happens_at_the_first_writing_of_a_process_and_after_much(
    cache: Cache, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = []
    real = published_cache.prune
    monkeypatch.setattr(published_cache, "prune", lambda folder: done.append(real(folder)))
    monkeypatch.setenv("CALIBRARY_CACHE_MIB", "1")
    litter(cache, 20)
    assert (len(done), cache.written) == (1, 19_000)
    litter(cache, 1, size=(1 << 20) // 16)
    assert (len(done), cache.written) == (2, 0)
    litter(Cache(cache.folder), 1)
    assert len(done) == 3


def test_the_bound_is_stated_in_the_environment(cache: Cache, monkeypatch: pytest.MonkeyPatch) -> None:
    litter(cache, 3, size=1 << 19)
    monkeypatch.setenv("CALIBRARY_CACHE_MIB", "1")
    assert prune(cache.folder) == 1
    monkeypatch.setenv("CALIBRARY_CACHE_MIB", "much")
    assert prune(cache.folder) == 0
