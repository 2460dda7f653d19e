"""Pictures in and out of files: as stored, and with what is still true of them."""

from __future__ import annotations

import io
import struct
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image, ImageCms

from calibrary.calib.picture_files import Kind, Picture, decode, encode, reframed
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.evidence.originality import originality
from calibrary.parsers.imagery import read_metadata

FOCAL_LENGTH, FOCAL_35MM, PIXEL_X, MAKER_NOTE, MAKE = 0x920A, 0xA405, 0xA002, 0x927C, 0x010F


def ramp(dtype: type = np.uint8, channels: int = 3) -> NDArray[Any]:
    """A picture no turn or swap of channels leaves as it is."""
    y, x = np.mgrid[:24, :32]
    planes = [x * 7, y * 10, x + y, 255 - x]
    return np.dstack(planes[:channels]).astype(dtype).squeeze()


def exif_block(**more: int) -> bytes:
    exif = Image.Exif()
    exif[MAKE] = "DJI"
    exif[0x0112] = 6
    details = exif.get_ifd(0x8769)
    details[FOCAL_LENGTH] = 8.8
    details[FOCAL_35MM] = 24
    details[PIXEL_X] = 5472
    details[MAKER_NOTE] = b"secret coefficients"
    exif.get_ifd(0x8825)[1] = "N"
    for name, value in more.items():
        exif[int(name, 16)] = value
    return exif.tobytes()


def stored(kind: str, pixels: NDArray[Any], **settings: Any) -> bytes:
    """By Pillow, which has no hand in what is tested."""
    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, kind, **settings)
    return stream.getvalue()


def reread(data: bytes) -> tuple[Image.Image, Image.Exif]:
    image = Image.open(io.BytesIO(data))
    image.load()
    return image, image.getexif()


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("kind", ["PNG", "TIFF"])
def test_orientation_turns_nothing(kind: str, orientation: int) -> None:
    exif = Image.Exif()
    exif[0x0112] = orientation
    picture = decode(stored(kind, ramp(), exif=exif), source="a")
    assert np.array_equal(picture.pixels, ramp()[..., ::-1])


@pytest.mark.parametrize("orientation", [3, 6])
def test_orientation_turns_no_jpeg(orientation: int) -> None:
    exif = Image.Exif()
    exif[0x0112] = orientation
    picture = decode(stored("JPEG", ramp(), exif=exif, quality=100, subsampling=0), source="a")
    assert np.abs(picture.pixels.astype(int) - ramp()[..., ::-1]).max() <= 4


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("order", ["<", ">"])
def test_a_tiff_of_either_byte_order_and_size_is_not_turned(order: str, big: bool) -> None:
    data = grey_tiff(order, big=big, orientation=6)
    assert np.array_equal(decode(data, source="a").pixels, ramp(channels=1))


def grey_tiff(order: str, *, big: bool, orientation: int) -> bytes:
    """Baseline TIFF 6.0, or its 64-bit kind, in one strip after the directory."""
    pixels = ramp(channels=1)
    tags = {256: 32, 257: 24, 258: 8, 259: 1, 262: 1, 273: 0, 274: orientation, 277: 1, 278: 24, 279: 768}
    where, count, entry = ("Q", "Q", "HHQ") if big else ("I", "H", "HHI")
    mark = b"II" if order == "<" else b"MM"
    head = mark + (struct.pack(order + "HHHQ", 43, 8, 0, 16) if big else struct.pack(order + "HI", 42, 8))
    value = 8 if big else 4
    tags[273] = (
        len(head)
        + struct.calcsize(order + count)
        + len(tags) * (struct.calcsize(order + entry) + value)
        + value
    )
    body = struct.pack(order + count, len(tags))
    for tag, number in tags.items():
        letter = "I" if tag in {273, 279} else "H"
        body += struct.pack(order + entry, tag, 4 if letter == "I" else 3, 1)
        body += struct.pack(order + letter, number).ljust(value, b"\0")
    return head + body + struct.pack(order + where, 0) + pixels.tobytes()


@pytest.mark.parametrize(
    ("kind", "dtype", "channels"),
    [
        (Kind.PNG, np.uint8, 1),
        (Kind.PNG, np.uint16, 3),
        (Kind.PNG, np.uint8, 4),
        (Kind.TIFF, np.uint16, 1),
        (Kind.TIFF, np.uint16, 4),
        (Kind.TIFF, np.float32, 1),
        (Kind.TIFF, np.int16, 1),
        (Kind.JPEG, np.uint8, 1),
    ],
)
def test_depth_and_channels_go_through(kind: Kind, dtype: type, channels: int) -> None:
    pixels = ramp(dtype, channels)
    again = decode(encode(Picture(pixels=pixels, kind=kind), quality=100), source="a")
    assert (again.kind, again.pixels.shape, again.pixels.dtype) == (kind, pixels.shape, pixels.dtype)
    assert np.abs(again.pixels.astype(float) - pixels).max() <= (2 if kind is Kind.JPEG else 0)


