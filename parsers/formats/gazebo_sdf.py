"""Cameras of a simulated world or robot: Gazebo's SDF, and URDF with ``<gazebo>`` sensors in it.

In the format's own words::

    <sensor type="camera" name="front">
      <camera name="left">
        <horizontal_fov>1.3962634</horizontal_fov>                    radians
        <image> <width>400</width> <height>400</height> </image>
        <distortion> <k1>-0.25</k1> <k2>0.12</k2> <k3>0.0</k3> <p1>-0.00028</p1> <p2>-5e-05</p2> </distortion>
        <lens> <intrinsics> <fx>277.1</fx> <fy>277.1</fy> <cx>200.5</cx> <cy>200.5</cy> <s>0</s> </intrinsics> </lens>

Without ``<intrinsics>``, fx = fy = W/2 / tan(fov/2), and the principal point is in the middle. SDFormat names Brown's
formula for the coefficients and not its direction, so a camera that has one is refused; one without ``<distortion>``,
or with zeros, has none. A wide-angle camera and a ``<lens>`` whose ``<type>`` is not ``gnomonical`` with
``<scale_to_hfov>`` are no pinholes and are refused. Gazebo renders with a ``<projection>`` if there is one, so one
that states another K is refused, too. The K is that of a simulation: a design.

Sources: SDFormat, ``sdf/1.12/camera.sdf``; Gazebo, ``rendering/Camera.cc``, ``gz-sensors``' ``CameraSensor.cc``.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from calibrary.calibration import Calibration, Grade
from calibrary.distortion import NoDistortion
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._one_camera import camera
from calibrary.parsers.xml import parse_xml
from calibrary.records import replace

if TYPE_CHECKING:
    from lxml.etree import _Element

CONVENTION = Convention(
    origin=Origin.CORNER,
    coefficients=("k1", "k2", "k3", "p1", "p2"),
    remarks=("a field of view in radians, or fx, fy, cx and cy in px",),
)
MAX_CAMERAS = 1000
PINHOLE = "gnomonical"
SAME_PX = 0.01
"""Largest difference of K and the projection, which are often rounded differently."""
SIMULATED = "the file describes a simulated camera, not one that was measured"


def sniff(content: Content) -> Sniff | None:
    """A horizontal_fov in a description of a robot or a world."""
    if content.xml_root in FORMAT.roots and "horizontal_fov" in content.xml_tags:
        return Sniff(Sure.MAGIC, f"the XML root is <{content.xml_root}> and contains <horizontal_fov>")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera, by its name."""
    root = parse_xml(data, source=context.name)
    found = [element for element in root.iter("camera") if element.find("horizontal_fov") is not None]
    if not 1 <= len(found) <= MAX_CAMERAS:
        raise ParseError(f"{len(found)} cameras with a horizontal_fov, expected 1 to {MAX_CAMERAS}")
    names = [_name(element, index) for index, element in enumerate(found, start=1)]
    return [
        _camera(element, context, name if len(found) > 1 else None, tag=name)
        for name, element in zip(names, found, strict=True)
    ]


def _name(element: _Element, index: int) -> str:
    parent = element.getparent()
    own = element.get("name") or (parent.get("name") if parent is not None else None)
    return str(own) if own else f"camera {index}"


def _camera(element: _Element, context: ReadContext, name: str | None, *, tag: str) -> Calibration:
    for key in ("k1", "k2", "k3", "p1", "p2"):
        if element.find(f"distortion/{key}") is not None and _number(element, f"distortion/{key}", tag):
            raise UnsupportedModelError(
                f"{key} is not 0, and SDFormat does not state in which direction its distortion runs; calibrate the "
                "simulated camera from its images of a board",
                place=tag,
            )
    _check_pinhole(element, tag)
    width, height = (_number(element, f"image/{side}", tag) for side in ("width", "height"))
    size = strict.image_size(width, height, place=tag)
    if element.find("lens/intrinsics/fx") is not None:
        fx, fy, cx, cy = (_number(element, f"lens/intrinsics/{key}", tag) for key in ("fx", "fy", "cx", "cy"))
        skew = (
            _number(element, "lens/intrinsics/s", tag)
            if element.find("lens/intrinsics/s") is not None
            else 0.0
        )
        native = Native(fx=fx, fy=fy, cx=cx, cy=cy, skew=skew)
    else:
        angle = _number(element, "horizontal_fov", tag)
        if not 0 < angle < math.pi:
            raise ParseError(f"horizontal_fov is {angle:g}, expected radians between 0 and 3.1416", place=tag)
        f = width / 2 / math.tan(angle / 2)
        native = Native(fx=f, fy=f, cx=width / 2, cy=height / 2)
    if element.find("lens/projection") is not None:
        _check_projection(element, native, tag)
    item = camera(
        context, CONVENTION, native, size, NoDistortion(), name=name, tag=tag, assumptions=(SIMULATED,)
    )
    return replace(item, grade=Grade.DESIGN)


def _check_pinhole(element: _Element, tag: str) -> None:
    """Refuse a lens that is no pinhole: its mapping is a function of the angle, which K does not hold."""
    parent = element.getparent()
    sensor = "" if parent is None else str(parent.get("type") or "")
    if sensor.replace("_", "").lower() == "wideanglecamera":
        raise UnsupportedModelError(
            f"the sensor is of type {sensor}, whose image is stitched of six and no pinhole's; calibrate the simulated "
            "camera from its images of a board with a fisheye model",
            place=tag,
        )
    kind = (element.findtext("lens/type") or PINHOLE).strip()
    scaled = (element.findtext("lens/scale_to_hfov") or "true").strip().lower()
    if kind != PINHOLE or scaled not in {"true", "1"} or element.find("lens/custom_function") is not None:
        raise UnsupportedModelError(
            f"the lens is of type {strict.shown(kind)} with scale_to_hfov {strict.shown(scaled)}, expected "
            f"{PINHOLE} with scale_to_hfov true and no custom_function; calibrate the simulated camera from its images "
            "of a board with a fisheye model",
            place=tag,
        )


def _check_projection(element: _Element, native: Native, tag: str) -> None:
    wanted = {"p_fx": native.fx, "p_fy": native.fy, "p_cx": native.cx, "p_cy": native.cy}
    for key, value in wanted.items():
        found = _number(element, f"lens/projection/{key}", tag)
        if not abs(found - value) <= SAME_PX:
            raise ParseError(
                f"{key} is {found:g}, and the K of the other elements has {value:g}: Gazebo renders with the "
                "projection; remove it, or state the same numbers under <intrinsics>",
                place=f"{tag}, lens/projection",
            )


def _number(element: _Element, path: str, place: str) -> float:
    text = element.findtext(path)
    if text is None:
        raise ParseError(f"there is no <{path}>", place=place)
    return strict.number(text, place=f"{place}, {path}")


FORMAT = Format(
    name="gazebo_sdf",
    title="Gazebo SDF or URDF with cameras",
    suffixes=(".sdf", ".urdf", ".world", ".xacro"),
    syntaxes=(Syntax.XML,),
    roots=("sdf", "robot", "gazebo"),
    reference="https://github.com/gazebosim/sdformat/blob/sdf15/sdf/1.12/camera.sdf",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
