"""Versions of the programs that took part in a calibration."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import Final

import numpy as np

_NAMES: Final = {"calibrary": "calibrary", "opencv": "OpenCV", "pycolmap": "pycolmap"}
"""Names of the programs in a provenance, by module."""
_MODULES: Final = {"cv2": "opencv"}


def versions_in_words(versions: Mapping[str, str]) -> str:
    """Return ``versions`` in the form of a provenance: ``calibrary 1.0.0, OpenCV 4.12.0``."""
    return ", ".join(f"{_NAMES[name]} {text}" for name, text in versions.items() if name in _NAMES)


def programs(*further: str) -> dict[str, str]:
    """Return the versions of the programs used.

    Args:
        further: modules in addition to numpy.
    """
    try:
        ours = version("calibrary")
    except PackageNotFoundError:
        ours = "unknown"
    others = {_MODULES.get(name, name): str(import_module(name).__version__) for name in further}
    return {"calibrary": ours, **others, "numpy": np.__version__}
