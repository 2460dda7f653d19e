"""The table of programs in the manual: each command runs, and writes the files that its row names."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

from calibrary.cli.main import main
from calibrary.jobs.extract.targets import TARGETS
from tests.conftest import Flight

PAGE = Path(__file__).parents[2] / "docs/how-to/index.md"
ROWS = re.findall(
    r"(?m)^\| (?:\[([^]]+)\][^|]*|(\w+)) \| `(calibrary [^`]+)` \| (.*) \|$", PAGE.read_text("utf-8")
)
CALIBRATED = "micasense/0000SET/000/IMG_0000_1.tif"


@pytest.fixture
def home(demo_flight: Flight, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a flight of one image, and an image that carries its calibration."""
    (tmp_path / "FLIGHT").mkdir()
    shutil.copy(demo_flight[0] / "phantom4pro/DJI_0101.JPG", tmp_path / "FLIGHT")
    shutil.copy(demo_flight[0] / CALIBRATED, tmp_path / "FILE.tif")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("command", "then"), [row[2:] for row in ROWS], ids=["".join(row[:2]) for row in ROWS]
)
def test_the_command_writes_what_the_row_names(command: str, then: str, home: Path) -> None:
    if "undistort" in command:
        command = command.replace("FLIGHT", "FILE")
    assert main(shlex.split(command.replace("FILE", "FILE.tif"))[1:]) == 0
    files = re.findall(r"`(?:sh |numpy\.load\(\")?([\w/*]+\.[a-z][\w.]*)", then)
    assert files
    for name in files:
        assert [*home.glob(name)], name


def test_every_target_of_extract_has_a_row() -> None:
    assert {name for row in ROWS for name in re.findall(r"--to (\w+)", row[2])} >= {*TARGETS}


def test_k_is_loaded_as_the_page_says(home: Path) -> None:
    assert main(["extract", "FLIGHT"]) == 0
    assert np.load(home / "K_matrix.npy").shape == (3, 3)
