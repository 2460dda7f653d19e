"""ODM's and WebODM's ``cameras.json``: OpenSfM's cameras, to be used again with ``--cameras``.

In the format's own words::

    {"dji fc6310 5472 3648 brown 0.6666":
       {"projection_type": "brown", "width": 5472, "height": 3648, "focal_x": 0.667, "focal_y": 0.667,
        "c_x": 0.001, "c_y": -0.002, "k1": -0.01, "k2": 0.02, "p1": 0.0003, "p2": -0.0008, "k3": -0.01}}

The projection types are in :mod:`calibrary.parsers.opensfm_models`. ODM refuses a name of fewer than six words, removes
OpenSfM's "v2 ", which distinguishes the two, and matches cameras by the rest. It does not find a camera under a name
that OpenSfM would not have given it. On reading it deletes every coefficient except k1, k2, p1, p2 and k3, so calibrary
writes no fisheye with four.

Source: ODM, ``opendm/camera.py``.
"""

from __future__ import annotations

from collections.abc import Sequence

from calibrary.calibration import Calibration
from calibrary.distortion import BrownConrady, NoDistortion
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, UnknownLens, WriteContext
from calibrary.parsers.formats._json_text import Writable, dumped, loaded
from calibrary.parsers.formats._opensfm import (
    NAME,
    camera_names,
    cameras,
    fresh,
    is_full_name,
    plain_name,
    written,
)
from calibrary.parsers.opensfm_models import CONVENTION


def sniff(content: Content) -> Sniff | None:
    """Cameras with a projection type, under OpenSfM's names without their mark."""
    names = camera_names(content.json)
    if names and all(is_full_name(name) and name == plain_name(name) for name in names):
        return Sniff(
            Sure.MAGIC, f"JSON object of cameras with a projection_type, the first {names[0][:40]!r}"
        )
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera, in order."""
    found = [(name, node, None) for name, node in loaded(data, context).entries()]
    return cameras(found, context, adjusted=False)


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """The cameras under the names they came with, else under one that OpenSfM gives where EXIF has no focal length."""
    models: dict[str, Writable] = {}
    for item in calibrations:
        camera = written(item)
        name = _name(item, str(camera["projection_type"]))
        models[fresh(name, models)] = camera
    return dumped(models)


def _name(item: Calibration, projection: str) -> str:
    key = item.camera
    kept = dict(item.extras).get(NAME) or key.sub_camera or ""
    if is_full_name(kept):
        return kept
    width, height = item.intrinsics.image_size
    model = " ".join(part for part in (key.model or "unknown", kept) if part)
    return f"{key.make or 'unknown'} {model} {width} {height} {projection} 0.0".lower()


FORMAT = Format(
    name="odm_cameras",
    title="ODM cameras.json",
    suffixes=(".json",),
    syntaxes=(Syntax.JSON,),
    reference="https://docs.opendronemap.org/arguments/cameras/",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(
        models=(NoDistortion, BrownConrady), several_cameras=True, unknown_lens=UnknownLens.FREE
    ),
)
