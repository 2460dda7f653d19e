"""The git layer stands alone: it could be used for files of any kind."""

from __future__ import annotations

import ast

import pytest

from tests.house.project import ROOT

MODULES = sorted((ROOT / "registry" / "git").glob("*.py"))
# progress holds the log; like errors, it imports nothing of a camera.
ALLOWED = ("calibrary.errors", "calibrary.progress", "calibrary.registry.git")


@pytest.mark.parametrize("module", MODULES, ids=lambda module: str(module.stem))
def test_it_imports_nothing_of_calibrary_but_the_errors_and_the_log(module: object) -> None:
    tree = ast.parse(ROOT.joinpath("registry", "git", str(module)).read_text())
    imported = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    imported += [name.name for node in ast.walk(tree) if isinstance(node, ast.Import) for name in node.names]
    assert [name for name in imported if name.startswith("calibrary") and not name.startswith(ALLOWED)] == []


def test_there_is_something_to_look_at() -> None:
    assert MODULES
