"""One rule says which registry a command uses: ``extract`` and ``check`` follow it as ``registry`` does."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from calibrary.cli.main import main
from tests.cli.registry.conftest import Filled
from tests.cli.registry.direct import put
from tests.jobs.extract.fleet import picture
from tests.registry.entries import an_entry


def enter(fleet: Path) -> None:
    put(fleet, an_entry(focal_mm=None))


@pytest.fixture
def flight(fleet: Path, tmp_path: Path, filled: Filled) -> Path:
    """An image whose K only the registry knows."""
    filled(fleet, enter)
    return picture(tmp_path / "flight/a.jpg", make="DJI", model="FC6310R", focal_mm=(88, 10)).parent


def extracted(capsys: pytest.CaptureFixture[str], flight: Path, *arguments: str) -> Any:
    """The camera of ``calibrary extract``."""
    capsys.readouterr()
    assert main(["extract", str(flight), "--dry-run", "--json", *arguments]) in {0, 1}
    [camera] = json.loads(capsys.readouterr().out)["cameras"]
    return camera


def is_from_registry(camera: Any) -> bool:
    K = camera.get("calibration")
    return K is not None and K["intrinsics"]["fx"] == an_entry().calibration.intrinsics.fx


def test_extract_uses_the_registry_of_the_variable(flight: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert is_from_registry(extracted(capsys, flight))
    assert not is_from_registry(extracted(capsys, flight, "--registry", "none"))


def test_extract_uses_the_nearest_one(
    flight: Path, fleet: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("CALIBRARY_REGISTRY")
    monkeypatch.chdir(flight)
    assert not is_from_registry(extracted(capsys, flight))
    monkeypatch.chdir(fleet / "cameras")
    assert is_from_registry(extracted(capsys, flight))


@pytest.mark.parametrize("command", [["extract", "--dry-run"], ["check"], ["registry", "list"]])
@pytest.mark.parametrize("by_flag", [True, False])
def test_one_that_is_missing_is_exit_code_4(
    flight: Path,
    command: list[str],
    by_flag: bool,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if not by_flag:
        monkeypatch.setenv("CALIBRARY_REGISTRY", "/nowhere")
    images = [] if command[0] == "registry" else [str(flight)]
    assert main([*command, *images, *(["--registry", "/nowhere"] if by_flag else [])]) == 4
    assert "/nowhere: no such folder; expected a registry" in capsys.readouterr().err


def test_check_uses_the_registry_of_the_variable(
    flight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "K.json"
    file.write_text(json.dumps([[3661.25, 0, 2731.5], [0, 3658.75, 1831.25], [0, 0, 1]]))

    def expected_fx() -> float | None:
        capsys.readouterr()
        assert main(["check", str(flight), str(file), "--image-size", "5472x3648", "--json"]) in {0, 1}
        [checked] = json.loads(capsys.readouterr().out)["files"]
        found: float | None = checked.get("expected_fx")
        return found

    assert expected_fx() == 3661.25
    monkeypatch.setenv("CALIBRARY_REGISTRY", "none")
    assert expected_fx() != 3661.25
