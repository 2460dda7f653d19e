"""A library of the camera calibrations of a fleet: derive, validate and store one K per camera.

Functions: ``read`` and ``read_all`` a file or an image, ``write`` and ``refit`` for another program, ``extract`` and
``check`` the K of a flight, ``extract_intrinsic_matrix`` of one image, ``undistort`` an array, ``calibrate`` from a
board or a flight, ``compare`` and ``validate`` calibrations, ``open_registry``. help(calibrary.read) explains one.

>>> camera = calibrary.read("camera.xml")
>>> K, dist = camera.to_opencv()
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from calibrary.calib.corners_arrays import Corners
    from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance, Quality
    from calibrary.errors import CalibraryError
    from calibrary.jobs.calibrate import calibrate
    from calibrary.jobs.calibrate.report import CalibrateReport
    from calibrary.jobs.check import check
    from calibrary.jobs.check.run import CheckReport
    from calibrary.jobs.diff import compare
    from calibrary.jobs.extract import extract
    from calibrary.jobs.extract.intrinsic_matrix import extract_intrinsic_matrix
    from calibrary.jobs.extract.report import ExtractReport
    from calibrary.jobs.files import read, read_all, refit, write
    from calibrary.jobs.fleet import Fleet, open_registry
    from calibrary.jobs.resolve.run import FleetAnswer
    from calibrary.jobs.undistort.arrays import undistort
    from calibrary.policy import FLEET, SOURCE, Policy
    from calibrary.validation import Report, Verdict, validate
    from calibrary.version import __version__

__all__ = [
    "FLEET",
    "SOURCE",
    "CalibraryError",
    "CalibrateReport",
    "Calibration",
    "CameraKey",
    "CheckReport",
    "Corners",
    "ExtractReport",
    "Fleet",
    "FleetAnswer",
    "Grade",
    "Intrinsics",
    "Policy",
    "Provenance",
    "Quality",
    "Report",
    "Verdict",
    "__version__",
    "calibrate",
    "check",
    "compare",
    "extract",
    "extract_intrinsic_matrix",
    "open_registry",
    "read",
    "read_all",
    "refit",
    "undistort",
    "validate",
    "write",
]

_HOMES = {
    "calibrary.calib.corners_arrays": ("Corners",),
    "calibrary.jobs.files": ("read", "read_all", "refit", "write"),
    "calibrary.calibration": ("Calibration", "CameraKey", "Grade", "Intrinsics", "Provenance", "Quality"),
    "calibrary.errors": ("CalibraryError",),
    "calibrary.jobs.resolve.run": ("FleetAnswer",),
    "calibrary.jobs.check": ("check",),
    "calibrary.jobs.check.run": ("CheckReport",),
    "calibrary.jobs.diff": ("compare",),
    "calibrary.jobs.extract": ("extract",),
    "calibrary.jobs.extract.report": ("ExtractReport",),
    "calibrary.jobs.extract.intrinsic_matrix": ("extract_intrinsic_matrix",),
    "calibrary.jobs.calibrate": ("calibrate",),
    "calibrary.jobs.calibrate.report": ("CalibrateReport",),
    "calibrary.jobs.fleet": ("Fleet", "open_registry"),
    "calibrary.jobs.undistort.arrays": ("undistort",),
    "calibrary.policy": ("FLEET", "SOURCE", "Policy"),
    "calibrary.validation": ("Report", "Verdict", "validate"),
    "calibrary.version": ("__version__",),
}


if not TYPE_CHECKING:  # a type checker must report a name that does not exist

    def __getattr__(name: str) -> object:
        """Import a public name on first use, so that ``import calibrary`` alone is fast."""
        for module, names in _HOMES.items():
            if name in names:
                return getattr(import_module(module), name)
        raise AttributeError(f"module 'calibrary' has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
