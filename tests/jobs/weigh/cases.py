"""Labelled cases: images of a camera beside a calibration file, and a registry; what every command must answer."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from tests.jobs.extract.fleet import DEWARP, picture

SIZE = (1200, 800)


class Family(NamedTuple):
    """Images of one camera.

    Attributes:
        name: of the family.
        fx: the focal length that is right, px.
        size: of the images.
        tags: of each image.
        tells_to: how closely the images tell the focal length, as a fraction; infinite for not at all.
    """

    name: str
    fx: float
    size: tuple[int, int]
    tags: dict[str, Any]
    tells_to: float = 0.05


FAMILIES = (
    # Published for this lens: 1322 px; its nominal 24 mm over the listed 22.3 mm is 2.3 % less.
    Family("listed", 1322.0, SIZE, {"make": "Canon", "model": "Canon EOS 600D", "focal_mm": (24, 1)}),
    Family("known", 3657.0, (5472, 3648), {"make": "DJI", "model": "FC6310R", "focal_mm": (88, 10)}),
    Family(
        "measured",
        3660.5,
        (5472, 3648),
        {"make": "DJI", "model": "FC6310R", "focal_mm": (88, 10), "focal_35mm": 24, "dewarp": DEWARP},
    ),
    Family(
        "equivalent",
        26 / 43.2666 * 5000.0,
        (4000, 3000),
        {"make": "Example", "model": "Phone", "focal_mm": (43, 10), "focal_35mm": 26},
        tells_to=0.12,
    ),
    Family("silent", 1322.0, SIZE, {}, tells_to=math.inf),
)


class Beside(NamedTuple):
    """A calibration file.

    Attributes:
        name: of the case.
        scale: its fx divided by the right one.
        is_right: whether it may be used.
        key: OpenSfM's name of its camera; None for a file that names no camera.
    """

    name: str
    scale: float
    is_right: bool
    key: str | None = None


FILES = (
    Beside("right", 1.0, is_right=True),
    Beside("one-per-cent-off", 1.01, is_right=True),
    Beside("tenth-more", 1.10, is_right=False),
    Beside("tenth-less", 0.90, is_right=False),
    Beside("35-mm-for-24", 35 / 24, is_right=False),
    Beside("half", 0.5, is_right=False),
    Beside("another-model", 1.0, is_right=False, key="v2 ricoh gr"),
)


class Case(NamedTuple):
    """Images and the file beside them."""

    family: Family
    file: Beside

    @property
    def name(self) -> str:
        """Of the test."""
        return f"{self.family.name}-{self.file.name}"

    def lay_out(self, folder: Path) -> Path:
        """Write the images and, beside them, the file."""
        family, (width, height) = self.family, self.family.size
        for number in (1, 2):
            picture(folder / f"IMG_{number}.jpg", family.size, **family.tags)
        focal = family.fx * self.file.scale
        if self.file.key is not None:
            key = f"{self.file.key} {width} {height} perspective {focal / width:.4f}"
            camera = {"projection_type": "perspective", "width": width, "height": height}
            model = {"focal": focal / width, "k1": -0.1, "k2": 0.02}
            (folder / "cameras.json").write_text(json.dumps({key: camera | model}))
            return folder / "cameras.json"
        path = folder / "camera.xml"
        # Metashape's f is fy, and b1 is fx − fy; p1 and p2 stand in its own order.
        own = "<b1>5.25</b1><k1>-0.268</k1><k2>0.112</k2><k3>-0.034</k3><p1>-0.0001</p1><p2>0.0008</p2>"
        lens = own if "dewarp" in family.tags else "<k1>-0.1</k1>"
        focal -= 5.25 if "dewarp" in family.tags else 0.0
        path.write_text(
            f"<calibration><projection>frame</projection><width>{width}</width><height>{height}</height>"
            f"<f>{focal}</f><cx>-4.5</cx><cy>22.75</cy>{lens}</calibration>"
        )
        return path


def cases() -> Iterator[Case]:
    """All of them but those that contradict nothing: silent images name no model."""
    for family in FAMILIES:
        for file in FILES:
            if family.tags or file.key is None:
                yield Case(family, file)
