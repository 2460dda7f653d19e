"""What a git host runs for a registry: the action's steps and those of a new registry's workflow, as its runner does.

The runner itself is not here: ``uses:`` steps are left out, expressions and conditions are worked out below, and what
installs calibrary only notes down how it was called.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
import yaml

from calibrary.cli.main import main
from calibrary.registry.registry import Registry
from tests.cli.registry.fleets import CAMERA, P4R, add, xml
from tests.house.project import ROOT
from tests.registry.git.repositories import git

EXPRESSION = re.compile(r"\$\{\{ ?(.*?) ?\}\}")
ENTRY = f"cameras/{P4R}.yaml"


@pytest.fixture(scope="module")
def clone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A checkout of a registry, from a bare repository, with branches that a pull request may be of."""
    folder = tmp_path_factory.mktemp("host")
    with pytest.MonkeyPatch.context() as patch:
        for name, value in {"NAME": "Ada", "EMAIL": "ada@example.com"}.items():
            patch.setenv(f"GIT_AUTHOR_{name}", value)
            patch.setenv(f"GIT_COMMITTER_{name}", value)
        assert main(["registry", "init", str(folder / "fleet")]) == 0
        patch.setenv("CALIBRARY_REGISTRY", str(folder / "fleet"))
        add(xml(folder / "a.xml"), "--approve")
        # What it takes to approve is asked for from here on, by the branch that changes go to.
        rules = folder / "fleet/registry.yaml"
        rules.write_text(rules.read_text() + "approvals: {count: 2}\n")
        git(folder / "fleet", "commit", "--quiet", "-am", "Ask for a second person")
        asked = git(folder / "fleet", "rev-parse", "HEAD:registry.yaml")
        assert main(["registry", "approve", "registry.yaml", "--digest", asked]) == 0
        git(folder, "clone", "--quiet", "--bare", "fleet", "hub.git")
        git(folder, "clone", "--quiet", "hub.git", "checkout")
        work = folder / "checkout"
        git(work, "switch", "--quiet", "-c", "proposed")
        patch.setenv("CALIBRARY_REGISTRY", str(work))
        add(xml(folder / "b.xml", size=(4864, 3648)), camera=CAMERA)
        git(work, "switch", "--quiet", "-c", "loosened", "main")
        rules = work / "registry.yaml"
        rules.write_text(rules.read_text().replace("approvals: {count: 2}\n", ""))
        git(work, "commit", "--quiet", "-am", "Ask for none")
        add(xml(folder / "c.xml", size=(4864, 3648)), camera=CAMERA)
        git(work, "switch", "--quiet", "-c", "edited", "main")
        (work / ENTRY).write_text(re.sub(r"fx: [\d.]+", "fx: 3700.0", (work / ENTRY).read_text()))
        git(work, "commit", "--quiet", "-am", "Edit")
        git(work, "switch", "--quiet", "main")
    return work


def steps_of(path: Path) -> list[dict[str, Any]]:
    document = yaml.safe_load(path.read_text())
    steps: list[dict[str, Any]] = (document["runs"] if "runs" in document else document["jobs"]["check"])[
        "steps"
    ]
    return steps


def run_steps(
    path: Path, clone: Path, folder: Path, *, branch: str, event: str
) -> tuple[list[int], list[str], str]:
    """Exit codes of the steps up to the first that fails, how pip was called, and what was printed."""
    git(clone, "switch", "--quiet", "--detach", branch)
    inputs = {
        f"inputs.{name}": str(one["default"])
        for name, one in yaml.safe_load(path.read_text()).get("inputs", {}).items()
    }
    context = {
        **inputs,
        "github.event_name": event,
        "github.event.pull_request.base.sha": git(clone, "rev-parse", "main"),
    }
    stubs = folder / "bin"
    stubs.mkdir()
    for name in ("python", "pip"):
        (stubs / name).write_text(f'#!/bin/sh\necho "{name} $@" >> "{folder / "installed"}"\n')
        (stubs / name).chmod(0o755)
    (stubs / "calibrary").symlink_to(Path(sys.executable).parent / "calibrary")
    environment = {
        "PATH": f"{stubs}:/usr/bin:/bin",
        "HOME": str(folder),
        "CI": "true",
        "GITHUB_ACTIONS": "true",
        "GITHUB_WORKSPACE": str(clone),
        "GITHUB_EVENT_NAME": event,
        "LANG": "C.UTF-8",
    }
    codes, told = [], ""
    for step in steps_of(path):
        if "run" not in step or not holds(step.get("if"), context):
            continue
        own = {name: filled(str(value), context) for name, value in step.get("env", {}).items()}
        script = folder / "step.sh"
        script.write_text(filled(step["run"], context))
        done = subprocess.run(
            ["bash", "--noprofile", "--norc", "-eo", "pipefail", script],
            cwd=clone,
            env={**environment, **own},
            capture_output=True,
            text=True,
            check=False,
        )
        codes.append(done.returncode)
        told += done.stdout + done.stderr
        if done.returncode:
            break
    return codes, (folder / "installed").read_text().splitlines(), told


