"""Agisoft Metashape projects in a zip: a ``.psz``, or the ``chunk.zip`` of a ``.psx`` project.

In the format's own words::

    project.psz                     project.files/0/chunk.zip
      doc.xml                         doc.xml
      thumbnails0.zip …               …

``doc.xml`` is what *Export Cameras* writes, and more (``metashape_document``). Only this file is unpacked, and only as
far as that format reads, whatever size the archive states.

Sources: DBAT's ``loadpsz.m``; APPNOTE.TXT, the zip format.
"""

from __future__ import annotations

import io
import zipfile
import zlib

from calibrary.calibration import Calibration
from calibrary.errors import ParseError
from calibrary.parsers.content import HEAD_BYTES, Content, Syntax
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats import metashape_document
from calibrary.parsers.text import shown

DOCUMENT = "doc.xml"
MAX_BYTES = metashape_document.MAX_BYTES
LOCAL_HEADER = b"PK\x03\x04"
CENTRAL_HEADER = b"PK\x01\x02"
MAX_MEMBERS = 50_000
"""A project has two or three files for each photo; listing more would cost memory for nothing."""
METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""What Metashape uses, and what can be unpacked piece by piece: bzip2 and LZMA give all or nothing."""
ENCRYPTED = 0x1


def sniff(content: Content) -> Sniff | None:
    """A zip whose directory, at its end, names the document."""
    data = content.data
    if data.startswith(LOCAL_HEADER) and DOCUMENT.encode() in data[:HEAD_BYTES] + data[-HEAD_BYTES:]:
        return Sniff(Sure.MAGIC, f"it is a zip archive that contains {DOCUMENT}")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every sensor of the document in the archive."""
    return metashape_document.read(_document(data), context)


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
                document = file.read(MAX_BYTES + 1)
    except ParseError:
        raise
    except (
        zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, OSError, OverflowError, RuntimeError, ValueError
    ) as error:  # fmt: skip
        raise ParseError(f"the zip archive is damaged: {shown(str(error), 80)}") from None
    if len(document) > MAX_BYTES:
        raise ParseError(f"{DOCUMENT} is longer than {MAX_BYTES} bytes unpacked", place=DOCUMENT)
    return document


FORMAT = Format(
    name="metashape_archive",
    title="Agisoft Metashape project archive",
    suffixes=(".psz", ".zip"),
    syntaxes=(Syntax.BINARY,),
    reference="https://www.agisoft.com/pdf/metashape-pro_2_2_en.pdf",
    convention=metashape_document.FORMAT.convention,
    sniff=sniff,
    read=read,
    states=metashape_document.FORMAT.states,
    options=metashape_document.FORMAT.options,
)
