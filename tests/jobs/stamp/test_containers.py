"""XMP put into JPEG and TIFF files: what else is in them stays, byte for byte, and what counts bytes is right."""

from __future__ import annotations

import io
import struct

import numpy as np
import pytest
from PIL import Image

from calibrary.errors import ParseError
from calibrary.jobs.stamp import jpeg, tiff
from calibrary.jobs.stamp.tags import merged
from calibrary.parsers.imagery import Source, read_source
from tests.imagery import ExifTags, Segment, XmpDescription, XmpPacket, attributes, elements
from tests.imagery.jpeg import assemble, exif_segment, flat_scan, icc_segments, xmp_segments
from tests.imagery.xmp import DC, DRONE_DJI, MICASENSE, PIX4D_1

SCAN = flat_scan((64, 48))
EXIF = exif_segment(ExifTags(make="DJI", model="FC6310R", maker_note=b"offsets \x00\x01 of its own"))
PACKET = XmpPacket(
    descriptions=(
        XmpDescription(items=attributes(DRONE_DJI, DewarpData="old", GimbalYawDegree="+45.0"), about="DJI"),
        XmpDescription(items=elements(MICASENSE, BandName=("Blue", "Red"))),
    ),
    toolkit="camera",
)
NEW = {("drone-dji", DRONE_DJI.uri, "DewarpData"): "new, longer than what was there"}
OLD = frozenset({f"{{{DRONE_DJI.uri}}}DewarpData"})


FULL = b"<rdf:RDF xmlns:rdf='http://www.w3.org/1999/02/22-rdf-syntax-ns#'>%s</rdf:RDF>" % (b"x" * 65_300)
"""As long as one segment can be."""


def merge(packet: bytes | None) -> bytes:
    return merged(packet, OLD, NEW, source="a")


def in_jpeg(data: bytes) -> bytes:
    return jpeg.with_xmp(data, merge, frozenset({b":DewarpData"}), "a.jpg")


def dewarp(data: bytes) -> str | None:
    return read_source(Source(io.BytesIO(data), name="a", size=len(data))).xmp_text("drone-dji", "DewarpData")


class TestPacket:
    def test_keeps_what_else_is_said_comments_and_padding_included(self) -> None:
        packet = XmpPacket(descriptions=PACKET.descriptions, toolkit="camera", length=2000).encode()
        packet = packet.replace(b"</rdf:RDF>", b"<!-- by hand --></rdf:RDF>", 1)
        new = merge(packet)
        for kept in (
            b"+45.0",
            b"<rdf:li>Red</rdf:li>",
            b"<!-- by hand -->",
            b'x:xmptk="camera"',
            b'end="w"?>',
        ):
            assert kept in new
        assert len(new) == len(packet)
        assert b'"old"' not in new

    def test_a_namespace_that_has_the_prefix_is_kept(self) -> None:
        # Exiv2 and Adobe's toolkit know one namespace for a prefix.
        packet = XmpPacket(
            descriptions=(XmpDescription(items=attributes(PIX4D_1, BandName="Blue")),)
        ).encode()
        new = merged(
            packet, frozenset(), {("Camera", "http://pix4d.com/camera/1.0", "ModelType"): "x"}, source="a"
        )
        assert new.count(b"pix4d.com") == packet.count(b"pix4d.com") + 1
        assert b"http://pix4d.com/camera/1.0" not in new

    def test_describes_the_same_thing_as_the_others(self) -> None:
        assert merge(PACKET.encode()).count(b'rdf:about="DJI"') == 2

    @pytest.mark.parametrize(
        ("packet", "reason"),
        [
            (PACKET.encode().decode().encode("utf-16"), "UTF-8"),
            (b"<x:xmpmeta xmlns:x='adobe:ns:meta/'></x:xmpmeta>", "rdf:RDF"),
            (b"<x:xmpmeta></x:xmpmeta", "UTF-8"),
            (b"<!DOCTYPE a []><a></a>", "DTD"),
            (b"<a><b></a>", "well-formed"),
        ],
    )
    def test_refuses_what_it_would_lose(self, packet: bytes, reason: str) -> None:
        with pytest.raises(ParseError, match=reason):
            merge(packet)


