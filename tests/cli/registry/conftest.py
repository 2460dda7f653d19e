"""What the registry's commands are tried on: a git that nobody has set up, and a registry that was just begun."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from calibrary.registry.init import init
from tests.registry.git.repositories import nobodys_git, seclude

__all__ = ["nobodys_git"]


@pytest.fixture(scope="session")
def begun(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A registry to copy, which is quicker than making one."""
    folder = tmp_path_factory.mktemp("begun")
    with pytest.MonkeyPatch.context() as patch:
        seclude(patch, folder)
        init(folder / "fleet")
    return folder / "fleet"


@pytest.fixture
def fleet(begun: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A registry without an entry, which every command takes for the one that is meant."""
    folder = shutil.copytree(begun, tmp_path / "fleet")
    monkeypatch.setenv("CALIBRARY_REGISTRY", str(folder))
    return folder
