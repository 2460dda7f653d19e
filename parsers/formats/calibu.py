"""Calibu's camera rigs (``cameras.xml``), which vicalib writes.

In the format's own words::

    <rig>
      <camera>
        <camera_model name="" index="0" serialno="0" type="calibu_fu_fv_u0_v0_k1_k2_k3" version="8">
          <width> 640 </width>
          <height> 480 </height>
          <params> [ 433.2; 432.9; 371.6; 238.3; -0.21; 0.04; 0 ] </params>
        </camera_model>
        <pose> … </pose>
      </camera>
    </rig>

The type lists the parameters: none after u0 v0 is a pinhole, k1 k2 k3 are factors of r², r⁴ and r⁶, w is the FOV
model's angle and kb4 Kannala and Brandt's four. Where u0 and v0 count from is not stated; vicalib's corners are those
of OpenCV's pixels.

Source: Calibu, ``include/calibu/cam/camera_models_*.h`` and ``src/cam/camera_xml.cpp``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from calibrary.calibration import Calibration
from calibrary.distortion import Distortion, FieldOfView, NoDistortion
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, Tangential
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._one_camera import camera, fisheye, refuse_model
from calibrary.parsers.formats._opencv_lens import lens
from calibrary.parsers.xml import parse_xml

if TYPE_CHECKING:
    from lxml.etree import _Element

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    tangential=Tangential.NONE,
    coefficients=("k1", "k2", "k3"),
    remarks=("the model's type lists its parameters", "the origin is not stated; OpenCV's is used"),
)
TYPES = {
    "calibu_fu_fv_u0_v0": 0,
    "calibu_fu_fv_u0_v0_w": 1,
    "calibu_fu_fv_u0_v0_k1_k2": 2,
    "calibu_fu_fv_u0_v0_k1_k2_k3": 3,
    "calibu_fu_fv_u0_v0_kb4": 4,
}
"""How many numbers follow fu, fv, u0 and v0."""
OPENCV = "Calibu does not state where u0 and v0 count from; the centre of the top-left pixel was taken"
MAX_BYTES = 1024 * 1024
MAX_CAMERAS = 1000


def sniff(content: Content) -> Sniff | None:
    """A camera_model with params."""
    if {"camera_model", "params"} <= set(content.xml_tags):
        return Sniff(Sure.MAGIC, "XML with <camera_model> and <params>")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera of the rig, in order."""
    root = parse_xml(data, source=context.name, max_bytes=MAX_BYTES)
    models = list(root.iter("camera_model"))
    if len(models) > MAX_CAMERAS:
        raise ParseError(f"{len(models)} cameras, expected at most {MAX_CAMERAS}")
    several = len(models) > 1
    return [_camera(model, context, f"camera {i}" if several else None) for i, model in enumerate(models)]


def _camera(model: _Element, context: ReadContext, name: str | None) -> Calibration:
    kind = model.get("type", "")
    if kind not in TYPES:
        refuse_model(kind, tuple(TYPES), place=name)
    width, height = (strict.number(_text(model, key), place=key) for key in ("width", "height"))
    params = _text(model, "params").strip().strip("[]").replace(";", " ")
    fx, fy, cx, cy, *rest = strict.numbers(params, count=4 + TYPES[kind], place="params")
    native = Native(fx=fx, fy=fy, cx=cx, cy=cy)
    size = strict.image_size(width, height)
    return camera(
        context, CONVENTION, native, size, _lens(kind, rest), name=name, tag=kind, assumptions=(OPENCV,)
    )


def _lens(kind: str, values: list[float]) -> Distortion:
    if kind.endswith("_kb4"):
        return fisheye(values)
    if kind.endswith("_w"):
        return FieldOfView(omega=values[0]) if values[0] else NoDistortion()
    k1, k2, k3 = (*values, 0.0, 0.0, 0.0)[:3]
    return lens((k1, k2, 0.0, 0.0, k3))


def _text(model: _Element, key: str) -> str:
    found = model.find(key)
    if found is None:
        raise ParseError(f"there is no <{key}>")
    return (found.text or "").strip()


FORMAT = Format(
    name="calibu",
    title="Calibu camera rig (vicalib)",
    suffixes=(".xml",),
    syntaxes=(Syntax.XML,),
    roots=("rig", "camera", "camera_model"),
    reference="https://github.com/arpg/Calibu",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
