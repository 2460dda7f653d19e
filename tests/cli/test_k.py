"""``k``: the nine numbers of one K, and an exit code that says whether it may be used."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from calibrary.schemas import require
from tests.cli.registry.fleets import xml
from tests.cli.test_files import run
from tests.jobs.extract.fleet import DEWARP, picture
from tests.jobs.extract.fleet import P4R as TAGS

NINE = "3660.5 0.0 2731.5\n0.0 3660.5 1831.25\n0.0 0.0 1.0\n"


def test_a_file_gives_its_nine_numbers_and_what_they_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out, err = run(capsys, "k", xml(tmp_path / "camera.xml"), "--npy", tmp_path / "K.npy")
    assert (code, out) == (0, NINE)
    assert err.startswith("calibrary: ")
    assert np.load(tmp_path / "K.npy").tolist() == [
        [float(x) for x in row.split()] for row in NINE.splitlines()
    ]
    # Whoever reads it next has to know whose origin it counts from.
    assert run(capsys, "k", tmp_path / "K.npy", "--image-size", "5472x3648")[1] == NINE


def test_an_image_gives_the_k_that_extract_judges_valid(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image = picture(tmp_path / "a.jpg", **TAGS, dewarp=DEWARP)
    code, out, err = run(capsys, "k", image)
    assert (code, out.splitlines()[0]) == (0, "3660.5 0.0 2731.5")
    assert "valid, calibrated" in err
    assert json.loads(run(capsys, "k", image, "--json")[1])["use"] == "start"


def test_where_there_is_only_a_seed_it_is_called_one_and_no_file_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image = picture(tmp_path / "a.jpg", make="Nobody", model="None")
    code, out, err = run(capsys, "k", image, "--npy", tmp_path / "K.npy")
    assert code == 1
    assert len(out.split()) == 9
    assert "a seed, no K" in err
    assert not (tmp_path / "K.npy").exists()
    code, out, _ = run(capsys, "k", image, "--json")
    found = json.loads(out)
    require(found, "k-1")
    assert (code, found["use"], found["calibration"]) == (1, "none", None)


def test_a_k_that_is_hardly_a_cameras_is_printed_but_may_not_be_used(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "cameras.txt").write_text("1 PINHOLE 2000 1500 1825 1825 1318 887\n")
    code, out, err = run(capsys, "k", tmp_path / "cameras.txt")
    assert (code, out.splitlines()[0]) == (1, "1825.0 0.0 1318.0")
    assert "principal point" in err
