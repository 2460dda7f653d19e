"""Commands are tested for what they write, not for how a plot looks; and a desk at which each of them was run."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.cli.desk import COMMANDS, READING, REFUSED, Ran, furnish, printed
from tests.pages.sketches import sketched
from tests.registry.git.repositories import seclude


@pytest.fixture(autouse=True)
def plain() -> Iterator[None]:
    """No plot of a page is drawn in full."""
    with sketched():
        yield


@pytest.fixture(scope="session")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Ran:
    """Every command of the tables, into a pipe and in their order, on the registry that the first one makes."""
    folder = tmp_path_factory.mktemp("desk")
    with pytest.MonkeyPatch.context() as patch:
        sit_down(patch, folder)
        patch.setenv("COLUMNS", "40")
        furnish(folder)
        subprocess.run(["git", "init", "--quiet", "--bare", "hub.git"], check=True, cwd=folder)
        (folder / "empty").mkdir()
        ran = {command: printed(command) for command in COMMANDS}
        documents = {f"{command} --json": printed(f"{command} --json") for command in READING}
        refused = {command: printed(command) for commands in REFUSED.values() for command in commands}
    return Ran(folder=folder, commands=ran, documents=documents, refused=refused)


@pytest.fixture
def desk(ran: Ran, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The desk, for who runs more commands there."""
    sit_down(monkeypatch, ran.folder)
    return ran.folder


def sit_down(patch: pytest.MonkeyPatch, folder: Path) -> None:
    """Work in a folder, on the registry that is made there."""
    seclude(patch, folder)
    patch.chdir(folder)
    patch.setenv("CALIBRARY_REGISTRY", str(folder / "new/fleet"))
