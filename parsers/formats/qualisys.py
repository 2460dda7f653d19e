"""Qualisys Track Manager's camera calibration (``.qca.txt``, XML), which Theia Markerless and Pose2Sim share.

In the format's own words::

    <calibration type="regular" …>
      <cameras>
        <camera active="1" serial="26580" model="Miqus Video" viewrotation="0">
          <transform x="4263.3" … r33="1"/>
          <intrinsic focallength="9.27" sensorMinU="0" sensorMaxU="122879" sensorMinV="0" sensorMaxV="69631"
            focalLengthU="107872.6" focalLengthV="107880.3" centerPointU="60827.3" centerPointV="32684.0" skew="0"
            radialDistortion1="-0.0454" radialDistortion2="0.1396" radialDistortion3="0"
            tangentalDistortion1="0.0006" tangentalDistortion2="-0.0004"/>

Lengths are in 64ths of a pixel, from 0 at the image's edge to 64 times the number of pixels; sensorMax is the last of
them. "tangental" is the program's own spelling. The direction and the order of the distortion are not published.
calibrary uses those of OpenCV, as the converters of Theia and Pose2Sim do.

Sources: Qualisys, "Real-time server protocol", settings of the calibration; Theia Markerless, "Camera calibration";
Pose2Sim, ``Utilities/calib_toml_to_qca.py``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from calibrary.calibration import Calibration
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._one_camera import camera
from calibrary.parsers.formats._opencv_lens import lens
from calibrary.parsers.xml import parse_xml
from calibrary.records import replace

if TYPE_CHECKING:
    from lxml.etree import _Element

CONVENTION = Convention(
    origin=Origin.CORNER,
    coefficients=("k1", "k2", "k3", "p1", "p2"),
    remarks=(
        "lengths are in 64ths of a pixel",
        "the direction of the distortion is not published; OpenCV's is used",
    ),
)
PER_PIXEL = 64.0
LENS = (
    "radialDistortion1",
    "radialDistortion2",
    "tangentalDistortion1",
    "tangentalDistortion2",
    "radialDistortion3",
)
OPENCV = "Qualisys does not publish the lens's formula nor its origin; OpenCV's and the edge of the image were taken"
MAX_BYTES = 4 * 1024 * 1024
MAX_CAMERAS = 1000


def sniff(content: Content) -> Sniff | None:
    """An intrinsic element with the program's own spelling."""
    if "intrinsic" in content.xml_tags and "tangentalDistortion1=" in (content.text or ""):
        return Sniff(Sure.MAGIC, "XML with <intrinsic … tangentalDistortion1=…>")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera, by its serial."""
    root = parse_xml(data, source=context.name, max_bytes=MAX_BYTES)
    found = [(each, lens) for each in root.iter("camera") if (lens := each.find("intrinsic")) is not None]
    if len(found) > MAX_CAMERAS:
        raise ParseError(f"{len(found)} cameras, expected at most {MAX_CAMERAS}")
    names = [element.get("serial", "") or f"camera {index}" for index, (element, _) in enumerate(found)]
    if len(set(names)) != len(names):
        raise ParseError("two cameras have the same serial")
    several = len(found) > 1
    return [
        _camera(element, lens, context, name, several=several)
        for (element, lens), name in zip(found, names, strict=True)
    ]


def _camera(
    element: _Element, intrinsic: _Element, context: ReadContext, name: str, *, several: bool
) -> Calibration:
    def number(key: str) -> float:
        return strict.number(intrinsic.get(key, ""), place=f"{name}, {key}")

    if number("skew"):
        raise UnsupportedModelError("skew is not 0, and its unit is not published", place=name)
    size = (number(f"sensorMax{axis}") - number(f"sensorMin{axis}") for axis in "UV")
    width, height = (float(round(side / PER_PIXEL)) for side in size)
    native = Native(
        fx=number("focalLengthU") / PER_PIXEL,
        fy=number("focalLengthV") / PER_PIXEL,
        cx=(number("centerPointU") - number("sensorMinU")) / PER_PIXEL,
        cy=(number("centerPointV") - number("sensorMinV")) / PER_PIXEL,
    )
    k1, k2, p1, p2 = (number(key) for key in LENS[:4])
    k3 = number(LENS[4]) if LENS[4] in intrinsic.attrib else 0.0
    item = camera(
        context,
        CONVENTION,
        native,
        strict.image_size(width, height, place=name),
        lens((k1, k2, p1, p2, k3)),
        name=name if several else None,
        tag=name,
        assumptions=(OPENCV,),
    )
    turned = element.get("viewrotation", "0")
    if turned in ("", "0"):
        return item
    note = f"the video is shown turned by {turned}°; K is of the sensor's own frame"
    return replace(item, notes=(*item.notes, note))


FORMAT = Format(
    name="qualisys",
    title="Qualisys and Theia Markerless camera calibration",
    suffixes=(".txt", ".xml"),
    syntaxes=(Syntax.XML,),
    reference="https://docs.qualisys.com/qtm-rt-protocol/",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
