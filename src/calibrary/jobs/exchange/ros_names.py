"""Camera names for ROS: the driver's name of a camera determines which calibration file is loaded.

``camera_info_manager`` inserts that name into the URL (``file:///fleet/${NAME}.yaml``, ``resolveURL``),
accepts only letters, digits and underscores (``setCameraName``), and warns if the file states another
(``loadCalibrationFile``).
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Sequence
from typing import Final

from calibrary.calibration import Calibration
from calibrary.records import replace
from calibrary.registry.stored import StoredEntry

__all__ = ["ROS", "ros_names", "with_ros_name"]

ROS: Final = "ros_camera_info"
"""Name of the format."""


def ros_names(stored: Sequence[StoredEntry]) -> dict[str, str]:
    """Camera names by entry id: the label of a unit with a single entry, else the id."""
    labels = Counter(one.entry.label for one in stored)
    named = {one.id: one.entry.label if labels[one.entry.label] == 1 else None for one in stored}
    return {key: _plain(label or "") or _plain(key) for key, label in named.items()}


def with_ros_name(calibration: Calibration, name: str) -> Calibration:
    """The calibration with an extra that makes its ROS file state the name."""
    key = f"{ROS}/camera_name"
    others = (one for one in calibration.extras if one[0] != key)
    return replace(calibration, extras=(*others, (key, json.dumps(name))))


def _plain(text: str) -> str:
    return re.sub(r"[^0-9A-Za-z]+", "_", text).strip("_")
