"""What is said of the package outside pyproject.toml: the same versions, and commands that exist."""

from __future__ import annotations

import re
import shlex
import tomllib

import pytest
import yaml
from packaging.requirements import Requirement

from calibrary.cli.main import build_parser
from tests.house.project import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
FILES = (
    ".github/workflows/ci.yml",
    ".github/workflows/nightly.yml",
    ".github/workflows/release.yml",
    ".pre-commit-hooks.yaml",
    "CITATION.cff",
    "action.yml",
    "packaging/conda/recipe.yaml",
)
RECIPE = yaml.safe_load((ROOT / "packaging/conda/recipe.yaml").read_text())
CONDA_NAMES = {"py-opencv": "opencv-python-headless", "matplotlib-base": "matplotlib"}


def commands() -> list[str]:
    """Every command line of calibrary in these files; the shell's variables and what follows || aside."""
    text = "\n".join((ROOT / name).read_text() for name in FILES)
    found = re.findall(r"(?m)^\s*(?:- )?(?:run: |entry: )?(calibrary [a-z-][^\n]*)$", text)
    return sorted({re.sub(r" \|\| .*", "", line) for line in found})


@pytest.mark.parametrize("name", FILES)
def test_each_file_is_yaml(name: str) -> None:
    assert isinstance(yaml.safe_load((ROOT / name).read_text()), dict | list)


@pytest.mark.parametrize("command", commands())
def test_each_command_is_understood(command: str) -> None:
    words = shlex.split(command)[1:]
    if words != ["--version"]:
        build_parser().parse_args(words)


def test_there_are_commands_to_look_at() -> None:
    assert "calibrary registry check --worktree" in commands()


def test_every_paper_has_the_packages_version() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert citation["version"] == RECIPE["context"]["version"] == PROJECT["version"]


def test_the_conda_recipe_asks_for_what_the_wheel_asks_for() -> None:
    always = {line.replace(" ", "") for line in RECIPE["requirements"]["run"]} - {"python>=3.11"}
    assert always == set(PROJECT["dependencies"])
    wanted = {
        f"{requirement.name}{requirement.specifier}"
        for lines in PROJECT["optional-dependencies"].values()
        for requirement in map(Requirement, lines)
        if requirement.name != "calibrary"
    }
    sometimes = {
        f"{CONDA_NAMES.get(name, name)}{floor}"
        for name, floor in (line.split() for line in RECIPE["requirements"]["run_constraints"])
    }
    assert sometimes == wanted
