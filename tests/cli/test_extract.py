"""``calibrary extract`` from the command line: exit codes, streams, and when nothing is written."""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibrary.cli.main import main
from calibrary.schemas import require
from tests.jobs.extract.fleet import DEWARP, NOBODY, P4R, entry, matrix, picture

Extract = Callable[..., int]


@pytest.fixture
def extract(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Extract:
    """Run the command in a folder of its own; returns the exit code."""
    monkeypatch.chdir(tmp_path)

    def run(*flags: str) -> int:
        return main(["extract", *flags])

    return run


def left_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir() if path.name != "input")


class TestExitCodes:
    def test_0_when_every_camera_has_a_valid_k(self, tmp_path: Path, extract: Extract) -> None:
        picture(tmp_path / "input/a.jpg", **P4R)
        assert extract() == 0

    def test_1_when_a_corrupt_image_lies_among_good_ones_and_the_last_line_says_why(
        self, tmp_path: Path, extract: Extract, capsys: pytest.CaptureFixture[str]
    ) -> None:
        picture(tmp_path / "input/a.jpg", **P4R)
        (tmp_path / "input/b.jpg").write_bytes(b"\xff\xd8\xff")
        assert extract() == 1
        assert capsys.readouterr().out.splitlines()[-1].endswith("1 valid; 1 of 2 images unread")
        assert left_in(tmp_path) == ["K_matrix.json", "K_matrix.npy"]

    @pytest.mark.parametrize("tags", [NOBODY, {}], ids=["unproven", "rejected"])
    def test_1_when_one_camera_has_not(self, tmp_path: Path, extract: Extract, tags: dict[str, Any]) -> None:
        picture(tmp_path / "input/a.jpg", **P4R)
        picture(tmp_path / "input/b.jpg", **tags)
        assert extract() == 1

    def test_1_when_every_image_is_corrupt(self, tmp_path: Path, extract: Extract) -> None:
        (tmp_path / "input").mkdir()
        (tmp_path / "input/a.jpg").write_bytes(b"\xff\xd8\xff")
        assert extract() == 1
        assert left_in(tmp_path) == ["K_matrix.json"]

    @pytest.mark.parametrize(
        "flags",
        [
            ("--sensor-width-mm", "0"),
            ("--sensor-height-mm", "wide"),
            ("--principal-point-tolerance", "5"),
            ("--max-focal-deviation-pct", "101"),
            ("--max-focal-deviation-pct", "nan"),
            ("--workers", "-1"),
            ("--to", "pix5d"),
            ("--no-such-flag",),
        ],
    )
    def test_2_when_the_command_is_not_understood(
        self, extract: Extract, flags: tuple[str, ...], capsys: pytest.CaptureFixture[str]
    ) -> None:
        with pytest.raises(SystemExit) as ended:
            extract(*flags)
        assert ended.value.code == 2
        assert flags[0] in capsys.readouterr().err

    @pytest.mark.parametrize(
        ("flags", "said"),
        [
            (("--image-dir", "nowhere"), "nowhere"),
            (("--fallback-k", "nowhere.npy"), "nowhere.npy"),
            (("--policy", "nowhere.yaml"), "nowhere.yaml"),
            (("--output-matrix", "/dev/null/K.npy"), "/dev/null"),
            (("--output-matrix", "K.json"), "K.json"),
        ],
    )
    def test_3_when_an_input_or_a_place_is_not_there(
        self,
        tmp_path: Path,
        extract: Extract,
        capsys: pytest.CaptureFixture[str],
        flags: tuple[str, ...],
        said: str,
    ) -> None:
        picture(tmp_path / "input/a.jpg", **P4R)
        assert extract(*flags) == 3
        captured = capsys.readouterr()
        assert captured.err.startswith("calibrary: ")
        assert said in captured.err
        assert captured.out == ""
        assert left_in(tmp_path) == []

    def test_1_when_nothing_can_be_handed_over_and_k_and_the_report_are_written_all_the_same(
        self, tmp_path: Path, extract: Extract, capsys: pytest.CaptureFixture[str]
    ) -> None:
        for unit in "12":
            picture(tmp_path / f"input/{unit}/a.jpg", **P4R, body_serial=unit)
        assert extract("--recursive", "--to", "opensfm") == 1
        printed = " ".join(capsys.readouterr().out.split())
        assert "nothing is handed to opensfm" in printed
        assert "--task DIR makes a folder in which they differ" in printed
        assert "2 cameras, judged by the fleet policy: 2 valid" in printed
        assert [name for name in left_in(tmp_path) if name.endswith(".npy")] != []
        assert extract("--recursive", "--to", "colmap") == 0

    def test_4_when_the_registry_cannot_be_read(
        self, tmp_path: Path, extract: Extract, capsys: pytest.CaptureFixture[str]
    ) -> None:
        picture(tmp_path / "input/a.jpg", make="DJI", model="FC6310R")
        assert extract("--registry", "nowhere") == 4
        entry(tmp_path / "registry", focal_mm=8.8)
        entry(tmp_path / "registry", focal_mm=24.0)
        assert extract("--registry", "folder:registry") == 4
        assert "5472x3648+f24.yaml" in capsys.readouterr().err
        assert left_in(tmp_path) == ["registry"]


