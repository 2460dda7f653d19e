"""OpenSfM's cameras: ``camera_models.json``, ``camera_models_overrides.json`` and ``reconstruction.json``.

In the format's own words, the first two::

    {"v2 dji fc6310 5472 3648 brown 0.6666":
       {"projection_type": "brown", "width": 5472, "height": 3648, "focal_x": 0.667, "focal_y": 0.667,
        "c_x": 0.001, "c_y": -0.002, "k1": -0.01, "k2": 0.02, "p1": 0.0003, "p2": -0.0008, "k3": -0.01}}

and the third ``[{"cameras": {…the same…}, "shots": {…}, "points": {…}}, …]``. The projection types are in
:mod:`calibrary.parsers.opensfm_models`. OpenSfM begins its names with "v2 ", which distinguishes them from those of
ODM's ``cameras.json``. In an overrides file the name "all" means every camera.

Only a reconstruction is certain to have been adjusted: ``camera_models.json`` contains what it starts from. A file
whose name begins with "reconstruction" is written as one, without shots and points.

Sources: OpenSfM, ``opensfm/io.py``; its documentation, "Dataset Structure".
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

from calibrary.calibration import Calibration
from calibrary.distortion import BrownConrady, Fisheye624, KannalaBrandt, NoDistortion
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.document import Node
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, UnknownLens, WriteContext
from calibrary.parsers.formats._json_text import Writable, dumped, loaded
from calibrary.parsers.formats._opensfm import (
    NAME,
    Named,
    camera_names,
    cameras,
    fresh,
    is_full_name,
    plain_name,
    written,
)
from calibrary.parsers.opensfm_models import CONVENTION
from calibrary.records import Json

EVERY_CAMERA = "all"


def sniff(content: Content) -> Sniff | None:
    """Cameras with a projection type, in a list of reconstructions or under names that are not ODM's."""
    names = camera_names(content.json)
    if names and not all(is_full_name(name) and name == plain_name(name) for name in names):
        return Sniff(
            Sure.MAGIC, f"JSON object of cameras with a projection_type, the first {names[0][:40]!r}"
        )
    head = content.text or ""
    if content.first_line.startswith("[") and '"cameras"' in head and '"projection_type"' in head:
        return Sniff(Sure.MAGIC, "JSON list with cameras that have a projection_type")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera, in order; of a reconstruction's, those that differ."""
    document = loaded(data, context)
    if isinstance(document.value, list):
        return cameras(list(_reconstructed(document)), context, adjusted=True)
    found = [(name, node, None) for name, node in document.entries()]
    return cameras(found, context, adjusted=False)


def write(calibrations: Sequence[Calibration], context: WriteContext) -> bytes:
    """The cameras under the names they came with, else under their sub-camera's, else as "all"."""
    models: dict[str, Writable] = {}
    for index, item in enumerate(calibrations):
        name = dict(item.extras).get(NAME) or item.camera.sub_camera
        name = name or (EVERY_CAMERA if len(calibrations) == 1 else f"camera {index + 1}")
        name = f"v2 {name}" if is_full_name(name) else name
        models[fresh(name, models)] = written(item)
    if context.name.lower().startswith("reconstruction"):
        return dumped([{"cameras": models, "shots": {}, "points": {}}])
    return dumped(models)


def _reconstructed(document: Node) -> Iterator[Named]:
    """The cameras of every reconstruction; one that is the same in two is given once."""
    seen: dict[str, list[Json]] = {}
    for number, reconstruction in enumerate(document.items(), start=1):
        views = _views(reconstruction.get("shots"))
        for name, node in reconstruction["cameras"].entries():
            before = seen.setdefault(name, [])
            if node.value in before:
                continue
            before.append(node.value)
            label = name if len(before) == 1 else f"{name} (reconstruction {number})"
            yield label, node, views[name]


def _views(shots: Node | None) -> Counter[str]:
    """How many shots each camera has; there may be hundreds of thousands, so no path is kept to each."""
    if shots is None or not isinstance(shots.value, dict):
        return Counter()
    names = (shot.get("camera") for shot in shots.value.values() if isinstance(shot, dict))
    return Counter(name for name in names if isinstance(name, str))


FORMAT = Format(
    name="opensfm",
    title="OpenSfM cameras",
    suffixes=(".json",),
    syntaxes=(Syntax.JSON,),
    reference="https://opensfm.org/docs/dataset.html",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(
        models=(NoDistortion, BrownConrady, KannalaBrandt, Fisheye624),
        several_cameras=True,
        unknown_lens=UnknownLens.FREE,
    ),
)
