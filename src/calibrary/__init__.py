"""The library of a fleet's camera calibrations: derives, validates and keeps K, one per camera.

>>> from calibrary import extract_intrinsic_matrix
>>> K, report = extract_intrinsic_matrix("DJI_0001.JPG", 13.2, 8.8)          # doctest: +SKIP
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance, Quality
    from calibrary.errors import CalibraryError
    from calibrary.jobs.extract.minimal import extract_intrinsic_matrix
    from calibrary.policy import FLEET, SOURCE, Policy
    from calibrary.validation import Report, Verdict, validate

__all__ = [
    "FLEET",
    "SOURCE",
    "CalibraryError",
    "Calibration",
    "CameraKey",
    "Grade",
    "Intrinsics",
    "Policy",
    "Provenance",
    "Quality",
    "Report",
    "Verdict",
    "extract_intrinsic_matrix",
    "validate",
]

_HOMES = {
    "calibrary.calibration": ("Calibration", "CameraKey", "Grade", "Intrinsics", "Provenance", "Quality"),
    "calibrary.errors": ("CalibraryError",),
    "calibrary.jobs.extract.minimal": ("extract_intrinsic_matrix",),
    "calibrary.policy": ("FLEET", "SOURCE", "Policy"),
    "calibrary.validation": ("Report", "Verdict", "validate"),
}


def __getattr__(name: str) -> object:
    """Import a public name when it is first asked for: ``import calibrary`` alone costs next to nothing."""
    for module, names in _HOMES.items():
        if name in names:
            return getattr(import_module(module), name)
    raise AttributeError(f"module 'calibrary' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
