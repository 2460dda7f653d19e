"""The Makefile is the one way in: hooks, CI and papers call targets that exist."""

from __future__ import annotations

import os
import re
import subprocess

import pytest

from tests.house.project import ROOT

MAKEFILE = (ROOT / "Makefile").read_text()
TARGETS = set(re.findall(r"(?m)^([a-z][a-z-]*):", MAKEFILE))
CALLERS = (
    ".ci/run",
    ".github/workflows/ci.yml",
    ".github/workflows/nightly.yml",
    ".pre-commit-config.yaml",
    "CONTRIBUTING.md",
    "DESIGN.md",
    "README.md",
)


def targets_called_in(text: str) -> set[str]:
    """What follows the word make where it is a command: at a line's start, in backticks, after a key."""
    calls = re.findall(r"(?m)(?:^\s*\$? *|`|run: |entry: )make((?: [a-z][a-z-]*)*)", text)
    return {target for call in calls for target in call.split()}


@pytest.mark.parametrize("caller", CALLERS)
def test_what_is_called_is_a_target(caller: str) -> None:
    assert targets_called_in((ROOT / caller).read_text()) - TARGETS == set()


@pytest.mark.parametrize("caller", [".ci/run", ".github/workflows/ci.yml"])
def test_ci_lints_tests_and_builds(caller: str) -> None:
    assert {"lint", "test", "dist", "docs", "man"} <= targets_called_in((ROOT / caller).read_text())


def test_make_alone_lists_every_target() -> None:
    done = subprocess.run(["make"], cwd=ROOT, capture_output=True, text=True, check=True)
    listed = re.findall(r"(?m)^ {2}make ([a-z-]+) +\S", done.stdout)
    assert set(listed) == TARGETS


def test_ci_can_be_run() -> None:
    assert (ROOT / ".ci" / "run").stat().st_mode & 0o111


def recipe(*goals: str) -> str:
    """What would be done in a fresh clone."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("MAKE")}
    command = ["make", "-n", "VENV=build/no-environment", *goals]
    return subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, check=True
    ).stdout


def test_the_demo_installs_what_a_user_would_and_tests_what_is_locked() -> None:
    assert "requirements-dev.lock" not in recipe("demo")
    assert "-e '.[" in recipe("demo")
    assert "-r requirements-dev.lock" in recipe("test")


def test_demo_and_test_in_one_breath_install_once() -> None:
    assert recipe("demo", "test").count("Installing ") == 1
