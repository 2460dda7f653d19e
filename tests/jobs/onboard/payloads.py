"""Folders as they come with a new payload, of cameras that nobody owns."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from calibrary.cli.main import main
from calibrary.schemas import require
from tests.cli.registry.fleets import xml
from tests.jobs.extract.fleet import DEWARP, picture

SURVEY: dict[str, Any] = {
    "make": "Example",
    "model": "Survey One",
    "focal_mm": (10, 1),
    "focal_35mm": 26,
    "software": "v1.2.0",
    "body_serial": "EX-0042-77",
    "focal_plane_resolution": ((9697, 100), (9697, 100)),
    "focal_plane_unit": 4,
}
"""A camera in no catalogue: 10 mm over 10.3 µm pixels is 969.7 px."""
PHANTOM: dict[str, Any] = {
    "make": "DJI",
    "model": "FC6310R",
    "focal_mm": (88, 10),
    "focal_35mm": 24,
    "software": "v01.09.1691",
    "body_serial": "f41c07aa9e",
}


def survey(folder: Path, f: float = 968.0, **tags: Any) -> Path:
    """Flight images of the made-up camera, and its calibration as Metashape exports it."""
    for number in range(2):
        (folder / "flight" / "100_0001").mkdir(parents=True, exist_ok=True)
        picture(folder / "flight" / "100_0001" / f"IMG_{number:04}.jpg", (1280, 960), **{**SURVEY, **tags})
    (folder / "papers").mkdir(exist_ok=True)
    xml(folder / "papers" / "camera.xml", f, (1280, 960), 4.5)
    (folder / "papers" / "invoice.txt").write_text("one camera, with thanks")
    return folder


def phantom(folder: Path, **tags: Any) -> Path:
    """Flight images of a Phantom 4 RTK with its own calibration in them."""
    folder.mkdir(parents=True, exist_ok=True)
    picture(folder / "DJI_0001.JPG", **{**PHANTOM, "dewarp": DEWARP, **tags})
    return folder


def onboard(
    capsys: pytest.CaptureFixture[str], folder: Path, *flags: str, page: Path | None = None
) -> tuple[int, str, str]:
    """The exit code of ``calibrary onboard …``, and what it said on both streams."""
    html = page or folder.parent / "onboard.html"
    capsys.readouterr()
    code = main(["onboard", str(folder), "--html", str(html), *flags])
    said = capsys.readouterr()
    return code, said.out, said.err


def document(capsys: pytest.CaptureFixture[str], folder: Path, *flags: str) -> Any:
    """What it prints with ``--json``, once the schema has let it through."""
    _, out, _ = onboard(capsys, folder, *flags, "--yes", "--json")
    found = json.loads(out)
    require(found, "onboard-1")
    return found
