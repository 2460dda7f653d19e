"""``calibrary extract --html``: a page beside the rest, whole or not at all."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from calibrary.cli.main import main
from calibrary.schemas import require
from tests.jobs.extract.fleet import DEWARP, NOBODY, P4R, picture


@pytest.fixture(autouse=True)
def flight(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    picture(tmp_path / "input/a.jpg", **P4R, dewarp=DEWARP)


def left_in(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir() if path.name != "input")


def test_writes_the_page_beside_the_rest_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["extract", "--html", "flight.html"]) == 0
    assert left_in(tmp_path) == ["K_matrix.json", "K_matrix.npy", "flight.html"]
    assert (tmp_path / "flight.html").read_text(encoding="utf-8").startswith("<!doctype html>")
    assert "flight.html" in capsys.readouterr().out


def test_the_page_tells_the_day_of_the_flight_without_a_registry_too(tmp_path: Path) -> None:
    picture(tmp_path / "input/b.jpg", **P4R, dewarp=DEWARP, date_time="2026:05:01 10:00:00")
    assert main(["extract", "--registry", "none", "--html", "flight.html"]) == 0
    assert "2026-05-01" in (tmp_path / "flight.html").read_text(encoding="utf-8")


def test_leaves_the_exit_code_and_the_document_as_they_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture(tmp_path / "input/b.jpg", **NOBODY)
    assert main(["extract", "--json"]) == 1
    without = capsys.readouterr().out
    assert main(["extract", "--json", "--html", "flight.html"]) == 1
    printed = capsys.readouterr().out
    assert printed == without
    require(json.loads(printed), "report-1")


@pytest.mark.parametrize(
    ("path", "said"),
    [
        ("/dev/null/flight.html", "is a file; expected a folder"),
        ("input/a.jpg", "ends in .html"),
        ("flight", "ends in .html"),
    ],
)
def test_a_place_where_no_page_can_be_is_named_before_any_image_is_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], path: str, said: str
) -> None:
    image = (tmp_path / "input/a.jpg").read_bytes()
    assert main(["extract", "--image-dir", "not-even-there", "--html", path]) == 3
    error = capsys.readouterr().err
    assert said in error
    assert "--html" in error
    assert left_in(tmp_path) == []
    assert (tmp_path / "input/a.jpg").read_bytes() == image


def test_a_dry_run_names_the_page_and_writes_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["extract", "--html", "flight.html", "--dry-run"]) == 0
    assert left_in(tmp_path) == []
    assert "flight.html" in capsys.readouterr().out


def test_a_page_that_cannot_be_written_leaves_nothing_behind(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "flight.html").mkdir()
    assert main(["extract", "--html", "flight.html"]) == 3
    assert "cannot be written" in capsys.readouterr().err
    assert left_in(tmp_path) == ["flight.html"]


def test_who_asks_for_no_page_does_not_wait_for_plots(tmp_path: Path) -> None:
    code = (
        "import sys; from calibrary.cli.main import main; main(['extract', '--json']);"
        "sys.exit(bool({'matplotlib', 'jinja2'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, check=False)
    assert done.returncode == 0
