"""Bentley BlocksExchange (CCOrientations), the block of ContextCapture and iTwin Capture.

In the format's own words::

    <BlocksExchange version="2.1">
      <Block>
        <Photogroups>
          <Photogroup>                               one camera
            <Name>UCX</Name>
            <ImageDimensions> <Width>9420</Width> <Height>14430</Height> </ImageDimensions>
            <CameraModelType>Perspective</CameraModelType>
            <SensorSize>103.9</SensorSize> <FocalLength>100.7</FocalLength>    mm; or <FocalLengthPixels>
            <PrincipalPoint> <x>4683.7</x> <y>7223.0</y> </PrincipalPoint>     or <xmm>, <ymm>
            <AspectRatio>1.0003</AspectRatio>        fy / fx
            <Distortion> <K1/> <K2/> <K3/> <P1/> <P2/> </Distortion>
            <Photo> … </Photo>

SensorSize is the sensor's longer side. The principal point counts from the *centre* of the top-left pixel, and is ((W −
1)/2, (H − 1)/2) if the file states none; ``xmm``, ``ymm`` count from the sensor's middle. P1 and P2 are OpenCV's p2 and
p1. Blocks of undistorted photos have no ``<Distortion>`` at all.

Sources: Bentley, "BlocksExchange XML format" of the ContextCapture user guide (its UCX example states one camera
in pixels and in mm) and "CC Orientations" of the Reality Modeling API.
"""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import TYPE_CHECKING

from calibrary.calibration import Calibration, Grade
from calibrary.distortion import BrownConrady, NoDistortion, required
from calibrary.errors import InputError, ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, UnknownLens, WriteContext
from calibrary.parsers.formats._bentley import CONVENTION, perspective_camera
from calibrary.parsers.xml import parse_xml
from calibrary.records import replace

if TYPE_CHECKING:
    from lxml.etree import _Element

ROOTS = ("BlocksExchange", "Photogroups", "Photogroup")
MAX_BYTES = 12 * 1024 * 1024
"""Some fifteen thousand photos; tie points, which a block may hold as well, are better left out."""
MAX_PHOTOGROUPS = 10_000
KEPT = ("Description", "CameraModelBand")
PREFIX = "blocksexchange_xml/"


def sniff(content: Content) -> Sniff | None:
    """The root, or a part of the document with a photogroup's own elements."""
    tags = content.xml_tags
    if not tags or tags[0] not in ROOTS:
        return None
    if tags[0] != ROOTS[0] and not {"ImageDimensions", "Photogroup"} <= set(tags):
        return None
    return Sniff(Sure.MAGIC, f"the XML root is <{tags[0]}>")


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The camera of every photogroup, in the file's order."""
    root = parse_xml(data, source=context.name, max_bytes=context.at_most(MAX_BYTES))
    groups = list(root.iter("Photogroup")) if root.tag in ROOTS else []
    if not 0 < len(groups) <= MAX_PHOTOGROUPS:
        raise ParseError(
            f"the XML root is <{strict.shown(str(root.tag))}> with {len(groups)} <Photogroup>, "
            f"expected from 1 to {MAX_PHOTOGROUPS}"
        )
    found: list[Calibration] = []
    refused: list[UnsupportedModelError] = []
    for number, group in enumerate(groups, start=1):
        try:
            found.append(_camera(group, number, context))
        except UnsupportedModelError as error:
            refused.append(error)
    if not refused:
        return found
    if not found:
        raise refused[0]
    note = (
        f"{len(refused)} of {len(groups)} photogroups were left out: {refused[0].place}, {refused[0].message}"
    )
    return [replace(item, notes=(*item.notes, note)) for item in found]


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """A block with one photogroup for each camera and no photo in it."""
    groups = "".join(_photogroup(item, number) for number, item in enumerate(calibrations, start=1))
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n<BlocksExchange version="2.1">\n  <Block>\n    <Photogroups>\n'
        f"{groups}    </Photogroups>\n  </Block>\n</BlocksExchange>\n"
    ).encode()


def _camera(group: _Element, number: int, context: ReadContext) -> Calibration:
    name = (group.findtext("Name") or "").strip() or f"photogroup {number}"
    place = f"photogroup {number}, {strict.shown(name)}"
    try:
        camera = perspective_camera(group, context)
    except InputError as error:
        inner = f"{place}, {error.place}" if error.place else place
        raise type(error)(error.message, source=context.name, place=inner) from None
    kept = [(key, (group.findtext(key) or "").strip()) for key in KEPT]
    return context.calibration(
        camera.intrinsics,
        camera.distortion,
        name=name,
        tag=place,
        assumptions=camera.assumptions,
        grade=Grade.ADJUSTED,
        notes=() if camera.distortion is not None else (_without_lens(group),),
        extras=tuple((PREFIX + key, text) for key, text in kept if text),
    )


def _without_lens(group: _Element) -> str:
    """What the absence of <Distortion> is taken for."""
    words = " ".join(group.findtext(path) or "" for path in ("Name", "Description", "Photo/ImagePath"))
    if "undistorted" in words.lower():
        return "it describes undistorted photos and states no distortion: it is not of the original photos"
    return "it states no distortion; the photos may be undistorted copies"


def _photogroup(calibration: Calibration, number: int) -> str:
    K, native = calibration.intrinsics, CONVENTION.native(calibration.intrinsics)
    extras = dict(calibration.extras)
    rows = [f"<Name>{escape(calibration.camera.sub_camera or f'camera {number}', quote=False)}</Name>"]
    rows += [
        f"<{key}>{escape(extras[PREFIX + key], quote=False)}</{key}>"
        for key in KEPT
        if PREFIX + key in extras
    ]
    rows += [
        f"<ImageDimensions><Width>{K.image_size[0]}</Width><Height>{K.image_size[1]}</Height></ImageDimensions>",
        "<CameraModelType>Perspective</CameraModelType>",
        f"<FocalLengthPixels>{native.fx!r}</FocalLengthPixels>",
        "<CameraOrientation>XRightYDown</CameraOrientation>",
        *([f"<AspectRatio>{K.fy / K.fx!r}</AspectRatio>"] if K.fx != K.fy else []),
        f"<PrincipalPoint><x>{native.cx!r}</x><y>{native.cy!r}</y></PrincipalPoint>",
    ]
    if calibration.distortion is not None:
        lens = required(calibration.distortion, BrownConrady)
        values = (lens.k1, lens.k2, lens.k3, *CONVENTION.tangential_to_file(lens.p1, lens.p2))
        terms = "".join(
            f"<{name}>{value!r}</{name}>" for name, value in zip(CONVENTION.coefficients, values, strict=True)
        )
        rows.append(f"<Distortion>{terms}</Distortion>")
    body = "".join(f"        {row}\n" for row in rows)
    return f"      <Photogroup>\n{body}      </Photogroup>\n"


FORMAT = Format(
    name="blocksexchange_xml",
    title="Bentley BlocksExchange",
    suffixes=(".xml",),
    syntaxes=(Syntax.XML,),
    roots=ROOTS,
    reference="https://developer.bentley.com/apis/contextcapture/cc-ori/",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(
        models=(NoDistortion, BrownConrady), several_cameras=True, unknown_lens=UnknownLens.STATED
    ),
)
