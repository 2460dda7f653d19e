"""A fleet whose cameras have a past: calibrated again, new firmware, a swapped lens, and names nobody should write."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calibrary.calibration import Covariance, Quality
from calibrary.distortion import BrownConrady, KannalaBrandt
from calibrary.records import replace
from calibrary.registry.entry import Entry, Status
from calibrary.registry.init import init
from calibrary.registry.proposals import message_of
from calibrary.registry.registry import Registry
from tests.registry.entries import FILE, LENS, an_entry, put_entries

HOSTILE = (
    "<script>document.title='owned'</script>",
    "\" onmouseover='alert(1)' x=\"",
    "gpj.\u202eexe\u2066",
    "</title></style><img src=x onerror=alert(1)>",
)
NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
STD = (0.3, 0.3, 0.4, 0.4, 2e-4, 4e-4, 1e-5, 1e-5, 3e-4)


def measured(kappa2: float = 1.4) -> Quality:
    """What a good board calibration says of itself."""
    rho = np.eye(len(NAMES))
    rho[0, 1] = rho[1, 0] = 0.97
    rho[4, 5] = rho[5, 4] = -0.9
    covariance = Covariance.from_matrix(NAMES, rho * np.outer(STD, STD))
    return Quality(rms_px=0.28, views=41, points=5280, covariance=covariance, kappa2=kappa2, coverage=0.82)


def later(
    entry: Entry, *, fx: float = 0.0, cx: float = 0.0, firmware: str | None = None, date: str = ""
) -> Entry:
    """The same camera calibrated again."""
    calibration = entry.calibration
    K = calibration.intrinsics
    made = replace(calibration.provenance, firmware=firmware, date=date or "2026-06-03", source="lab-2.xml")
    moved = replace(K, fx=K.fx + fx, fy=K.fy + fx, cx=K.cx + cx)
    return replace(entry, calibration=replace(calibration, intrinsics=moved, provenance=made))


P4R = an_entry(quality=measured(), provenance=replace(FILE, firmware="01.08"))
DRIFTED = later(P4R, fx=4.1, cx=0.6, firmware="01.09")
SETTLED = later(DRIFTED, fx=0.25, firmware="01.09", date="2026-09-20")
SWAPPED = replace(LENS, p1=LENS.p2, p2=LENS.p1)
FISHEYE = an_entry(
    model="One Fish",
    make="Example",
    focal_mm=1.8,
    size=(1000, 1000),
    fx=300.0,
    distortion=KannalaBrandt(k1=0.02, k2=-0.01, k3=0.0, k4=0.0),
)
DRAFT = an_entry(
    model="FC330", focal_mm=3.61, size=(4000, 3000), fx=2290.0, distortion=None, status=Status.DRAFT
)
PERFECT = an_entry(
    make="Example", model="Flat", focal_mm=24.0, distortion=BrownConrady(k1=0, k2=0, p1=0, p2=0, k3=0)
)


def fleet(folder: Path) -> Registry:
    """A registry of eight cameras, one of them calibrated three times, one crossed, four with hostile names."""
    registry = Registry.open(init(folder).place)
    save(registry, [P4R, FISHEYE, DRAFT, PERFECT], "Import the laboratory's calibrations")
    save(registry, [hostile(name) for name in HOSTILE], "Add what a stranger sent")
    save(registry, [DRIFTED], "Calibrate anew", reason="firmware 01.09 came out")
    save(registry, [SETTLED], "Calibrate once more")
    save(registry, [replace(DRAFT, status=Status.APPROVED, reason="checked in the air")], "Approve the FC330")
    crossed = replace(PERFECT, calibration=replace(PERFECT.calibration, distortion=SWAPPED))
    save(registry, [crossed], "Put the lens in")
    return registry


def hostile(name: str) -> Entry:
    """A camera of that name, by an operator of that name."""
    entry = an_entry(
        make=name, model=f"M {name}", provenance=replace(FILE, operator=name, source=name, tool=name)
    )
    return replace(entry, calibration=replace(entry.calibration, notes=(name,)), reason=name)


def save(registry: Registry, entries: Sequence[Entry], subject: str, *, reason: str | None = None) -> None:
    """Write entries as one commit, over what stands there."""
    current = registry.snapshot().cameras
    put_entries(
        registry,
        [(entry, current.get(entry.path)) for entry in entries],
        message_of(subject, entries, reason),
    )
