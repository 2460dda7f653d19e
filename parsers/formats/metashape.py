"""Metashape's projects: the document, and the archive that holds it."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections import Counter
from collections.abc import Iterator
from itertools import islice
from typing import TYPE_CHECKING, NamedTuple

from calibrary.calibration import Calibration, CameraKey, Grade
from calibrary.errors import InputError, ParseError, UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.content import HEAD_BYTES, Content, Syntax
from calibrary.parsers.document import set_aside
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats import agisoft_xml
from calibrary.parsers.formats.agisoft_xml import COVARIANCE, read_covariance, read_elements
from calibrary.parsers.text import shown
from calibrary.parsers.xml import parse_xml
from calibrary.records import replace

if TYPE_CHECKING:
    from lxml.etree import _Element


ROOTS = ("document", "chunk", "sensor")
DOCUMENT_MAX_BYTES = 12 * 1024 * 1024
"""Some fifteen thousand photos."""
MAX_SENSORS = 1_000_000
MAX_ELEMENTS = 256
"""In one calibration; Metashape writes twenty."""
PREFIX = "metashape_document/"
SUPERSEDED = (
    "the calibration that the project started from stands in the file as well; this is the adjusted one"
)
HELD = "the calibration that the project was given and held fixed"
START = "the value that the project started from; no photo was aligned with it, and it may rest on EXIF alone"


def sniff_document(content: Content) -> Sniff | None:
    """A chunk's or a project's root with sensors in it."""
    tags = content.xml_tags
    if not tags or tags[0] not in ROOTS or "sensor" not in tags:
        return None
    # DBAT's projects are a <document> too, with sensors and without chunks.
    if tags[0] == "document" and "chunk" not in tags:
        return None
    # A sensor by itself has a common name, so it must hold what Metashape's does.
    if tags[0] == "sensor" and not {"resolution", "property"} <= set(tags):
        return None
    return Sniff(Sure.MAGIC, f"the XML root is <{tags[0]}> and contains Metashape's <sensor>")


def read_document(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every sensor that has a calibration, in the file's order."""
    root = parse_xml(data, source=context.name, max_bytes=context.at_most(DOCUMENT_MAX_BYTES))
    sensors, tool = _sensors(root), _tool(root)
    found: list[Calibration] = []
    left_out: list[str] = []
    refused: UnsupportedModelError | None = None
    for sensor in sensors:
        try:
            calibration = sensor.calibration(context, tool)
        except UnsupportedModelError as error:
            refused = refused or error
            left_out.append(f"{sensor.place} was left out: {error.message}")
            continue
        if calibration is None:
            left_out.append(f"{sensor.place} was left out: it has no calibration")
        else:
            found.append(calibration)
    if refused is not None and not found:
        raise refused
    if not found:
        raise ParseError(
            f"none of its {len(sensors)} sensors has a calibration; align the photos and export them again"
        )
    return [replace(item, notes=(*item.notes, *left_out)) for item in found]


class _Sensor(NamedTuple):
    """One <sensor>.

    Attributes:
        place: where it stands, in words; unlike the label it is the sensor's own.
        name: its label, with what tells it from others of the same label.
    """

    element: _Element
    place: str
    name: str | None

    def calibration(self, context: ReadContext, tool: str | None) -> Calibration | None:
        """What is known of the sensor, None when that is not a calibration."""
        chosen = self._chosen(context.name)
        if chosen is None:
            return None
        initial = chosen.get("class") == "initial"
        try:
            single = read_elements(self._as_children(chosen), context)
            quality = read_covariance(self._covariance(chosen), single.distortion)
            focal_mm = self._focal_mm()
        except InputError as error:
            place = f"{self.place}, {error.place}" if error.place else self.place
            raise type(error)(error.message, source=context.name, place=place) from None
        held = (self._property("fixed") or "").lower() in {"true", "1"}
        said = [HELD if held else START] if initial else [SUPERSEDED] if self._superseded(chosen) else []
        return replace(
            single,
            camera=CameraKey(
                image_size=single.intrinsics.image_size, sub_camera=self.name, focal_mm=focal_mm
            ),
            grade=Grade.DERIVED if initial and not held else Grade.ADJUSTED,
            quality=quality,
            provenance=context.provenance(tag=self.place, date=single.provenance.date, tool=tool),
            notes=(*single.notes, *said),
            extras=tuple(
                (PREFIX + key.removeprefix(agisoft_xml.PREFIX), value) for key, value in single.extras
            ),
        )

    def _chosen(self, source: str) -> _Element | None:
        """The adjusted calibration, else the initial one."""
        by_class: dict[str, _Element] = {}
        for element in self.element.iterchildren("calibration"):
            kind = element.get("class", "adjusted")
            if kind in by_class:
                raise ParseError(
                    f"two calibrations are {strict.shown(kind)}", source=source, place=self.place
                )
            by_class[kind] = element
        chosen = by_class.get("adjusted", by_class.get("initial"))
        set_aside(*self._superseded(chosen))
        return chosen

    def _superseded(self, chosen: _Element | None) -> list[_Element]:
        """The sensor's other calibrations."""
        return [other for other in self.element.iterchildren("calibration") if other is not chosen]

    def _as_children(self, calibration: _Element) -> Iterator[_Element]:
        """What a calibration file of its own would have, without the covariance."""
        from lxml.etree import Element

        def made(name: str, text: str | None) -> _Element:
            element = Element(name)
            element.text = text
            return element

        if sum(1 for _ in islice(calibration.iter(), MAX_ELEMENTS + 1)) > MAX_ELEMENTS:
            raise ParseError(f"its calibration contains over {MAX_ELEMENTS} elements")
        yield made("projection", calibration.get("type") or self.element.get("type", "frame"))
        resolution = calibration.find("resolution")
        if resolution is None:
            resolution = self.element.find("resolution")
        if resolution is not None:
            for side in ("width", "height"):
                yield made(side, resolution.get(side, ""))
        yield from (child for child in calibration if child.tag not in {"resolution", COVARIANCE})

    def _covariance(self, calibration: _Element) -> _Element | None:
        """Versions write it inside the calibration or beside it; beside it, it is the adjusted one's."""
        inside = calibration.find(COVARIANCE)
        if inside is not None or calibration.get("class") == "initial":
            return inside
        return self.element.find(COVARIANCE)

    def _property(self, name: str) -> str | None:
        return next(
            (item.get("value") for item in self.element.iterchildren("property") if item.get("name") == name),
            None,
        )

    def _focal_mm(self) -> float | None:
        """The nominal focal length, None where the project does not know it."""
        text = self._property("focal_length")
        if not text:
            return None
        focal = strict.number(text, place="focal_length")
        return focal if focal > 0 else None


