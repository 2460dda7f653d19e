"""docs/registry.md does what it says: a year of a keeper's commands, run in its order; its table of cases holds."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from calibrary.cli.main import build_parser, leaves
from calibrary.registry.registry import Registry
from tests.cli.desk import typed
from tests.cli.registry.fleets import xml
from tests.house.project import ROOT
from tests.jobs.extract.fleet import DEWARP, picture
from tests.registry.git.repositories import seclude

PAGE = (ROOT / "docs/registry.md").read_text(encoding="utf-8")
COMMANDS = [line for text in re.findall(r"(?ms)^```sh\n(.*?)^```$", PAGE) for line in text.splitlines()]
PHANTOM: dict[str, Any] = {"make": "DJI", "model": "FC6310R", "focal_mm": (88, 10), "dewarp": DEWARP}


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The files that the page names, and a git that nobody has set up."""
    seclude(monkeypatch, tmp_path)
    monkeypatch.chdir(tmp_path)
    for name, f in (("03", 3660.5), ("04", 3658.0), ("05", 3662.0), ("03-new", 3664.0)):
        (tmp_path / "lab").mkdir(exist_ok=True)
        xml(tmp_path / "lab" / f"{name}.xml", f)
    for number in (3, 4, 6):
        picture(
            tmp_path / f"flights/2026-05-04 north/{number}.jpg",
            (5472, 3648),
            **PHANTOM,
            body_serial=f"0V2LG3H0{number}",
            date_time="2026:05:04 09:00:00",
        )
    return tmp_path


def run(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """One line of the page, as a shell runs it; DIGEST is that of the only proposal."""
    if "DIGEST" in command:
        [digest] = Registry.open(folder / "fleet").snapshot().proposed.values()
        command = command.replace("DIGEST", str(digest))
    with pytest.MonkeyPatch.context() as patch:
        if "init" not in command:
            patch.setenv("CALIBRARY_REGISTRY", "fleet")
        patch.setenv("PATH", os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]))
        patch.chdir(folder)
        return typed(command)


@pytest.mark.thorough
def test_every_command_of_the_page_runs_in_its_order(desk: Path) -> None:
    said = {}
    for command in COMMANDS:
        done = run(command, desk)
        assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
        said[command] = done.stdout
    assert "3664.0000" not in said["calibrary registry resolve P4R-03 --on 2025-07-01"]
    [first] = [text for command, text in said.items() if command.startswith("calibrary registry audit")]
    assert first.splitlines()[1].split()[:6] == ["DJI", "FC6310R,", "unit", "1cfed33c", "no", "entry"]
    assert "nothing to change" in said["calibrary registry set --table units.csv --yes"]
    [chosen] = [text for command, text in said.items() if "--sort date,-fx" in command]
    assert [line.split()[0] for line in chosen.splitlines()[1:]] == ["P4R-05", "P4R-04"]


def test_the_page_names_commands_that_there_are() -> None:
    there = {leaf.prog for leaf in leaves(build_parser())}
    named = {match[0] for match in re.findall(r"(calibrary registry (units )?[a-z]+)", "\n".join(COMMANDS))}
    assert named <= there


def test_the_page_is_linked_from_the_readme() -> None:
    assert "docs/registry.md" in (ROOT / "README.md").read_text(encoding="utf-8")
