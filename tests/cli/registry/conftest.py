"""What the registry's commands are tried on: a git that nobody has set up, and a registry that was just begun."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

import pytest

from calibrary.registry.init import init
from tests.registry.git.repositories import nobodys_git, packed, seclude

__all__ = ["nobodys_git"]

Filled: TypeAlias = Callable[[Path, Callable[[Path], object]], Path]
"""Does to a registry what a function does, the first time by calling it."""


@pytest.fixture(scope="session")
def begun(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A registry to copy, which is quicker than making one."""
    folder = tmp_path_factory.mktemp("begun")
    with pytest.MonkeyPatch.context() as patch:
        seclude(patch, folder)
        init(folder / "fleet")
    return packed(folder / "fleet")


@pytest.fixture
def fleet(begun: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A registry without an entry, which every command takes for the one that is meant."""
    folder = shutil.copytree(begun, tmp_path / "fleet")
    monkeypatch.setenv("CALIBRARY_REGISTRY", str(folder))
    return folder


@pytest.fixture(scope="session")
def filled(tmp_path_factory: pytest.TempPathFactory) -> Filled:
    """A registry that was filled in the same way before is copied."""
    made: dict[Callable[[Path], object], Path] = {}

    def fill(fleet: Path, how: Callable[[Path], object]) -> Path:
        if how in made:
            shutil.rmtree(fleet)
            return Path(shutil.copytree(made[how], fleet))
        how(fleet)
        made[how] = Path(shutil.copytree(packed(fleet), tmp_path_factory.mktemp("filled") / "fleet"))
        return fleet

    return fill
