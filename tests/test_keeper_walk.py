"""A fleet keeper's first day, by the commands alone and in an empty directory: every step says the next one."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from calibrary.cli.main import main
from tests.cli.registry.fleets import CAMERA, P4R, looked_at, xml
from tests.jobs.extract.fleet import picture
from tests.registry.git.repositories import git, nobodys_git

__all__ = ["nobodys_git"]

SECOND = "dji/fc330/4000x3000"


class Keeper:
    """Somebody at a terminal."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def __call__(self, *words: str, code: int = 0) -> str:
        """What a command says, on both streams."""
        got = main(["registry", *words])
        said = self._capsys.readouterr()
        assert got == code, said.err
        return said.out + said.err


def test_a_keepers_first_day(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    registry, lab = Keeper(capsys), tmp_path / "lab"
    lab.mkdir()
    monkeypatch.delenv("CALIBRARY_REGISTRY", raising=False)
    monkeypatch.chdir(tmp_path)
    image = picture(tmp_path / "flight/DJI_0001.JPG", make="DJI", model="FC6310R", focal_mm=(88, 10))

    said = registry("init", "fleet")
    assert "next: calibrary registry add" in said
    monkeypatch.chdir(tmp_path / "fleet")
    assert "not in any registry" in registry("show", str(image))

    assert " new, " in registry("add", "catalogue", "--yes")
    assert "it lacks 1 of 1 approval" in registry("resolve", str(image), code=4)

    said = registry("add", str(xml(lab / "p4r.xml")), *CAMERA, "--yes", "--reason", "test field in March")
    assert f"registry approve {P4R}" in said
    other = str(xml(lab / "p4.xml", f=2311.25, size=(4000, 3000)))
    registry("add", other, "--make", "DJI", "--model", "FC330", "--yes")
    assert git(Path(), "status", "--porcelain") == ""

    registry("approve", *looked_at(Path(), "dji/fc6310r", "dji/fc330"), "--reason", "seen by two")
    said = registry("resolve", str(image))
    assert "fx 3660.5000" in said
    assert "good" in registry("check")

    again = str(xml(lab / "p4r-june.xml", f=3664.25))
    registry("add", again, *CAMERA, "--yes", "--approve", "--reason", "lens was re-seated")

    story = json.loads(main_json(capsys, "log", "fc6310r"))
    reasons = [revision["reason"] for revision in story["revisions"]]
    assert reasons == ["lens was re-seated", "seen by two", "test field in March", None]
    by_hand = git(Path(), "diff", "HEAD~1", "--no-textconv", "--", f"cameras/{P4R}.yaml")
    assert "-  fx: 3660.5" in by_hand
    assert "+  fx: 3664.25" in by_hand
    trailers = git(Path(), "log", "-1", "--format=%(trailers:key=Camera,valueonly)")
    assert trailers == P4R

    git(tmp_path, "init", "--quiet", "--bare", "--initial-branch=main", "fleet.git")
    registry("sync", str(tmp_path / "fleet.git"))
    monkeypatch.chdir(tmp_path)
    registry("init", "second", "--remote", str(tmp_path / "fleet.git"))

    document = json.loads(main_json(capsys, "resolve", str(image), "--registry", "second"))
    assert document["entry"]["id"] == P4R
    assert document["calibration"]["intrinsics"]["fx"] == 3664.25
    assert document["commit"] == git(tmp_path / "fleet", "rev-parse", "HEAD")
    then = git(tmp_path / "second", "rev-parse", "HEAD~1")
    document = json.loads(main_json(capsys, "resolve", str(image), "--registry", "second", "--at", then))
    assert document["calibration"]["intrinsics"]["fx"] == 3660.5
    assert git(tmp_path / "second", "fsck", "--strict") == ""

    registry("lock", "flight", "--registry", "second")
    command = ["extract", "--image-dir", "flight", "--registry", "second", "--locked", "--dry-run"]
    assert main(command) == 0


def main_json(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    """What a command prints for machines."""
    assert main(["registry", *words, "--json"]) == 0
    return capsys.readouterr().out
