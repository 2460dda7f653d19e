"""A registry with a past, and its site, made once for all tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrary.jobs.site.building import Site, build
from tests.jobs.site.fleet import fleet
from tests.registry.git.repositories import nobodys_git, packed, seclude

__all__ = ["nobodys_git"]


@pytest.fixture(scope="session")
def registry(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The registry; no test writes to it."""
    folder = tmp_path_factory.mktemp("registry")
    with pytest.MonkeyPatch.context() as patch:
        seclude(patch, folder)
        fleet(folder / "fleet")
    return packed(folder / "fleet")


@pytest.fixture(scope="session")
def site(registry: Path, tmp_path_factory: pytest.TempPathFactory) -> Site:
    """Its site; no test writes to it."""
    folder = tmp_path_factory.mktemp("site")
    with pytest.MonkeyPatch.context() as patch:
        seclude(patch, folder)
        return build(registry, folder / "out", workers=1)
