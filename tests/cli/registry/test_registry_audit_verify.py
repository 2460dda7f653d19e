"""``registry audit --verify``: labelled cases of flights, from images to findings; what the pixels show is given."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from calibrary.jobs.audit.age import Rule
from calibrary.jobs.verify.look import Look
from calibrary.sfm.alterations import MeasuredCamera
from tests.cli.registry.audits import TODAY, phantom
from tests.cli.registry.conftest import Filled
from tests.cli.registry.fleets import P4R, add, looked_at, printed, run, xml

FX = 3660.5
BY_PIXELS = {Rule.PIXELS, Rule.STEP, Rule.TREND, Rule.UNSTEADY, Rule.UNKNOWN_UNITS}
OLD, NEW = "v01.08.0000", "v01.09.1691"
FAR, FLAT = 0.3, 3.0
"""What a systematic pixel does to fx: of a flight that determines it, and of flat ground from one height."""


class Flight(NamedTuple):
    """What one unit took on a day, and the focal length that its pixels show as a factor of the registered one."""

    day: str
    fx: float
    firmware: str = NEW
    serial: str | None = "SERIAL1"
    by_px: float = FAR
    folder: str | None = None


class Case(NamedTuple):
    """Flights, and the rules of the findings that --verify adds, with what K did over time by unit."""

    what: str
    flights: tuple[Flight, ...]
    rules: tuple[str, ...] = ()
    changes: tuple[str, ...] = ("steady",)


CASES = (
    Case("agrees", (Flight("2026:03:01", 1.0), Flight("2026:04:01", 1.002))),
    Case("contradicts", (Flight("2026:03:01", 1.06),), ("pixels contradict K",), ("cannot tell",)),
    Case(
        "cannot tell, however far off",
        (Flight("2026:03:01", 1.2, by_px=FLAT), Flight("2026:04:01", 0.8, by_px=FLAT)),
        (),
        ("cannot tell",),
    ),
    Case(
        "a date that cannot tell among those that can",
        (Flight("2026:03:01", 1.0), Flight("2026:04:01", 1.3, by_px=FLAT), Flight("2026:05:01", 1.0)),
    ),
    Case(
        "drift across dates, each within what agrees",
        tuple(Flight(f"2026:0{month}:01", 0.98 + 0.008 * month) for month in range(1, 5)),
        ("K drifts",),
        ("drifts",),
    ),
    Case(
        "a step at a firmware change",
        tuple(
            Flight(f"2026:0{month}:01", 1.0 if month < 3 else 1.025, OLD if month < 3 else NEW)
            for month in range(1, 5)
        ),
        ("K changed with the firmware", "pixels contradict K"),
        ("changed with the firmware",),
    ),
    Case(
        "two units in one folder",
        (
            Flight("2026:03:01", 0.99, serial="SERIAL1", folder="both"),
            Flight("2026:03:01", 1.01, serial="SERIAL2", folder="both"),
            Flight("2026:04:01", 0.99, serial="SERIAL1", folder="both"),
            Flight("2026:04:01", 1.01, serial="SERIAL2", folder="both"),
        ),
        (),
        ("steady", "steady"),
    ),
    Case(
        "unit unknown",
        (Flight("2026:03:01", 0.99, serial=None), Flight("2026:04:01", 1.014, serial=None)),
        ("units unknown",),
        ("differs, of unknown units",),
    ),
    Case("fewer than 8 images of each date", (), (), ()),
)


def fly(folder: Path, flights: Sequence[Flight], monkeypatch: pytest.MonkeyPatch, count: int = 8) -> Path:
    """The images of some flights, whose pixels show what is given."""
    truth = {}
    for number, flight in enumerate(flights):
        for image in range(count):
            path = folder / (flight.folder or f"flight {number}") / f"{number}_{image}.jpg"
            serial: dict[str, Any] = {"body_serial": flight.serial} if flight.serial is not None else {}
            phantom(path, software=flight.firmware, date_time=f"{flight.day} 09:30:00", **serial)
            truth[path] = flight

    def seen(paths: Sequence[Path], *_: object, **__: object) -> Look:
        [flight] = {truth[path] for path in paths}
        found = MeasuredCamera(
            focal_px=FX * flight.fx,
            std=0.004,
            by_px=flight.by_px,
            images=len(paths),
            corner_px=(-40.0, 1.0),
            split=True,
        )
        return Look(chosen=len(paths), found=found)

    monkeypatch.setattr("calibrary.jobs.audit.over_time.look", seen)
    return folder


def enter(fleet: Path) -> None:
    add(xml(fleet.parent / "a.xml", FX), "--approve", "--date", TODAY)


@pytest.fixture
def registered(fleet: Path, filled: Filled) -> Path:
    return filled(fleet, enter)


@pytest.mark.usefixtures("registered")
@pytest.mark.parametrize("case", CASES, ids=[case.what for case in CASES])
def test_what_the_pixels_of_ordinary_flights_add_to_an_audit(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    flights, count = (case.flights, 8) if case.flights else (CASES[1].flights, 7)
    folder = fly(tmp_path / "flights", flights, monkeypatch, count)
    document = printed(capsys, "registry-audit-1", "audit", folder, "--verify")
    added = [one["rule"] for one in document["findings"] if one["rule"] in BY_PIXELS]
    assert sorted(added) == sorted(case.rules)
    assert tuple(unit["change"] for unit in document["verification"]["units"]) == case.changes
    if not case.rules:
        plain = printed(capsys, "registry-audit-1", "audit", folder)
        assert (plain["verification"], plain["findings"]) == (None, document["findings"])


@pytest.mark.usefixtures("registered")
def test_the_terminal_and_the_page_show_k_over_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = fly(tmp_path / "flights", CASES[5].flights, monkeypatch)
    code, out, err = run(capsys, "audit", folder, "--verify", "--html", tmp_path / "a.html")
    assert code == 1
    assert "at most 15 min" in " ".join(err.split())
    said = " ".join(out.split())
    assert "fx changed by +2.47% ± 0.40%" in said
    assert "contradicts 3752.0 ± 15.0" in said
    page = (tmp_path / "a.html").read_text()
    assert "K over time, by the pixels" in page
    assert "fx by date with ± 3 σ, 4 dates: 2026-01-01 3660.5 ± 43.9, agrees" in page
    assert f"firmware {NEW} on 2026-03-01" in page


@pytest.mark.usefixtures("registered")
def test_after_the_time_limit_the_ends_of_each_series_were_looked_at(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    flights = [Flight(f"2026:0{month}:01", 1.0, serial=one) for month in (1, 2, 3) for one in ("A", "B")]
    folder = fly(tmp_path / "flights", flights, monkeypatch)
    minutes = iter(range(100))
    monkeypatch.setattr("calibrary.jobs.audit.over_time.monotonic", lambda: 60.0 * next(minutes))
    document = printed(capsys, "registry-audit-1", "audit", folder, "--verify", "--verify-minutes", "3")
    found = document["verification"]
    assert found["left_out"] == 2
    assert [[one["day"] for one in unit["flights"]] for unit in found["units"]] == [
        ["2026-01-01", "2026-03-01"]
    ] * 2


def test_k_is_that_of_the_day_of_each_flight(
    registered: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A new K from a day on: the flight before it is held against the old one, that after it against the new one."""
    add(
        xml(tmp_path / "b.xml", 1.05 * FX),
        "--date",
        TODAY,
        "--valid-from",
        "2026-03-15",
        "--force",
        "--reason",
        "new",
    )
    assert run(capsys, "approve", *looked_at(registered, P4R), "--reason", "a new lens")[0] == 0
    flights = (Flight("2026:03:01", 1.0), Flight("2026:04:01", 1.05))
    folder = fly(tmp_path / "flights", flights, monkeypatch)
    document = printed(capsys, "registry-audit-1", "audit", folder, "--verify")
    [unit] = document["verification"]["units"]
    shown: list[dict[str, Any]] = [one["pixels"] for one in unit["flights"]]
    assert [one["verdict"] for one in shown] == ["agrees", "agrees"]
    assert shown[1]["fx"] == pytest.approx(1.05 * shown[0]["fx"])
    assert unit["flights"][1]["valid_from"] == "2026-03-15"
