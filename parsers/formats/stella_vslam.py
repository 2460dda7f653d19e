"""stella_vslam's settings, OpenVSLAM's before it: a camera among the program's own numbers.

In the format's own words::

    Camera:
      name: "EuRoC monocular"
      setup: "monocular"            # stereo, RGBD
      model: "perspective"          # fisheye, radial_division, equirectangular
      fx: 458.654
      fy: 457.296
      cx: 367.215
      cy: 248.375
      k1: -0.2834                   # perspective: k1, k2, p1, p2, k3; fisheye: k1, k2, k3, k4
      …                             # radial_division: distortion
      fps: 20.0
      cols: 752
      rows: 480

OpenVSLAM's older files have the same names flat, ``Camera.model`` and so on. The program hands perspective and
fisheye to OpenCV; radial_division sees (x', y', 1 + distortion·r'²), Fitzgibbon's division model. An equirectangular
panorama has no K.

Source: stella_vslam, ``src/stella_vslam/camera/{base,perspective,fisheye,radial_division}.cc``.
"""

from __future__ import annotations

import json
from collections.abc import Sequence

from calibrary.calibration import Calibration
from calibrary.distortion import BrownConrady, Distortion, Division, KannalaBrandt, NoDistortion
from calibrary.errors import UnsupportedModelError
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, WriteContext
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._json_text import restored
from calibrary.parsers.formats._one_camera import camera, fisheye, refuse_model
from calibrary.parsers.formats._opencv_lens import lens
from calibrary.parsers.formats._yaml_text import decimal, scalar
from calibrary.records import replace

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    remarks=("coefficients are named; fisheye's four are k1, k2, k3, k4",),
)
BLOCK = "Camera"
LENSES = {
    "perspective": ("k1", "k2", "p1", "p2", "k3"),
    "fisheye": ("k1", "k2", "k3", "k4"),
    "radial_division": ("distortion",),
}
PLACE = ("fx", "fy", "cx", "cy")
OWN_KEYS = frozenset({"model", *PLACE, "cols", "rows", *(key for keys in LENSES.values() for key in keys)})
PREFIX = "stella_vslam/"
NEEDED = {"name": json.dumps("camera"), "setup": json.dumps("monocular"), "fps": "30.0"}
"""What the program does not start without; it has no bearing on the camera."""


def sniff(content: Content) -> Sniff | None:
    """A block Camera with a model and a setup, or OpenVSLAM's flat keys."""
    keys = content.yaml_keys
    if "Camera.model" in keys:
        return Sniff(Sure.MAGIC, "the key Camera.model")
    if BLOCK not in keys:
        return None
    nested = {line.partition(":")[0] for line in content.lines}
    if {"model", "setup", "cols", "rows"} <= nested:
        return Sniff(Sure.MAGIC, "the key Camera with model, setup, cols and rows under it")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera of the settings."""
    tree = storage.load(data, source=context.name)
    if BLOCK in tree:
        node = tree[BLOCK]
    else:
        flat = {
            key.removeprefix(f"{BLOCK}."): child.value
            for key, child in tree.entries()
            if key.startswith(BLOCK)
        }
        node = Node(flat, source=context.name, place=BLOCK)
    model = node["model"].text()
    if model == "equirectangular":
        raise UnsupportedModelError(
            "the images are equirectangular panoramas, each pixel an angle, and no K describes them",
            place=node["model"].place,
        )
    if model not in LENSES:
        refuse_model(model, tuple(LENSES), place=node["model"].place)
    size = node.image_size("cols", "rows")
    fx, fy, cx, cy = (node[key].number() for key in PLACE)
    values = [node[key].number() for key in LENSES[model]]
    item = camera(
        context, CONVENTION, Native(fx=fx, fy=fy, cx=cx, cy=cy), size, _lens(model, values), tag=BLOCK
    )
    kept = ((key, child) for key, child in node.entries() if key not in OWN_KEYS)
    return [
        replace(
            item,
            extras=tuple((PREFIX + key, json.dumps(child.value, ensure_ascii=False)) for key, child in kept),
        )
    ]


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """The block Camera; the program's other blocks have defaults. The size comes last and makes it complete."""
    [calibration] = calibrations
    K, distortion = calibration.intrinsics, calibration.distortion or NoDistortion()
    native = CONVENTION.native(K)
    extras = {key.removeprefix(PREFIX): text for key, text in calibration.extras if key.startswith(PREFIX)}
    rows = [(key, scalar(restored(text))) for key, text in (NEEDED | extras).items()]
    if isinstance(distortion, KannalaBrandt):
        model, coefficients = "fisheye", distortion.coefficients
    elif isinstance(distortion, Division):
        model, coefficients = "radial_division", {"distortion": distortion.k}
    else:
        zeros = dict.fromkeys(LENSES["perspective"], 0.0)
        model, coefficients = "perspective", {**zeros, **distortion.coefficients}
    rows.append(("model", json.dumps(model)))
    rows += [(key, decimal(getattr(native, key))) for key in PLACE]
    rows += [(key, decimal(coefficients[key])) for key in LENSES[model]]
    rows += [("cols", str(K.image_size[0])), ("rows", str(K.image_size[1]))]
    return (f"{BLOCK}:\n" + "".join(f"  {key}: {value}\n" for key, value in rows)).encode()


def _lens(model: str, values: Sequence[float]) -> Distortion:
    if model == "fisheye":
        return fisheye(values)
    if model == "radial_division":
        return Division(k=values[0]) if values[0] else NoDistortion()
    return lens(values)


FORMAT = Format(
    name="stella_vslam",
    title="stella_vslam and OpenVSLAM settings",
    suffixes=(".yaml", ".yml"),
    syntaxes=(Syntax.TEXT,),
    reference="https://stella-cv.readthedocs.io/en/latest/parameters.html",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(models=(NoDistortion, BrownConrady, KannalaBrandt, Division)),
    idle=("Camera.k1", "Camera.k2", "Camera.k3", "Camera.k4", "Camera.p1", "Camera.p2", "Camera.distortion"),
)