class TestStrict:
    @pytest.mark.parametrize("tags", [NOBODY, {}], ids=["unproven", "rejected"])
    def test_a_breach_writes_nothing_and_names_the_camera(
        self, tmp_path: Path, extract: Extract, capsys: pytest.CaptureFixture[str], tags: dict[str, Any]
    ) -> None:
        picture(tmp_path / "input/a.jpg", **P4R)
        picture(tmp_path / "input/b.jpg", **tags)
        assert extract("--strict-validation", "--to", "colmap") == 1
        assert left_in(tmp_path) == []
        assert (str(tags.get("make", "unknown camera"))) in capsys.readouterr().err

    def test_a_corrupt_image_is_a_breach(
        self, tmp_path: Path, extract: Extract, capsys: pytest.CaptureFixture[str]
    ) -> None:
        picture(tmp_path / "input/a.jpg", **P4R)
        (tmp_path / "input/b.jpg").write_bytes(b"\xff\xd8\xff")
        assert extract("--strict-validation") == 1
        assert left_in(tmp_path) == []
        assert "b.jpg" in capsys.readouterr().err

    def test_an_earlier_runs_k_is_left_as_it_was(self, tmp_path: Path, extract: Extract) -> None:
        matrix(tmp_path / "K_matrix.npy", 1.0)
        picture(tmp_path / "input/a.jpg")
        assert extract("--strict-validation") == 1
        assert np.load(tmp_path / "K_matrix.npy")[0, 0] == 1.0

    def test_without_a_breach_it_writes_as_ever(self, tmp_path: Path, extract: Extract) -> None:
        picture(tmp_path / "input/a.jpg", **P4R)
        assert extract("--strict-validation") == 0
        assert left_in(tmp_path) == ["K_matrix.json", "K_matrix.npy"]


class TestDryRun:
    def test_it_judges_everything_and_writes_nothing(
        self, tmp_path: Path, extract: Extract, capsys: pytest.CaptureFixture[str]
    ) -> None:
        picture(tmp_path / "input/a.jpg", **P4R)
        picture(tmp_path / "input/b.jpg")
        assert extract("--dry-run", "--to", "opencv", "--explain") == 1
        assert left_in(tmp_path) == []
        printed = capsys.readouterr().out
        assert "K_matrix.dji-fc6310r-5472x3648.npy" in printed
        assert "dji-fc6310r-5472x3648.opencv.yml" in printed

    def test_its_report_is_the_one_that_would_be_written(
        self, tmp_path: Path, extract: Extract, capsys: pytest.CaptureFixture[str]
    ) -> None:
        picture(tmp_path / "input/a.jpg", **P4R)
        assert extract("--dry-run", "--json") == 0
        dry = json.loads(capsys.readouterr().out)
        assert extract("--json") == 0
        assert dry == json.loads(capsys.readouterr().out)


