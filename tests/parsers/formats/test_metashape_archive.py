"""Metashape's .psz and chunk.zip: doc.xml is found, and no archive makes us unpack more than that."""

from __future__ import annotations

import io
import struct
import zipfile

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibrary import parsers
from calibrary.errors import ParseError, UnknownFormatError
from calibrary.parsers.formats.metashape import ARCHIVE_MAX_BYTES as MAX_BYTES
from tests.parsers.cameras import numbers
from tests.parsers.samples import Sample
from tests.thorough import examples

DOCUMENT = b"""<document version="1.4.0"><chunk label="c"><sensors><sensor id="0" label="FC6310" type="frame">
<resolution width="5472" height="3648"/><calibration type="frame" class="adjusted">
<resolution width="5472" height="3648"/><f>3650.7</f><cx>-12.31</cx><cy>8.47</cy><k1>-0.1131</k1><p1>0.0008</p1>
<date>2024-05-17T10:00:00Z</date></calibration></sensor></sensors></chunk></document>"""


def archive(*members: tuple[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", method) as out:
        for name, data in members:
            out.writestr(name, data)
    return file.getvalue()


SAMPLES = {"metashape_archive": Sample(archive(("doc.xml", DOCUMENT)))}


@pytest.mark.parametrize("method", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_the_document_in_the_archive_is_read(method: int) -> None:
    data = archive(("thumbnails0.zip", b"PK"), ("doc.xml", DOCUMENT), method=method)
    [packed] = parsers.decode(data, name="field.psz")
    [plain] = parsers.decode(DOCUMENT, name="doc.xml")
    assert numbers(packed) == numbers(plain)
    assert packed.provenance.source == "field.psz"


def test_another_archive_is_not_claimed() -> None:
    with pytest.raises(UnknownFormatError):
        parsers.decode(archive(("a.txt", b"1")), name="a.zip")


def test_a_document_that_swells_is_not_unpacked_to_its_end() -> None:
    bomb = archive(("doc.xml", b"<document>" + b" " * (MAX_BYTES + 1)))
    assert len(bomb) < MAX_BYTES / 100
    with pytest.raises(ParseError, match="longer than"):
        parsers.decode(bomb, name="bomb.psz")


@pytest.mark.parametrize("method", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_a_method_that_unpacks_all_or_nothing_is_refused(method: int) -> None:
    with pytest.raises(ParseError, match=f"method {method}"):
        parsers.decode(archive(("doc.xml", DOCUMENT), method=method), name="a.psz")


def test_an_encrypted_document_is_refused() -> None:
    data = bytearray(archive(("doc.xml", DOCUMENT)))
    at = data.rfind(b"PK\x01\x02")
    struct.pack_into("<H", data, at + 8, 1)
    with pytest.raises(ParseError, match="encrypted"):
        parsers.decode(bytes(data), name="a.psz")


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_two_documents_are_one_too_many() -> None:
    with pytest.raises(ParseError, match="2 files"):
        parsers.decode(archive(("doc.xml", DOCUMENT), ("doc.xml", b"")), name="a.psz")


def test_a_directory_of_too_many_files_is_not_listed() -> None:
    data = archive(("doc.xml", DOCUMENT)) + b"PK\x01\x02" * 50_001
    with pytest.raises(ParseError, match="lists"):
        parsers.decode(data, name="a.psz")


def test_an_archive_cut_short_is_damaged() -> None:
    data = archive(("doc.xml", DOCUMENT))
    for end in range(4, len(data), 7):
        with pytest.raises(ParseError):
            parsers.decode(data[:end], name="a.psz", format="metashape_archive")


@settings(deadline=None, max_examples=examples(40))
@given(at=st.integers(0, 10_000), value=st.integers(0, 255))
def test_a_damaged_byte_is_noticed_or_changes_nothing(at: int, value: int) -> None:
    data = bytearray(archive(("doc.xml", DOCUMENT)))
    data[at % len(data)] = value
    try:
        [item] = parsers.decode(bytes(data), name="a.psz", format="metashape_archive")
    except ParseError:
        return
    assert item.intrinsics.fy == 3650.7
