"""Bentley ContextCapture optical properties, the ``.opt`` that photogroups are imported from and exported to.

In the format's own words::

    <OpticalProperties version="1.0">
      <ImageDimensions> <Width>5472</Width> <Height>3648</Height> </ImageDimensions>
      <SensorSize>13.2</SensorSize> <FocalLength>8.8</FocalLength>        mm
      <PrincipalPoint> <X>2735.5</X> <Y>1823.5</Y> </PrincipalPoint>
      <Distortion> <K1/> <K2/> <K3/> <P1/> <P2/> </Distortion>
    </OpticalProperties>

Bentley describes the use of the file but not its content. The layout is known from programs that write it. Its elements
are those of BlocksExchange and are read in the same convention.

Sources: Bentley, ContextCapture user guide, "Photogroups"; ``blocksexchange_xml``.
"""

from __future__ import annotations

from calibrary.calibration import Calibration, Grade
from calibrary.errors import InputError, ParseError
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._bentley import CONVENTION, perspective_camera
from calibrary.parsers.text import shown
from calibrary.parsers.xml import parse_xml

ROOT = "OpticalProperties"
MAX_BYTES = 1024 * 1024
ASSUMPTION = (
    "Bentley does not describe .opt files; its elements were read as BlocksExchange's of the same names"
)


def sniff(content: Content) -> Sniff | None:
    """The root's name."""
    if content.xml_tags[:1] == (ROOT,):
        return Sniff(Sure.MAGIC, f"the XML root is <{ROOT}>")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera of the file."""
    root = parse_xml(data, source=context.name, max_bytes=MAX_BYTES)
    if root.tag != ROOT:
        raise ParseError(f"the XML root is <{shown(str(root.tag))}>, expected <{ROOT}>")
    try:
        camera = perspective_camera(root, context)
    except InputError as error:
        raise type(error)(error.message, source=context.name, place=error.place) from None
    return [
        context.calibration(
            camera.intrinsics,
            camera.distortion,
            assumptions=(ASSUMPTION, *camera.assumptions),
            grade=Grade.ADJUSTED,
            notes=(ASSUMPTION,),
        )
    ]


FORMAT = Format(
    name="contextcapture_opt",
    title="Bentley ContextCapture optical properties",
    suffixes=(".opt",),
    syntaxes=(Syntax.XML,),
    roots=(ROOT,),
    reference="https://docs.bentley.com/LiveContent/web/ContextCapture%20Help-v17/en/",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