def _tool(root: _Element) -> str | None:
    """The program that saved the project, as far as the document names it.

    Its ``Info/LastSavedDateTime`` is the day of saving and its photos' EXIF dates are those of the photos;
    neither is the calibration's.
    """
    saved = {
        item.get("name"): item.get("value", "").strip()
        for meta in (*root.iterchildren("meta"), *root.iterfind("chunk/meta"))
        for item in meta.iterchildren("property")
    }
    version = saved.get("Info/LastSavedSoftwareVersion")
    if version:
        return f"{saved.get('Info/OriginalSoftwareName') or 'Agisoft Metashape'} {version}"
    version = root.get("version") if root.tag == "document" else None
    return f"Agisoft Metashape or PhotoScan, document version {version}" if version else None


def _sensors(root: _Element) -> list[_Sensor]:
    """Every sensor with its chunk, in document order."""
    if root.tag not in ROOTS:
        raise ParseError(
            f"the XML root is <{strict.shown(str(root.tag))}>, expected one of {', '.join(ROOTS)}"
        )
    chunks = [root] if root.tag == "chunk" else list(root.iter("chunk"))
    if root.tag == "sensor":
        placed = [(root, "")]
    else:
        placed = [
            (sensor, f" of chunk {strict.shown(chunk.get('label', ''))}" if len(chunks) > 1 else "")
            for chunk in chunks
            for sensor in chunk.iterfind("sensors/sensor")
        ]
    if not placed:
        raise ParseError(
            "it contains no <sensor>; of a project in several files, read the chunk.zip in its .files folder"
        )
    if len(placed) > MAX_SENSORS:
        raise ParseError(f"it contains {len(placed)} sensors; at most {MAX_SENSORS} are read")
    labels = Counter(_label(sensor) for sensor, _ in placed)
    return [
        _Sensor(
            element=sensor,
            place=f"sensor {strict.shown(sensor.get('id', '?'))}{of_chunk}",
            name=_label(sensor) if labels[_label(sensor)] == 1 else _distinct(sensor),
        )
        for sensor, of_chunk in placed
    ]


def _label(sensor: _Element) -> str | None:
    label = (sensor.get("label") or "").strip()
    return None if label in {"", "unknown"} else label


def _distinct(sensor: _Element) -> str:
    """The heads of a multispectral camera share a label; their band, else their number, distinguishes them."""
    bands = [band.get("label", "") for band in sensor.iterfind("bands/band")]
    mark = bands[0] if len(bands) == 1 and bands[0] else f"sensor {sensor.get('id', '?')}"
    return f"{_label(sensor) or 'unknown'}, {mark}"


