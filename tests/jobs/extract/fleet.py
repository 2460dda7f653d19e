"""Images, folders and registries for the gate, and short ways to send them through it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from calibrary.catalogue import Catalogue
from calibrary.evidence.metadata import ImageMetadata
from calibrary.jobs.extract import Program
from calibrary.jobs.extract.cameras import ASSUMED, Camera, Sensor, group_cameras
from calibrary.jobs.extract.extraction import JudgedCamera
from calibrary.jobs.extract.judging import judge, judge_image
from calibrary.jobs.extract.knowledge import Knowledge
from calibrary.jobs.extract.outputs import Wanted
from calibrary.jobs.extract.report import ExtractReport
from calibrary.jobs.extract.run import run
from calibrary.jobs.images.accumulator import undated
from calibrary.policy import FLEET, Policy
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.init import init
from calibrary.registry.registry import Registry
from tests.evidence.scenes import M3T_THERMAL, M3T_WIDE, P4_RTK, PHANTOM_3, SKYDIO_2
from tests.imagery import ExifTags, Namespace, XmpDescription, XmpPacket, attributes, write_jpeg
from tests.imagery.jpeg import Segment
from tests.registry.entries import put_entries

DJI = Namespace("drone-dji", "http://www.dji.com/drone-dji/1.0/")
DEWARP = "2019-03-05;3660.5,3655.25,-4.5,22.75,-0.268,0.112,0.0008,-0.0001,-0.034"
P4R: dict[str, Any] = {"make": "DJI", "model": "FC6310R", "focal_mm": (88, 10)}
"""What a Phantom 4 RTK writes into EXIF; ``dewarp=DEWARP`` adds this unit's calibration."""
NOBODY: dict[str, Any] = {"make": "Example", "model": "One", "focal_mm": (132, 10)}
"""A camera in no catalogue, whose focal length over the default sensor is 1.0 W, within the band."""

PLANE: dict[str, Any] = {"focal_plane_resolution": ((300, 1), (300, 1)), "focal_plane_unit": 4}
"""A sensor of 18.24 mm for 5472 px, which no equivalent of 24 mm of a lens of 60 mm fits."""

KNOWLEDGE = Knowledge(catalogue=Catalogue([P4_RTK, M3T_WIDE, M3T_THERMAL, PHANTOM_3, SKYDIO_2]))


def picture(
    path: Path, size: tuple[int, int] = (5472, 3648), *, dewarp: str | None = None, **tags: Any
) -> Path:
    """A JPEG with these EXIF tags; names with a colon in them, ``drone_dji:…``, are XMP."""
    xmp = {name.partition(":")[2]: tags.pop(name) for name in list(tags) if ":" in name}
    if dewarp is not None:
        xmp["DewarpData"] = dewarp
    packet = XmpPacket(descriptions=(XmpDescription(items=attributes(DJI, **xmp)),)) if xmp else None
    # As DJI's thermal cameras do, with a second image, of which only the segment matters here.
    second = (Segment(0xE2, b"MPF\0"),) if max(size) <= 1280 and tags.get("make") == "DJI" else ()
    return write_jpeg(path, size, exif=ExifTags(**tags) if tags else None, xmp=packet, segments=second)


def gate(directory: Path, **request: Any) -> ExtractReport:
    """The gate's outcome for a folder."""
    return run(directory, **request)


def plan(found: ExtractReport, out: Path, to: Program | None = None, **wanted: Any) -> ExtractReport:
    """The report with the files that would be written."""
    return Wanted(out=out, to=to, **wanted).plan(found)


def only(outcome: ExtractReport) -> JudgedCamera:
    """The one camera of a run."""
    [camera] = outcome.judged
    return camera


def judged(
    states: Mapping[ImageMetadata, Sequence[str]], *, policy: Policy = FLEET, sensor: Sensor = ASSUMED
) -> list[Camera]:
    """Cameras of images that need no file."""
    groups = group_cameras(undated(states), KNOWLEDGE)
    return [
        camera for key, group in groups.items() for camera in judge(key, group, policy=policy, sensor=sensor)
    ]


def judge_known(metadata: ImageMetadata) -> Camera:
    """The camera of one image that needs no file, by the shipped catalogue."""
    found = judge_image(metadata, "a.jpg", FLEET)
    assert found is not None
    return found


def matrix(path: Path, fx: float, cx: float = 2736.0, cy: float = 1824.0, *, fy: float | None = None) -> Path:
    """A K in a .npy file."""
    np.save(path, np.array([[fx, 0, cx], [0, fx if fy is None else fy, cy], [0, 0, 1.0]]))
    return path


def files(registry: Path) -> Path:
    """The registry that the files in a folder are, without git."""
    return Path(f"folder:{registry}")


def in_git(folder: Path, *entries: Entry) -> Path:
    """A registry in git with entries: those in use, and what is proposed."""
    registry = Registry.open(folder if folder.exists() else init(folder).place)
    there = registry.snapshot().cameras
    put_entries(registry, [(one, there.get(one.path)) for one in entries], "Put\n")
    return folder


def stated(registry: Path, **fields: Any) -> Entry:
    """What the file of :func:`entry` says."""
    return parse_entry(entry(registry, **fields).read_bytes(), "entry", require_digest=False)


def entry(registry: Path, *, fx: float = 3661.25, **fields: Any) -> Path:
    """A registry entry of a Phantom 4 RTK, at the path of its camera; ``fields`` with None are left out of it."""
    width, height = fields.pop("image_size", (5472, 3648))
    camera = {"make": "DJI", "model": "FC6310R"} | fields
    stated = "".join(f"  {key}: {value}\n" for key, value in camera.items() if value is not None)
    text = (
        f"schema: calibrary/entry-1\ncamera:\n{stated}  image_size: [{width}, {height}]\n"
        f"intrinsics: {{pixel_origin: corner, fx: {fx}, fy: {fx}, cx: {width / 2}, cy: {height / 2}}}\n"
        "distortion: {model: brown, k1: -0.26, k2: 0.11, p1: 0.0, p2: 0.0, k3: -0.03}\ngrade: calibrated\n"
    )
    path = registry / parse_entry(text.encode(), "entry", require_digest=False).path
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return path
