"""The gate concludes of every file of the flight what its record says, and lets nothing private out."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibrary.jobs.demo.flight import DemoImage, Expectation
from calibrary.schemas import require
from tests.jobs.demo.conftest import Flight

Judged = tuple[dict[str, Any], str, Path]


@pytest.fixture(scope="module")
def judged(flight: Flight, tmp_path_factory: pytest.TempPathFactory) -> Judged:
    """The report, all that was printed, and the folder that was written to."""
    out, result = flight[0], tmp_path_factory.mktemp("result")
    command = [sys.executable, "-m", "calibrary", "extract", "--image-dir", str(out), "--recursive"]
    command += ["--output-matrix", str(result / "K_matrix.npy"), "--to", "colmap"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    return json.loads((result / "K_matrix.json").read_text()), done.stdout + done.stderr, result


def camera_of(judged: Judged, image: DemoImage) -> dict[str, Any] | None:
    found = [camera for camera in judged[0]["cameras"] if image.name in camera["images"]]
    assert len(found) <= 1
    return found[0] if found else None


def set_aside(judged: Judged) -> set[str]:
    return {row["file"] for row in judged[0]["rejected"]}


def test_every_file_is_of_one_camera_or_set_aside(flight: Flight, judged: Judged) -> None:
    for image in flight[1]:
        assert (camera_of(judged, image) is None) is (image.name in set_aside(judged))


def test_every_file_comes_out_as_its_record_says(flight: Flight, judged: Judged) -> None:
    for image in flight[1]:
        camera = camera_of(judged, image)
        expected = Expectation.REJECTED if image.outcome is Expectation.UNREADABLE else image.outcome
        assert (camera["verdict"] if camera is not None else "rejected") == expected, image.name


def test_what_cannot_be_read_is_set_aside(flight: Flight, judged: Judged) -> None:
    assert {image.name for image in flight[1] if image.outcome is Expectation.UNREADABLE} <= set_aside(judged)


def test_every_k_is_the_one_that_was_built_in(flight: Flight, judged: Judged) -> None:
    for image in flight[1]:
        camera = camera_of(judged, image)
        if image.fx_px is None:
            assert camera is None or "K" not in camera["calibration"]
            continue
        assert camera is not None
        assert camera["calibration"]["intrinsics"]["fx"] == pytest.approx(image.fx_px, rel=1e-3), image.name
        assert camera["calibration"]["grade"] == image.grade
        K = np.load(judged[2] / camera["output"])
        assert K.tolist() == camera["calibration"]["K"]


def test_nothing_private_is_in_any_output(flight: Flight, judged: Judged) -> None:
    _, printed, result = judged
    written = {path.name: path.read_bytes() for path in result.iterdir()}
    assert {"K_matrix.json", "colmap.sh"} <= set(written)
    private = {text for image in flight[1] for text in image.private}
    assert len(private) > 20
    for text in private:
        assert text not in printed
        assert not any(text in name or text.encode() in content for name, content in written.items())


def test_the_zoomed_frame_has_a_k_that_no_solver_gets(flight: Flight, judged: Judged) -> None:
    [zoomed] = [image for image in flight[1] if image.name == "phantom4pro/DJI_0102.JPG"]
    camera = camera_of(judged, zoomed)
    assert camera is not None
    assert (judged[2] / camera["output"]).exists()
    assert camera["id"] not in (judged[2] / "colmap.sh").read_text()


def test_the_report_holds_to_its_schema(judged: Judged) -> None:
    require(judged[0], "report-1")


def test_the_table_names_every_camera_and_every_verdict(judged: Judged) -> None:
    report, printed, _ = judged
    for camera in report["cameras"]:
        key = camera["calibration"]["camera"]
        assert (key["model"] or "unknown camera") in printed
    assert all(word in printed for word in ("valid", "unproven", "rejected", "3659.41"))
