"""Registries of several units of one model, some with a label."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from calibrary.calibration import Grade
from calibrary.known_camera import hash_serial
from calibrary.records import replace
from calibrary.registry.entry import Entry
from calibrary.registry.registry import Registry
from tests.cli.registry.direct import put
from tests.registry.entries import FILE, an_entry
from tests.registry.git.repositories import packed, seclude

SERIALS = [f"0V2LG3H0{number}" for number in range(6)]
LABELS = [f"P4R-{number:02}" for number in range(1, 7)]


def a_unit(number: int, **fields: object) -> Entry:
    """One of six; each was calibrated on another day, with another fx."""
    made = replace(FILE, date=f"202{number}-03-0{number + 1}")
    stated = {"fx": 3655.0 + number, "provenance": made, "focal_mm": None, **fields}
    return an_entry(serial=hash_serial("DJI", SERIALS[number]), **stated)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def labelled(begun: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A registry to copy: six units; the first has a second frame size, the third is not calibrated."""
    folder = tmp_path_factory.mktemp("units")
    fleet = shutil.copytree(begun, folder / "fleet")
    with pytest.MonkeyPatch.context() as patch:
        seclude(patch, folder)
        _add_six(fleet)
    return packed(fleet)


@pytest.fixture
def six(labelled: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Six units with their labels, in the registry that commands take for the one that is meant."""
    fleet = shutil.copytree(labelled, tmp_path / "fleet")
    monkeypatch.setenv("CALIBRARY_REGISTRY", str(fleet))
    return fleet


def _add_six(fleet: Path) -> None:
    small = a_unit(0, image_size=(4864, 3648), fx=3654.0)
    units = [a_unit(number, grade=Grade.DESIGN if number == 2 else Grade.CALIBRATED) for number in range(6)]
    put(fleet, small, *units)
    for serial, label in zip(SERIALS, LABELS, strict=True):
        registry = Registry.open(fleet)
        put(
            fleet,
            *(
                replace(one.entry, label=label)
                for one in registry.snapshot().entries()
                if one.entry.calibration.camera.serial == hash_serial("DJI", serial)
            ),
        )