@pytest.mark.parametrize(
    ("kind", "dtype", "channels", "message"),
    [
        (Kind.JPEG, np.uint16, 3, "a JPEG does not hold uint16 pixels; write PNG or TIFF"),
        (Kind.JPEG, np.uint8, 4, "a JPEG does not hold transparency"),
        (Kind.PNG, np.float32, 1, "a PNG does not hold float32 pixels; write TIFF"),
    ],
)
def test_what_a_file_does_not_hold_is_refused(kind: Kind, dtype: type, channels: int, message: str) -> None:
    with pytest.raises(UnsupportedModelError, match=message):
        encode(Picture(pixels=ramp(dtype, channels), kind=kind))


@pytest.mark.parametrize("kind", ["JPEG", "PNG"])
def test_exif_and_colour_profile_are_taken_along(kind: str) -> None:
    profile = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    picture = decode(stored(kind, ramp(), exif=exif_block(), icc_profile=profile), source="a")
    image, exif = reread(encode(reframed(picture, picture.pixels, keeps_focal=True)))
    assert (exif[MAKE], exif[0x0112], exif.get_ifd(0x8825)[1]) == ("DJI", 6, "N")
    assert float(exif.get_ifd(0x8769)[FOCAL_LENGTH]) == 8.8
    assert exif.get_ifd(0x8769)[PIXEL_X] == 32
    assert image.info["icc_profile"] == profile


def test_the_makers_notes_stay_behind() -> None:
    picture = decode(stored("JPEG", ramp(), exif=exif_block()), source="a")
    data = encode(reframed(picture, picture.pixels, keeps_focal=True))
    assert MAKER_NOTE not in reread(data)[1].get_ifd(0x8769)
    assert b"secret" not in data


def test_a_focal_length_that_is_no_longer_true_stays_behind() -> None:
    picture = decode(stored("JPEG", ramp(), exif=exif_block()), source="a")
    details = reread(encode(reframed(picture, picture.pixels[:12], keeps_focal=False)))[1].get_ifd(0x8769)
    assert FOCAL_LENGTH not in details
    assert FOCAL_35MM not in details


def test_xmp_stays_behind() -> None:
    packet = b"<x:xmpmeta xmlns:x='adobe:ns:meta/'>DewarpData</x:xmpmeta>"
    picture = decode(stored("JPEG", ramp(), xmp=packet), source="a")
    assert b"Dewarp" not in encode(reframed(picture, picture.pixels, keeps_focal=True))


@pytest.mark.parametrize("kind", ["JPEG", "PNG"])
def test_the_picture_says_that_its_lens_was_corrected(kind: str, tmp_path: Path) -> None:
    """The gate must not take the camera's usual K for such a picture's."""
    picture = decode(stored(kind, ramp(), exif=exif_block()), source="a")
    path = tmp_path / "a"
    path.write_bytes(encode(reframed(picture, picture.pixels, keeps_focal=False)))
    assert originality(read_metadata(path)).lens_corrected


def test_a_long_colour_profile_is_cut_into_numbered_segments() -> None:
    profile = bytes(range(256)) * 600
    data = encode(Picture(pixels=ramp(), kind=Kind.JPEG, profile=profile))
    assert reread(data)[0].info["icc_profile"] == profile
    assert decode(data, source="a").profile == profile


@pytest.mark.parametrize(
    "block", [b"", b"II", b"II*\0\xff\xff\xff\xff", b"MM\0*\0\0\0\x08\xff\xff", bytes(40)]
)
def test_a_broken_exif_block_is_left_behind_and_the_picture_kept(block: bytes) -> None:
    picture = Picture(pixels=ramp(), kind=Kind.JPEG, exif=block)
    image, _ = reread(encode(reframed(picture, picture.pixels, keeps_focal=True)))
    assert image.size == (32, 24)


def test_colours_of_a_jpeg_are_stored_at_full_resolution() -> None:
    data = encode(Picture(pixels=ramp(), kind=Kind.JPEG))
    frame = data.index(b"\xff\xc0")
    assert [data[frame + 11 + 3 * part] for part in range(3)] == [0x11] * 3


def test_what_is_no_picture_is_told_what_would_be() -> None:
    with pytest.raises(UnsupportedModelError, match=r"a\.heic: it is not a JPEG, PNG or TIFF; .*export"):
        decode(b"\0\0\0\x18ftypheic" + bytes(100), source="a.heic")


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("kind", ["JPEG", "PNG", "TIFF"])
def test_a_picture_cut_short_is_broken_and_no_half_one(kind: str, share: float) -> None:
    grain = np.random.default_rng(3).integers(0, 256, (240, 320, 3), np.uint8)
    data = stored(kind, grain)
    with pytest.raises(ParseError, match=r"a: the .* cannot be decoded"):
        decode(data[: int(len(data) * share)], source="a")


def test_opencv_says_nothing_of_a_broken_tiff(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ParseError):
        decode(stored("TIFF", ramp())[:1000], source="a")
    assert capfd.readouterr().err == ""


def test_opencv_reads_what_was_written_as_it_was() -> None:
    data = encode(Picture(pixels=ramp(np.uint16), kind=Kind.PNG, exif=exif_block(), profile=b"profile"))
    pixels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    assert pixels is not None
    assert np.array_equal(pixels, ramp(np.uint16))