class TestStreams:
    def test_json_stands_alone_on_standard_output(
        self, tmp_path: Path, extract: Extract, capsys: pytest.CaptureFixture[str]
    ) -> None:
        picture(tmp_path / "input/a.jpg", **P4R)
        picture(tmp_path / "input/b.jpg")
        extract("--json")
        printed = capsys.readouterr().out
        assert printed == (tmp_path / "K_matrix.json").read_text()
        require(json.loads(printed), "report-1")

    def test_what_people_read_is_on_standard_output_too(
        self, tmp_path: Path, extract: Extract, capsys: pytest.CaptureFixture[str]
    ) -> None:
        picture(tmp_path / "input/a.jpg", **P4R, dewarp=DEWARP)
        extract("--explain")
        captured = capsys.readouterr()
        assert captured.err == ""
        for text in ("FC6310R", "3660.50", "calibrated", "valid", "DewarpData", "K_matrix.npy"):
            assert text in captured.out

    def test_a_refused_sensor_is_told_with_json_as_well(
        self, tmp_path: Path, extract: Extract, capsys: pytest.CaptureFixture[str]
    ) -> None:
        picture(tmp_path / "input/a.jpg", **P4R)
        picture(tmp_path / "input/b.jpg", **NOBODY)
        assert extract("--json", "--sensor-width-mm", "13.2") == 2
        captured = capsys.readouterr()
        assert "--sensor CAMERA=WxH" in captured.err
        assert captured.out == ""

    def test_a_default_that_is_typed_is_a_statement(
        self, tmp_path: Path, extract: Extract, capsys: pytest.CaptureFixture[str]
    ) -> None:
        picture(tmp_path / "input/a.jpg", **NOBODY)
        assert extract() == 1
        assert "--sensor One=WxH" in capsys.readouterr().out
        assert extract("--sensor-width-mm", "13.2", "--sensor-height-mm", "8.8") == 0

    def test_a_camera_a_solver_does_not_get_is_named(
        self, tmp_path: Path, extract: Extract, capsys: pytest.CaptureFixture[str]
    ) -> None:
        picture(tmp_path / "input/a.jpg", **P4R)
        picture(tmp_path / "input/b.jpg", **NOBODY)
        assert extract("--to", "colmap") == 1
        printed = " ".join(capsys.readouterr().out.split())
        assert "example-one-5472x3648 1 none" in printed
        assert "unproven; --include-unproven hands it on as a start" in printed
        assert "example" not in (tmp_path / "colmap.sh").read_text()


def test_a_stand_in_may_be_given_for_one_camera(tmp_path: Path, extract: Extract) -> None:
    picture(tmp_path / "input/a.jpg")
    matrix(tmp_path / "K.npy", 3700.0)
    assert extract("--fallback-k", "K.npy") == 0
    assert np.load(tmp_path / "K_matrix.npy")[0, 0] == 3700.0


def test_an_interruption_says_that_nothing_was_written(
    tmp_path: Path, extract: Extract, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(*_images: object, **_how: object) -> None:
        raise KeyboardInterrupt

    picture(tmp_path / "input/a.jpg", **P4R)
    monkeypatch.setattr("calibrary.jobs.extract.run.run", interrupted)
    assert extract() == 130
    assert "nothing was half written" in capsys.readouterr().err
    assert left_in(tmp_path) == []


def test_no_worker_outlives_the_run(tmp_path: Path, extract: Extract) -> None:
    for number in range(130):
        picture(tmp_path / f"input/{number}.jpg", **P4R)
    assert extract("--workers", "2") == 0
    assert multiprocessing.active_children() == []
