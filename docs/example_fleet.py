"""A small fleet with two years behind it, for the pictures of its pages; the numbers are made up."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from calibrary.calibration import (
    Calibration,
    CameraKey,
    Covariance,
    Grade,
    ImageSize,
    Intrinsics,
    Provenance,
    Quality,
)
from calibrary.distortion import BrownConrady
from calibrary.records import replace
from calibrary.registry.configuration import configuration_yaml, parse_configuration
from calibrary.registry.entry import Entry, Status
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.git.repository import create
from calibrary.registry.git.writing import FileChange, Person, write
from calibrary.registry.places import CONFIGURATION_FILE
from calibrary.registry.proposals import message_of
from calibrary.registry.registry import Registry
from calibrary.registry.stating import Change, founded, stated

__all__ = ["write_fleet"]

KEEPER = Person(name="Ada Keeper", email="ada@example.com")
NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
STD = np.array([0.42, 0.42, 0.35, 0.33, 2e-4, 6e-4, 8e-6, 8e-6, 6e-4])


@dataclass(frozen=True, slots=True, kw_only=True)
class Model:
    """A camera as its maker names it."""

    make: str
    model: str
    size: ImageSize
    fx: float
    focal_mm: float
    grade: Grade = Grade.CALIBRATED
    status: Status = Status.APPROVED


P4R = Model(make="DJI", model="FC6310R", size=(5472, 3648), fx=3661.4, focal_mm=8.8)
MODELS = (
    P4R,
    Model(make="DJI", model="FC330", size=(4000, 3000), fx=2289.7, focal_mm=3.61, status=Status.DRAFT),
    Model(make="DJI", model="M3E", size=(5280, 3956), fx=3709.8, focal_mm=12.29),
    Model(make="DJI", model="ZenmuseP1", size=(8192, 5460), fx=8018.2, focal_mm=35.0),
    Model(make="MicaSense", model="RedEdge-M", size=(1280, 960), fx=1466.9, focal_mm=5.5, grade=Grade.DESIGN),
    Model(make="Parrot", model="Anafi", size=(5344, 4016), fx=3563.1, focal_mm=4.0, grade=Grade.ADJUSTED),
    Model(make="SONY", model="ILCE-7RM4A", size=(9504, 6336), fx=9342.5, focal_mm=35.0),
)


def write_fleet(folder: Path) -> Registry:
    """A registry of seven cameras, one of which was calibrated five times."""
    repo, configuration, now = create(folder), configuration_yaml(), datetime(2025, 1, 9, tzinfo=UTC)
    said = founded(repo, parse_configuration(configuration).rules, author=KEEPER, now=now)
    begun = [FileChange(path=CONFIGURATION_FILE, data=configuration), *said]
    write(repo, begun, "Begin a registry", author=KEEPER, now=now)
    registry = Registry.open(folder)
    for number, model in enumerate(MODELS):
        _save(
            registry,
            _entry(model, day=f"2025-01-{10 + number}", firmware="01.07"),
            "Add the laboratory's calibration",
        )
    steps = (
        ("2025-04-02", "01.07", 0.35, "spring check"),
        ("2025-10-14", "01.08", 0.1, "after the season"),
        ("2026-02-03", "01.08", 0.55, "spring check"),
        ("2026-06-11", "01.09", 4.4, "firmware 01.09 came out"),
    )
    for day, firmware, change, why in steps:
        _save(registry, _entry(P4R, day=day, firmware=firmware, change=change), "Calibrate anew", why)
    return registry


def _entry(model: Model, *, day: str, firmware: str, change: float = 0.0) -> Entry:
    width, height = model.size
    rho = np.eye(len(NAMES))
    for one, other, correlation in ((0, 1, 0.95), (4, 5, -0.95), (5, 8, -0.97), (4, 8, 0.86)):
        rho[one, other] = rho[other, one] = correlation
    C = rho * np.outer(STD, STD)
    # No two measurements of a lens give the same digits.
    rng = np.random.default_rng(int(day.replace("-", "")))
    error = rng.multivariate_normal(np.zeros(5), C[4:, 4:])
    lens = dict(zip(NAMES[4:], np.array([-0.0724, 0.0213, 0.00071, -0.00018, -0.0061]) + error, strict=True))
    measured = model.grade is Grade.CALIBRATED
    quality = Quality(
        rms_px=0.27,
        views=42,
        points=3696,
        covariance=Covariance.from_matrix(NAMES, C),
        kappa2=1.4,
        coverage=0.86,
    )
    fx = model.fx + change
    calibration = Calibration(
        camera=CameraKey(make=model.make, model=model.model, focal_mm=model.focal_mm, image_size=model.size),
        intrinsics=Intrinsics(
            fx=fx,
            fy=fx - 0.6,
            cx=width / 2 - 4.2 + change / 9,
            cy=height / 2 + 7.3 - change / 14,
            image_size=model.size,
        ),
        distortion=BrownConrady(**{name: float(value) for name, value in lens.items()}),
        grade=model.grade,
        quality=quality if measured else None,
        provenance=Provenance(
            kind="calibration-file",
            source=f"{model.model.lower()}-{day}.xml",
            sha256=hashlib.sha256(f"{model.model} {day}".encode()).hexdigest(),
            date=day,
            firmware=firmware,
            tool="lab 3.1",
        ),
    )
    return replace(Entry.of(calibration), status=model.status)


def _save(registry: Registry, entry: Entry, subject: str, reason: str | None = None) -> None:
    """One commit on the day that its calibration was made."""
    snapshot = registry.snapshot()
    file = FileChange(path=entry.path, data=entry_yaml(entry), base=snapshot.cameras.get(entry.path))
    made = entry.calibration.provenance.date or "2026-01-01"
    now = datetime.fromisoformat(f"{made}T09:30:00").replace(tzinfo=UTC)
    approval = Change(action="approve", before=None, after=entry, why=reason, fields=())
    approved = [approval] if entry.status is Status.APPROVED else []
    said = stated(snapshot, approved, author=KEEPER, now=now).changes
    write(registry.repo, [file, *said], message_of(subject, [entry], reason), author=KEEPER, now=now)
