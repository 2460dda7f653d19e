"""Folders of flights, which combine solves together."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from calibrary.calib.verdict import BoardVerdict
from calibrary.calibration import Calibration, CameraKey
from calibrary.errors import CalibrationError, InputError
from calibrary.jobs.combine import combine
from calibrary.records import replace
from tests.sfm.flights import CAMERA, Plan, fly
from tests.sfm.reconstructions import write_colmap, write_opensfm

RTK = Plan(gps_m=(0.02, 0.03), rows=3, columns=5, points=300)


def flights(folder: Path, *cameras: Calibration) -> list[Path]:
    """Flights as the reconstructions of another program, which states a K that is off."""
    return [
        write_opensfm(folder / f"flight{at}", *fly(RTK, 80 + at, camera)) for at, camera in enumerate(cameras)
    ]


def test_folders_of_flights_are_solved_together_by_their_observations(tmp_path: Path) -> None:
    folders = flights(tmp_path, CAMERA, CAMERA, CAMERA)
    named = CameraKey(make="Example", model="Flight One")
    report = combine(folders, camera=named, html=tmp_path / "season.html")
    assert report.calibration is not None
    assert [one.label for one in report.sources] == ["flight0", "flight1", "flight2"]
    assert all(one.kappa2 is not None for one in report.sources)
    K, quality = report.calibration.intrinsics, report.calibration.quality
    assert quality is not None
    together = quality.std["fx"] * math.sqrt(quality.inflation)
    assert together < 0.8 * min(one.fx_std or math.inf for one in report.sources)
    assert abs(K.fx - CAMERA.intrinsics.fx) < 3 * together
    assert report.calibration.provenance.kind == "combination"
    assert report.entry.calibration.camera.model == "Flight One"
    assert "flight2" in (tmp_path / "season.html").read_text()


def test_flights_of_two_units_are_not_solved_together(tmp_path: Path) -> None:
    K = CAMERA.intrinsics
    other = replace(CAMERA, intrinsics=replace(K, fx=1.05 * K.fx, fy=1.05 * K.fy, cx=K.cx + 9))
    report = combine(flights(tmp_path, CAMERA, CAMERA, other))
    assert (report.calibration, report.verdict) == (None, BoardVerdict.REFUSE)
    assert "flight2" in report.findings[0].message


def test_a_flight_that_cannot_be_solved_is_named(tmp_path: Path) -> None:
    good, poor = flights(tmp_path, CAMERA, CAMERA)
    tracks, scene = fly(Plan(rows=1, columns=3, points=20), 1)
    write_opensfm(tmp_path / "poor", tracks, scene)
    with pytest.raises(CalibrationError, match="poor: 0 images of this camera show 20 points"):
        combine([good, poor, tmp_path / "poor"])


def test_flights_in_folders_of_the_same_names_are_all_solved(tmp_path: Path) -> None:
    cards = [tmp_path / card / "DCIM" / "100MEDIA" for card in ("spring", "summer")]
    for at, card in enumerate(cards):
        write_opensfm(card, *fly(RTK, 80 + at, CAMERA))
    report = combine(cards)
    assert [one.label for one in report.sources] == ["spring/DCIM/100MEDIA", "summer/DCIM/100MEDIA"]


def test_two_programs_results_of_one_flight_are_not_two_flights(tmp_path: Path) -> None:
    flown = fly(replace(RTK, relief=0.05, heights=(1.0, 1.2), oblique_deg=30.0), 80)
    write_opensfm(tmp_path / "odm", *flown)
    write_colmap(tmp_path / "colmap", *flown)
    report = combine([tmp_path / "odm", tmp_path / "colmap"])
    assert [one.rule for one in report.findings] == ["same-observations"]
    assert "of their images have one name and attitude" in report.findings[0].message


def test_a_flight_given_twice_is_refused(tmp_path: Path) -> None:
    [folder] = flights(tmp_path, CAMERA)
    with pytest.raises(InputError, match=r"the same folder as .*expected each flight once"):
        combine([folder, folder / ".." / folder.name])