class TestJpeg:
    @pytest.mark.parametrize("length", [None, 4000])
    def test_changes_the_packet_alone(self, length: int | None) -> None:
        packet = XmpPacket(descriptions=PACKET.descriptions, length=length)
        thermal = Segment(0xE3, bytes(range(256)) * 9)
        data = assemble([EXIF, *xmp_segments(packet), *icc_segments(b"icc" * 99), thermal], SCAN)
        new = in_jpeg(data)
        assert dewarp(new) == "new, longer than what was there"
        assert new.endswith(thermal.encode() + SCAN)
        assert new.startswith(b"\xff\xd8" + EXIF.encode())
        assert (len(new) == len(data)) is (length is not None)

    def test_a_new_packet_follows_exif(self) -> None:
        new = in_jpeg(assemble([EXIF, Segment(0xE4, b"dji")], SCAN))
        assert new.startswith(b"\xff\xd8" + EXIF.encode() + b"\xff\xe1")
        assert new.endswith(Segment(0xE4, b"dji").encode() + SCAN)
        assert dewarp(new) == "new, longer than what was there"

    def test_a_segment_may_be_empty_and_must_be_whole(self) -> None:
        empty = Segment(0xFE, b"")
        assert empty.encode() == b"\xff\xfe\x00\x02"
        assert dewarp(in_jpeg(assemble([EXIF, empty], SCAN))) == "new, longer than what was there"
        for torn in (b"\xff\xfe\x00\x01", Segment(0xFE, b"four").encode()[:-1]):
            with pytest.raises(ParseError, match="is not whole"):
                in_jpeg(b"\xff\xd8" + torn)

    def test_keeps_extended_xmp_and_refuses_one_with_a_calibration(self) -> None:
        further = XmpDescription(items=attributes(DC, format="x" * 70_000))
        packet = XmpPacket(descriptions=PACKET.descriptions, extended=(further,))
        segments = xmp_segments(packet)
        new = in_jpeg(assemble(segments, SCAN))
        assert all(one.encode() in new for one in segments[1:])
        assert packet.guid().encode() in new.partition(b"xmp/extension")[0]
        other = XmpDescription(items=attributes(DRONE_DJI, DewarpData="third"))
        with pytest.raises(ParseError, match="extended XMP has a calibration"):
            in_jpeg(assemble(xmp_segments(XmpPacket(descriptions=(), extended=(other,))), SCAN))

    @pytest.mark.parametrize("before", [True, False])
    @pytest.mark.parametrize("order", ["<", ">"])
    def test_corrects_the_index_of_several_pictures(self, order: str, before: bool) -> None:
        second = assemble([], SCAN)

        def of(first: int, offset: int) -> Segment:
            mark = b"II*\0" if order == "<" else b"MM\0*"
            entries = struct.pack(f"{order}5I", 0, first, 0, 0, 0)[:16]
            entries += struct.pack(f"{order}3IHH", 0, len(second), offset, 0, 0)
            version, count = (0xB000, 7, 4, b"0100"), (0xB001, 4, 1, struct.pack(f"{order}I", 2))
            head = struct.pack(f"{order}IH", 8, 3)
            head += b"".join(struct.pack(f"{order}HHI4s", *field) for field in (version, count))
            head += struct.pack(f"{order}HHIII", 0xB002, 7, 32, 50, 0)
            return Segment(0xE2, b"MPF\0" + mark + head + entries)

        def arranged(index: Segment) -> bytes:
            xmp = xmp_segments(PACKET)
            return assemble([EXIF, *((*xmp, index) if before else (index, *xmp))], SCAN)

        blank = arranged(of(0, 0))
        header = blank.index(b"MPF\0") + 4
        first = arranged(of(len(blank), len(blank) - header))
        new = in_jpeg(first + second)
        assert len(new) > len(first + second)
        header = new.index(b"MPF\0") + 4
        numbers = struct.unpack_from(f"{order}8I", new, header + 50)
        assert numbers[1] == len(new) - len(second)
        assert new[header + numbers[6] :] == second
        assert [frame.size for frame in _frames(new)] == [(64, 48), (64, 48)]

    @pytest.mark.parametrize(
        ("data", "reason"),
        [
            (b"\xff\xd8\xff\xd9", "ends before"),
            (b"\xff\xd8\xff\xe1\xff\xff", "not whole"),
            (b"\xff\xd8" + b"\0" * 9, "ends before"),
            (assemble([*xmp_segments(PACKET), *xmp_segments(PACKET)], SCAN), "2 XMP packets"),
            (assemble([Segment(0xE2, b"MPF\0nonsense")], SCAN), "MPF"),
            (assemble(xmp_segments(FULL), SCAN), "segment holds"),
        ],
    )
    def test_refuses_what_it_would_break(self, data: bytes, reason: str) -> None:
        with pytest.raises(ParseError, match=reason):
            in_jpeg(data)


def _frames(data: bytes) -> list[Image.Image]:
    """The pictures of a multi-picture file, as Pillow finds them."""
    with Image.open(io.BytesIO(data)) as image:
        found = []
        for number in range(getattr(image, "n_frames", 1)):
            image.seek(number)
            found.append(image.copy())
    return found


class TestTiff:
    @pytest.mark.parametrize("big", [False, True])
    @pytest.mark.parametrize("length", [None, 0, 4000])
    def test_moves_no_strip_and_no_value(self, length: int | None, big: bool) -> None:
        pixels = np.random.default_rng(5).integers(0, 65_535, (48, 64), dtype=np.uint16)
        stream = io.BytesIO()
        info = {271: "DJI", 34665: {0x920A: (88, 10)}} | ({700: _packet(length)} if length != 0 else {})
        Image.fromarray(pixels).save(stream, "TIFF", tiffinfo=info, big_tiff=big)
        data = stream.getvalue()
        new = tiff.with_xmp(data, merge, "a.tif")
        assert dewarp(new) == "new, longer than what was there"
        with Image.open(io.BytesIO(data)) as before, Image.open(io.BytesIO(new)) as after:
            assert (np.asarray(after) == pixels).all()
            old_tags, new_tags = dict(before.tag_v2), dict(after.tag_v2)  # type: ignore[attr-defined]
        assert b"longer than what was there" in new_tags.pop(700)
        old_tags.pop(700, None)
        assert old_tags == new_tags
        assert (len(new) == len(data)) is (length == 4000)
        changed = [at for at, (one, other) in enumerate(zip(data, new, strict=False)) if one != other]
        # Nothing but the packet, its entry, or where the first directory is.
        assert len(changed) <= (4000 if length == 4000 else 20)

    def test_refuses_a_broken_directory(self) -> None:
        with pytest.raises(ParseError, match="not whole"):
            tiff.with_xmp(b"II*\0\x08\0\0\0\x05\0", merge, "a.tif")

    def test_refuses_to_move_the_directory_of_a_cloud_optimised_one(self) -> None:
        stream = io.BytesIO()
        Image.new("L", (8, 8)).save(stream, "TIFF")
        data = stream.getvalue()
        with pytest.raises(ParseError, match="cloud-optimised"):
            tiff.with_xmp(data + b"GDAL_STRUCTURAL_METADATA_SIZE=", merge, "a.tif")


def _packet(length: int | None) -> bytes:
    return XmpPacket(descriptions=PACKET.descriptions, length=length).encode()