PROJECT = Format(
    name="metashape_document",
    title="Agisoft Metashape cameras and projects",
    words="""\
Agisoft Metashape (PhotoScan) cameras: *File ▸ Export ▸ Export Cameras* (``cameras.xml``) and projects' ``doc.xml``.

In the format's own words::

    <document version="1.5.0">                          <chunk> where it is the chunk.zip of a .psx project
      <chunk label="Chunk 1">                           in old projects inside <chunks>
        <sensors>
          <sensor id="0" label="FC6310, 8.8mm" type="frame">
            <resolution width="5472" height="3648"/>
            <property name="focal_length" value="8.8"/>  nominal, mm
            <property name="fixed" value="true"/>
            <calibration type="frame" class="initial"> … </calibration>
            <calibration type="frame" class="adjusted">
              <resolution width="5472" height="3648"/>
              <f>3650.1</f> <cx>-3.2</cx> <cy>8.1</cy> <k1/> …
            </calibration>
            <covariance> <params>f cx cy k1 …</params> <coeffs>…</coeffs> </covariance>
        <meta> <property name="Info/LastSavedSoftwareVersion" value="1.6.2.10247"/> … </meta>

Each ``<calibration>`` is the one that *Camera Calibration ▸ Save* writes (``agisoft_xml``), its size and projection in
attributes. calibrary uses the adjusted one if there is one. An initial one is what the user gave to the project: if it
was held fixed, it is a known calibration, otherwise a start value. A sensor without any has no K, because calibrary
does not make a K from the nominal focal length.

Sources: Agisoft Metashape User Manual, appendix C "Camera models"; DBAT's ``loadpsz.m`` for the older layout.
""",
    suffixes=(".xml",),
    syntaxes=(Syntax.XML,),
    roots=ROOTS,
    reference="https://www.agisoft.com/pdf/metashape-pro_2_2_en.pdf",
    convention=agisoft_xml.CONVENTION,
    sniff=sniff_document,
    read=read_document,
    states=("date", "tool"),
    options=(agisoft_xml.PRINCIPAL_POINT,),
)


DOCUMENT = "doc.xml"
ARCHIVE_MAX_BYTES = DOCUMENT_MAX_BYTES
LOCAL_HEADER = b"PK\x03\x04"
CENTRAL_HEADER = b"PK\x01\x02"
MAX_MEMBERS = 50_000
"""A project has two or three files for each photo; listing more would cost memory for nothing."""
METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""What Metashape uses, and what can be unpacked piece by piece: bzip2 and LZMA give all or nothing."""
ENCRYPTED = 0x1


def sniff_archive(content: Content) -> Sniff | None:
    """A zip whose directory, at its end, names the document."""
    data = content.data
    if data.startswith(LOCAL_HEADER) and DOCUMENT.encode() in data[:HEAD_BYTES] + data[-HEAD_BYTES:]:
        return Sniff(Sure.MAGIC, f"it is a zip archive that contains {DOCUMENT}")
    return None


def read_archive(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every sensor of the document in the archive."""
    return read_document(_document(data), context)


def _document(data: bytes) -> bytes:
    """The bytes of doc.xml."""
    members = data.count(CENTRAL_HEADER)
    if members > MAX_MEMBERS:
        raise ParseError(f"the archive lists {members} files; at most {MAX_MEMBERS} are looked at")
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            found = [item for item in archive.infolist() if item.filename == DOCUMENT]
            if len(found) != 1:
                raise ParseError(f"the archive contains {len(found)} files {DOCUMENT}, expected one")
            [item] = found
            if item.flag_bits & ENCRYPTED or item.compress_type not in METHODS:
                raise ParseError(
                    f"{DOCUMENT} is encrypted or packed by method {item.compress_type}, expected stored or deflated"
                )
            with archive.open(item) as file:
                document = file.read(ARCHIVE_MAX_BYTES + 1)
    except ParseError:
        raise
    except (
        zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, OSError, OverflowError, RuntimeError, ValueError
    ) as error:  # fmt: skip
        raise ParseError(f"the zip archive is damaged: {shown(str(error), 80)}") from None
    if len(document) > ARCHIVE_MAX_BYTES:
        raise ParseError(f"{DOCUMENT} is longer than {ARCHIVE_MAX_BYTES} bytes unpacked", place=DOCUMENT)
    return document


ARCHIVE = Format(
    name="metashape_archive",
    title="Agisoft Metashape project archive",
    words="""\
Agisoft Metashape projects in a zip: a ``.psz``, or the ``chunk.zip`` of a ``.psx`` project.

In the format's own words::

    project.psz                     project.files/0/chunk.zip
      doc.xml                         doc.xml
      thumbnails0.zip …               …

``doc.xml`` is what *Export Cameras* writes, and more (``metashape_document``). Only this file is unpacked, and only as
far as that format reads, whatever size the archive states.

Sources: DBAT's ``loadpsz.m``; APPNOTE.TXT, the zip format.
""",
    suffixes=(".psz", ".zip"),
    syntaxes=(Syntax.BINARY,),
    reference="https://www.agisoft.com/pdf/metashape-pro_2_2_en.pdf",
    convention=PROJECT.convention,
    sniff=sniff_archive,
    read=read_archive,
    states=PROJECT.states,
    options=PROJECT.options,
)

FORMATS = (PROJECT, ARCHIVE)
