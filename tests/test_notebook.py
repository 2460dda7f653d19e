"""What results look like in a notebook: small tables, everything escaped, nothing that runs or has a colour."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

import calibrary
from calibrary.calibration import CameraKey
from calibrary.interop.notebook import html_rows
from calibrary.jobs.diff.fleet import FleetDiffReport
from tests.jobs.extract.fleet import DEWARP, P4R, entry, files, picture
from tests.workshop import CAMERA

HOSTILE = "<script>alert(1)</script>"


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    """A camera with a hostile name beside one of the registry, and an image that cannot be read."""
    picture(tmp_path / "flight/a.jpg", **P4R, dewarp=DEWARP)
    picture(tmp_path / "flight/b.jpg", make="Example", model=HOSTILE, focal_mm=(132, 10))
    (tmp_path / "flight/torn.jpg").write_bytes(b"\xff\xd8\xff")
    entry(tmp_path / "fleet", fx=3659.0)
    entry(tmp_path / "fleet", model="FC330", image_size=(4000, 3000), fx=2280.1)
    return tmp_path


def text_of(html: str) -> str:
    """What a reader sees; nothing in it may run, load, or set a colour that only one background suits."""
    assert not re.search(r"<(?!/?(?:p|b|br|ul|li|table|caption|thead|tbody|tr|th|td)\b)", html)
    assert not re.search(r"color|background|https?:|\bon\w+=", html)
    return re.sub(r"<[^>]+>", "|", html)


def test_cameras_of_a_flight(flight: Path) -> None:
    shown = text_of(calibrary.extract(flight / "flight")._repr_html_())
    assert "|2 cameras, judged by the fleet policy: 1 valid, 1 unproven; 1 of 3 images unread|" in shown
    assert "|DJI FC6310R 8.8 mm 5472×3648||valid||start||calibrated||1||3660.50|" in shown
    assert "&lt;script&gt;alert(1)" in shown


def test_a_change_with_its_reason_and_what_to_do() -> None:
    moved = calibrary.compare(CAMERA, CAMERA.scaled(CAMERA.intrinsics.image_size))
    assert "||A||a||||B||b||" in text_of(moved._repr_html_())
    K, dist = CAMERA.to_opencv()
    K[0, 0] *= 1.02
    other = calibrary.Calibration.from_opencv(K, dist, image_size=CAMERA.intrinsics.image_size)
    change = calibrary.compare(CAMERA, other)
    shown = text_of(change._repr_html_())
    assert f"|structural: transcode, needs attention. {change.advice}|" in shown.replace("&#x27;", "'")


def test_a_fleet_since_a_day_without_anything_to_compare() -> None:
    shown = text_of(FleetDiffReport(changes=(), unmatched="no entry was in use then")._repr_html_())
    assert "no entry was in use then" in shown


def test_a_registry_its_entries_and_its_answers(flight: Path) -> None:
    fleet = calibrary.open_registry(files(flight / "fleet"))
    listed = text_of(fleet.listing()._repr_html_())
    assert "||dji/fc6310r/5472x3648||approved||calibrated||3659.00|" in listed
    assert "|intrinsics.fx||3659 px|" in text_of(fleet.show("fc6310r")._repr_html_())
    answer = text_of(fleet.resolve("fc6310r")._repr_html_())
    assert "|entry||cameras/dji/fc6310r/5472x3648.yaml" in answer
    assert "|fx||3659.00 px|" in answer
    none = text_of(fleet.resolve(CameraKey(make="DJI", model=HOSTILE))._repr_html_())
    assert "No approved K applies" in none
    assert "&lt;script&gt;" in none


def test_an_audit_begins_with_what_is_most_urgent(flight: Path) -> None:
    audit = calibrary.open_registry(files(flight / "fleet")).audit([flight / "flight"])
    shown = text_of(audit._repr_html_())
    assert f"{audit.counts.note} notes" in shown
    assert shown.index("&lt;script&gt;alert(1)") < shown.index("|DJI FC6310R|")


def test_of_many_rows_the_first_are_shown() -> None:
    shown = text_of(html_rows(["n"], [[str(n)] for n in range(30)], title="numbers"))
    assert "|numbers; the first 20 of 30|" in shown
    assert ("|19|" in shown, "|20|" in shown) == (True, False)