def filled(text: str, context: Mapping[str, str]) -> str:
    return EXPRESSION.sub(lambda found: context[found[1]], text)


def holds(condition: str | None, context: Mapping[str, str]) -> bool:
    if condition is None:
        return True
    name, _, value = condition.partition(" == ")
    return context[name] == value.strip("'")


ACTION = ROOT / "action.yml"


def test_a_pull_request_with_a_proposal_passes_every_step(clone: Path, tmp_path: Path) -> None:
    codes, installed, told = run_steps(ACTION, clone, tmp_path, branch="proposed", event="pull_request")
    assert codes == [0, 0, 0]
    assert len(installed) == 1
    assert re.search(r"install .*calibrary", installed[0])
    assert told.count("0 errors") == 2


def test_a_pull_request_that_loosens_the_rules_is_judged_by_those_in_force(
    clone: Path, tmp_path: Path
) -> None:
    own = clone / ".github/workflows/registry-check.yml"
    codes, _, told = run_steps(own, clone, tmp_path, branch="loosened", event="pull_request")
    assert codes == [0, 0, 0]
    assert "asks for other rules than those in force" in told
    # What was added under them waits as under those in force.
    assert [*Registry.open(clone).snapshot().paths] == [ENTRY]


def test_an_edited_number_fails_the_push(clone: Path, tmp_path: Path) -> None:
    codes, _, told = run_steps(ACTION, clone, tmp_path, branch="edited", event="push")
    assert codes == [0, 1]
    assert "digest" in told


def test_a_pinned_version_is_installed() -> None:
    [step] = [one for one in steps_of(ACTION) if "pip install" in one.get("run", "")]
    told = subprocess.run(
        ["bash", "-c", step["run"].replace("python -m pip", "echo")],
        env={**os.environ, "VERSION": "0.1.0"},
        capture_output=True,
        text=True,
        check=True,
    )
    assert told.stdout.split()[-1] == "calibrary==0.1.0"


def test_the_hook_here_is_the_one_that_a_new_registry_has(clone: Path) -> None:
    [published] = yaml.safe_load((ROOT / ".pre-commit-hooks.yaml").read_text())
    [own] = yaml.safe_load((clone / ".pre-commit-config.yaml").read_text())["repos"][0]["hooks"]
    same = ("id", "entry", "language", "files", "pass_filenames")
    assert {name: own[name] for name in same} == {name: published[name] for name in same}
    pattern = re.compile(published["files"])
    assert all(pattern.search(name) for name in (ENTRY, "registry.yaml"))
    assert not pattern.search("README.md")


def test_the_image_is_built_in_stages_and_runs_without_rights() -> None:
    text = (ROOT / "Dockerfile").read_text().replace("\\\n", " ")
    lines = [line.split(maxsplit=1) for line in text.splitlines() if line and line[0] != "#"]
    known = {"FROM", "COPY", "RUN", "USER", "WORKDIR", "ENTRYPOINT"}
    assert {word for word, _ in lines} <= known
    stages = re.findall(r"(?m)^FROM (\S+) AS (\S+)$", text)
    assert stages == [("python:3.13-slim", "build"), ("python:3.13-slim", "extract"), ("extract", "all")]
    assert re.findall(r"--mount=from=(\w+)", text) == ["build", "build"]
    # Both images run as a user without rights.
    for stage in re.split(r"(?m)^FROM ", text)[2:]:
        assert [line for line in stage.splitlines() if line.startswith("USER ")][-1] != "USER root"
