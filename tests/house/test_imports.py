"""Imports: light to load, always by the one name, through links that survive a checkout."""

from __future__ import annotations

import ast
import importlib.util
import json
import os
import re
import subprocess
import sys
import sysconfig
import tomllib
from pathlib import Path

import pytest

from tests.house.project import CORE, ROOMS, ROOT, python_files

HEAVY = {"PIL", "cv2", "exifread", "git", "lxml", "matplotlib"}
NAMED = re.compile(rf"\b(?:import|from)\s(?:.*,)?\s*(?:{'|'.join(ROOMS)})\b")
"""What a bare import of a room looks like; few files have it, and only they are worth parsing."""


def roots_loaded_by(code: str) -> set[str]:
    """The top-level modules that a fresh interpreter holds after running ``code``."""
    code += "\nimport json, sys\nprint(json.dumps(sorted({name.partition('.')[0] for name in sys.modules})))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(json.loads(done.stdout))


def own_names_listed(source: str) -> bool:
    """Whether a module has a list of names that it declares itself, all of them."""
    body = ast.parse(source).body if "\n__all__" in source else []
    listed = [
        node.value
        for node in body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
    ]
    brought = {
        alias.asname or alias.name
        for statement in body
        for node in ast.walk(statement)
        if isinstance(node, ast.Import | ast.ImportFrom)
        for alias in node.names
    }
    return any(brought.isdisjoint(ast.literal_eval(names)) for names in listed)


def bare_room_imports(source: str) -> list[str]:
    """Absolute imports that begin at a room instead of at ``calibrary``."""
    names: list[str] = []
    if not NAMED.search(source):
        return names
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            names.append(node.module)
    return [name for name in names if name.partition(".")[0] in ROOMS]


def test_no_module_lists_its_own_names_again() -> None:
    again = [
        str(path.relative_to(ROOT))
        for path in python_files()
        if path.name != "__init__.py" and own_names_listed(path.read_text(encoding="utf-8"))
    ]
    assert again == []
    assert own_names_listed('"""A module."""\n\n__all__ = ["f"]\n\n\ndef f() -> None: ...\n')


def test_importing_calibrary_loads_nothing_heavy() -> None:
    loaded = roots_loaded_by("import calibrary")
    assert "calibrary" in loaded
    assert loaded & HEAVY == set()


def test_importing_the_core_types_loads_nothing_heavy() -> None:
    loaded = roots_loaded_by("import calibrary.calibration, calibrary.errors, calibrary.distortion")
    assert loaded & (HEAVY | {"numpy"}) == set()


def test_what_must_stay_unloaded_is_there_to_be_loaded() -> None:
    runtime = HEAVY - {"matplotlib"}  # drawn with where it is installed, never required
    assert {name for name in runtime if importlib.util.find_spec(name) is None} == set()


def test_the_command_tells_its_version_and_loads_nothing_heavy() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    command = Path(sysconfig.get_path("scripts"), "calibrary")
    environment = os.environ | {"PYTHONPROFILEIMPORTTIME": "1"}
    done = subprocess.run(
        [command, "--version"], capture_output=True, text=True, env=environment, check=False
    )
    assert done.returncode == 0, done.stderr
    assert version in done.stdout.split()
    loaded = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines() if "|" in line}
    assert "calibrary.cli.main" in loaded
    assert {name.partition(".")[0] for name in loaded} & HEAVY == set()


def test_modules_import_by_the_one_name() -> None:
    bare = {path: names for path in python_files() if (names := bare_room_imports(path.read_text("utf-8")))}
    assert bare == {}


@pytest.mark.parametrize(
    "source",
    [
        "import parsers",
        "import sys, parsers",
        "import registry.store as s",
        "def f():\n    from calib.board import Board",
    ],
)
def test_a_bare_import_of_a_room_is_seen(source: str) -> None:
    assert len(bare_room_imports(source)) == 1


def test_an_import_through_the_one_name_is_no_bare_one() -> None:
    assert bare_room_imports("import calibrary.parsers\nfrom calibrary import registry, calib") == []


def test_python_files_finds_each_file_once() -> None:
    files = [path.resolve() for path in python_files()]
    assert len(files) == len(set(files))
    assert {CORE / "errors.py", *(ROOT / room / "__init__.py" for room in ROOMS), Path(__file__)} <= set(
        files
    )


@pytest.mark.parametrize("room", ROOMS)
def test_each_room_is_linked_into_the_package(room: str) -> None:
    assert (CORE / room).readlink() == Path("..", "..", room)


@pytest.mark.parametrize("room", ROOMS)
def test_no_room_is_importable_by_its_bare_name(room: str, tmp_path: Path) -> None:
    code = f"import importlib.util\nprint(importlib.util.find_spec({room!r}))"
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tmp_path)
    assert done.stdout.strip() == "None"
