"""How the tests of ``calibrary calibrate`` run it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from calibrary.cli.main import main
from calibrary.registry.entry import Entry
from calibrary.registry.init import init
from calibrary.registry.registry import Registry
from tests.registry.git.repositories import nobodys_git

__all__ = ["BOARD", "Run", "calibrated", "fleet", "nobodys_git", "the_entry"]

BOARD = ("--board", "checkerboard:9x6", "--square-mm", "40")
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def calibrated(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Run:
    """Runs the command in a folder of its own; (exit code, standard output, standard error)."""
    monkeypatch.chdir(tmp_path)

    def run(*argv: str | Path) -> tuple[int, str, str]:
        capsys.readouterr()
        code = main(["calibrate", *map(str, argv)])
        said = capsys.readouterr()
        return code, said.out, said.err

    return run


@pytest.fixture
def fleet(tmp_path: Path) -> Registry:
    """A registry in git."""
    return Registry.open(init(tmp_path / "fleet").place)


def the_entry(fleet: Registry) -> Entry:
    [stored] = (*fleet.snapshot().entries(), *fleet.snapshot().proposals())
    return stored.entry
