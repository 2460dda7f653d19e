"""``calibrary onboard`` where the payload's images are a flight: what could be done, and with --flight its estimate."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from calibrary.jobs.onboard import run as job
from calibrary.records import replace
from tests.cli.registry.fleets import xml
from tests.cli.test_calibrate_flight import FLAT, SMALL, flight, simulated
from tests.jobs.onboard.payloads import document, onboard
from tests.sfm.flights import CAMERA, SIZE, Plan

__all__ = ["simulated"]

Simulated = Callable[[Plan], None]
MODEL = ("--for", "model")
RTK = replace(SMALL, gps_m=(0.02, 0.03))
LEVEL = replace(FLAT, rows=2, columns=5, points=250)


@pytest.fixture(autouse=True)
def no_boards(monkeypatch: pytest.MonkeyPatch) -> None:
    """Looking for boards in empty images takes longer than all the rest."""
    monkeypatch.setattr("calibrary.jobs.onboard.payload.shows_board", lambda *_: False)


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flight(tmp_path_factory.mktemp("payload") / "flight", RTK).parent


@pytest.fixture(scope="module")
def flat(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flight(tmp_path_factory.mktemp("flat") / "flight", LEVEL).parent


@pytest.mark.usefixtures("fleet")
def test_without_being_asked_for_it_is_only_said_what_could_be_done_and_how_long_that_takes(
    flown: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    _, out, _ = onboard(capsys, flown, *MODEL, "--yes", page=tmp_path / "page.html")
    hint = "16 images may be a flight: --flight also calibrates from them, about 2 min on two cores"
    assert hint in " ".join(out.split())
    assert job.flight_hint(7) is None
    monkeypatch.setattr(job, "find_spec", lambda _: None)
    assert job.flight_hint(16) is None


@pytest.mark.usefixtures("fleet")
def test_a_flight_joins_the_estimates_and_its_k_is_proposed(
    flown: Path, simulated: Simulated, capsys: pytest.CaptureFixture[str]
) -> None:
    simulated(RTK)
    xml(flown / "camera.xml", CAMERA.intrinsics.fx + 2.0, SIZE)
    [camera] = document(capsys, flown, *MODEL, "--flight", "--trust", "flight")["cameras"]
    told = {one["kind"]: one for one in camera["estimates"]}
    assert {kind: (one["name"], one["grade"], one["chosen"]) for kind, one in told.items()} == {
        "flight": ("16 images of a flight", "adjusted", True),
        "file": ("camera.xml", "adjusted", False),
    }
    assert told["flight"]["intrinsics"]["fx"] == pytest.approx(CAMERA.intrinsics.fx, rel=3e-3)
    assert told["file"]["agreement"] != "disagrees"
    assert camera["decision"] == "draft proposed"
    assert camera["flight"]["verdict"] == "start"
    assert "fly what its findings ask for before approving it" in camera["reason"]
    made = camera["entry"]["calibration"]["provenance"]
    assert (made["kind"], len(made["sources"])) == ("flight", 16)


@pytest.mark.thorough
@pytest.mark.usefixtures("fleet")
def test_a_flight_that_determines_no_k_is_no_estimate_and_says_why(
    flat: Path, simulated: Simulated, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    simulated(LEVEL)
    _, out, _ = onboard(capsys, flat, *MODEL, "--flight", "--yes", page=tmp_path / "page.html")
    said = " ".join(out.split())
    assert "the images of a flight give no K" in said
    assert "flight: 10 images" not in said
    assert "10 images of a flight give no K" in (tmp_path / "page.html").read_text()
