"""A registry, a flight and their audit."""

from __future__ import annotations

from datetime import date
from pathlib import Path
from typing import Any

import pytest

from tests.cli.registry.fleets import add, held, printed
from tests.jobs.extract.fleet import picture

TODAY = date.today().isoformat()
OWN = "2019-03-05;3660.5,3660.5,-4.5,7.25,-0.1,0.0,0.0,0.001,0.0"
"""The K of :func:`tests.cli.registry.fleets.xml`, as a Phantom writes it."""
FLEW = "2026:03:05 09:30:00"
PHANTOM: dict[str, Any] = {
    "make": "DJI",
    "model": "FC6310R",
    "focal_mm": (88, 10),
    "software": "v01.09.1691",
    "date_time": FLEW,
}


def phantom(path: Path, size: tuple[int, int] = (5472, 3648), **tags: Any) -> Path:
    """A frame of a Phantom 4 RTK whose own calibration is that of its entry."""
    path.parent.mkdir(parents=True, exist_ok=True)
    return picture(path, size, **{"dewarp": OWN, **PHANTOM, **tags})


def approved(fleet: Path, calibration: Path, *flags: str) -> None:
    """The entry of the Phantom, in use."""
    add(calibration, "--approve", *(() if "--date" in flags else ("--date", TODAY)), *flags)
    assert held(fleet).entry.is_usable


def audited(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> Any:
    """The audit's document."""
    return printed(capsys, "registry-audit-1", "audit", *arguments)


def rules(document: Any, level: str | None = None) -> list[str]:
    return [one["rule"] for one in document["findings"] if level in {None, one["severity"]}]


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    phantom(tmp_path / "flight" / "a.jpg")
    return tmp_path / "flight"
