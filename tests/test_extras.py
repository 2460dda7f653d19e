"""What a job says when the libraries of its extra are not installed."""

from __future__ import annotations

import sys
from pathlib import Path
from types import ModuleType

import pytest

from calibrary.cli.main import main
from calibrary.errors import MissingExtraError
from calibrary.extras import CALIBRATE, LIBRARIES, require


@pytest.fixture
def bare(monkeypatch: pytest.MonkeyPatch) -> None:
    """A plain install: nothing of any extra can be imported."""
    installed = require.__globals__["find_spec"]
    absent = {*LIBRARIES}
    monkeypatch.setattr(
        "calibrary.extras.find_spec", lambda name: None if name in absent else installed(name)
    )


COMMANDS = {
    "calibrate": ("calibrate frames --square-mm 40", "calibrate,opencv"),
    "calibrate board": (
        "calibrate board checkerboard:9x6 --square-mm 30 --out board.pdf",
        "calibrate,opencv",
    ),
    "calibrate synth": (
        "calibrate synth out --board checkerboard:9x6 --square-mm 30",
        "calibrate,opencv",
    ),
    "undistort": ("undistort images --calibration camera.xml", "calibrate,opencv"),
    "demo": ("demo out", "calibrate"),
    "calibrate flight": ("calibrate flight images", "sfm"),
    "calibrate rig": ("calibrate rig images images --square-mm 30", "calibrate,opencv"),
    "calibrate watch": ("calibrate watch images --board checkerboard:9x6", "calibrate,opencv"),
    "desk": ("desk --registry registry", "desk,pages"),
    "registry site": ("registry site out --registry registry", "pages"),
    "pixels of a flight": ("extract images --verify", "sfm"),
    "pixels, to check": ("check images --verify", "sfm"),
    "a Parquet table": ("extract images --table t.parquet", "tables"),
    "a bucket": ("extract s3://fleet/", "remote"),
    "a page": ("extract images --html page.html", "pages"),
    "a report": ("calibrate frames --square-mm 40 --html page.html", "pages"),
}


@pytest.mark.usefixtures("bare")
@pytest.mark.parametrize(("command", "extras"), COMMANDS.values(), ids=COMMANDS)
def test_a_job_names_the_command_that_installs_what_it_needs_and_writes_nothing(
    command: str,
    extras: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / "images").mkdir()
    monkeypatch.chdir(tmp_path)
    assert main(command.split()) == 2
    said = capsys.readouterr().err.strip()
    assert said.endswith(f'pip install "calibrary[{extras}]"')
    assert "\n" not in said
    assert [*tmp_path.iterdir()] == [tmp_path / "images"]


def test_an_opencv_that_is_too_old_is_named_with_its_version(monkeypatch: pytest.MonkeyPatch) -> None:
    old = ModuleType("cv2")
    old.__version__ = "4.8.1"  # type: ignore[attr-defined]
    old.__spec__ = sys.modules[__name__].__spec__
    monkeypatch.setitem(sys.modules, "cv2", old)
    with pytest.raises(MissingExtraError, match=r"a calibration needs OpenCV 4\.10 or newer, found 4\.8\.1"):
        require(CALIBRATE, "a calibration")


def test_an_opencv_that_does_not_load_gives_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(_name: str) -> ModuleType:
        raise ImportError("libGL.so.1: cannot open shared object file")

    monkeypatch.setattr("calibrary.extras.import_module", broken)
    with pytest.raises(MissingExtraError, match=r"OpenCV, which does not load: libGL\.so\.1"):
        require(CALIBRATE, "a calibration")


def test_what_is_installed_is_not_complained_of() -> None:
    require(CALIBRATE, "a calibration")
