"""Frames: decoded as the sensor stored them, or refused in one line that says what the file is."""

from __future__ import annotations

import contextlib
import hashlib
import io
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from PIL import Image, PngImagePlugin, TiffImagePlugin

from calibrary.calib.frames import (
    Setting,
    frame_size,
    group_frames,
    of_most_common_size,
    read_frame,
    the_one_setting,
)
from calibrary.calib.image_head import check_complete, read_head
from calibrary.calibration import CameraKey
from calibrary.errors import InputError, ParseError, UnknownFormatError
from tests.calib.photographs import Gray, encoded, photograph
from tests.thorough import examples

MOTTLED: Gray = np.clip(np.random.default_rng(3).normal(120, 40, (96, 128)), 0, 255).astype(np.uint8)
COLOUR: Gray = np.dstack([MOTTLED, MOTTLED[::-1], MOTTLED[:, ::-1]])


def written(tmp_path: Path, content: bytes, name: str = "frame.img") -> Path:
    path = tmp_path / name
    path.write_bytes(content)
    return path


def refusal(tmp_path: Path, content: bytes) -> str:
    path = written(tmp_path, content)
    with pytest.raises(InputError) as caught:
        read_frame(path)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith("frame.img: ")
    return str(caught.value)


def with_tiff_tag(content: bytes, tag: int, old: int, new: int) -> bytes:
    """A little-endian TIFF with the value of one SHORT replaced."""
    entry = tag.to_bytes(2, "little") + b"\x03\0\x01\0\0\0"
    assert content.count(entry + old.to_bytes(2, "little")) == 1
    return content.replace(entry + old.to_bytes(2, "little"), entry + new.to_bytes(2, "little"))


class TestDecoding:
    @pytest.mark.parametrize("kind", ["PNG", "TIFF", "BMP", "PPM", "JPEG2000"])
    def test_gray_is_kept_to_the_bit(self, tmp_path: Path, kind: str) -> None:
        frame = read_frame(written(tmp_path, encoded(MOTTLED, kind)))
        assert np.array_equal(frame.gray, MOTTLED)
        assert frame.size == (128, 96)

    def test_the_hash_is_of_the_files_bytes(self, tmp_path: Path) -> None:
        content = encoded(MOTTLED, "PNG")
        frame = read_frame(written(tmp_path, content))
        assert frame.sha256 == hashlib.sha256(content).hexdigest()

    @pytest.mark.parametrize("kind", ["PNG", "TIFF", "JPEG"])
    def test_colour_becomes_its_luma(self, tmp_path: Path, kind: str) -> None:
        frame = read_frame(
            written(tmp_path, encoded(COLOUR, kind, **({"quality": 100} if kind == "JPEG" else {})))
        )
        luma = np.asarray(Image.fromarray(COLOUR).convert("L"), dtype=np.float64)
        assert np.abs(frame.gray - luma).mean() < 1.5

    def test_a_pgm_in_words_and_one_of_twelve_bits(self, tmp_path: Path) -> None:
        words = (
            b"P2\n# by hand\n128 96\n255\n" + b" ".join(b"%d" % level for level in MOTTLED.ravel()) + b"\n"
        )
        assert np.array_equal(read_frame(written(tmp_path, words)).gray, MOTTLED)
        deep = b"P5 128 96 4095\n" + (MOTTLED.astype(">u2") * 16).tobytes()
        levels = read_frame(written(tmp_path, deep)).gray
        assert (levels.min(), levels.max()) == (0, 255)

    @pytest.mark.parametrize(
        ("content", "said"),
        [
            (b"P5\n128 96\n70000\n", "largest value is 70000"),
            (b"P5\n128 x\n", "without its width"),
            (b"P5" + b" " * 200 + b"x", "without its width"),
            (b"P5" + b"\n#" * 2000, "without its width"),
            (b"BM" + bytes(12) + (40).to_bytes(4, "little") + bytes(40), "a BMP of 0 bits"),
            (b"BM" + bytes(12) + (12).to_bytes(4, "little") + bytes(40), "Windows 3"),
            (bytes.fromhex("ff4fff51") + bytes(10), "without its size"),
            (bytes.fromhex("0000000c6a5020200d0a870a") + bytes(8), "without a codestream"),
        ],
    )
    def test_a_broken_head_is_told(self, tmp_path: Path, content: bytes, said: str) -> None:
        assert said in refusal(tmp_path, content)

    @pytest.mark.parametrize("kind", ["PNG", "TIFF"])
    def test_twelve_bits_in_sixteen_are_stretched_to_eight(self, tmp_path: Path, kind: str) -> None:
        deep = MOTTLED.astype(np.uint16) * 16
        frame = read_frame(written(tmp_path, encoded(deep, kind)))
        assert frame.gray.dtype == np.uint8
        assert np.ptp(frame.gray) == 255
        assert np.corrcoef(frame.gray.ravel(), MOTTLED.ravel())[0, 1] > 0.999

    def test_exif_orientation_does_not_turn_the_frame(self, tmp_path: Path) -> None:
        exif = Image.Exif()
        exif[0x0112] = 6
        frame = read_frame(written(tmp_path, encoded(MOTTLED, "JPEG", exif=exif, quality=95)))
        assert frame.size == (128, 96)
        assert np.corrcoef(frame.gray.ravel(), MOTTLED.ravel())[0, 1] > 0.98

    def test_data_behind_the_end_of_a_jpeg_does_no_harm(self, tmp_path: Path) -> None:
        content = encoded(MOTTLED, "JPEG") + b"\xff\xd8 a preview as cameras append it"
        assert read_frame(written(tmp_path, content)).size == (128, 96)

    def test_a_progressive_jpeg_is_whole_with_all_its_scans(self, tmp_path: Path) -> None:
        content = encoded(COLOUR, "JPEG", progressive=True)
        assert read_frame(written(tmp_path, content)).size == (128, 96)
        assert "cut short" in refusal(tmp_path, content[: len(content) * 3 // 4])


class TestRefusals:
    @pytest.mark.parametrize("kind", ["JPEG", "TIFF"])
    def test_cmyk(self, tmp_path: Path, kind: str) -> None:
        out = io.BytesIO()
        Image.fromarray(COLOUR).convert("CMYK").save(out, kind)
        assert f"a CMYK {kind}, made by a program for print" in refusal(tmp_path, out.getvalue())

    @pytest.mark.parametrize("kind", ["JPEG", "PNG", "TIFF"])
    def test_a_file_cut_short(self, tmp_path: Path, kind: str) -> None:
        content = encoded(COLOUR, kind)
        assert "cut short after" in refusal(tmp_path, content[: len(content) * 2 // 3])

    def test_a_tiff_that_says_it_is_a_bayer_mosaic(self, tmp_path: Path) -> None:
        content = with_tiff_tag(encoded(MOTTLED, "TIFF"), 262, 1, 32803)
        assert "raw colour mosaic (Bayer)" in refusal(tmp_path, content)

    @pytest.mark.parametrize("corner", [(0, 0), (0, 1), (1, 0), (1, 1)])
    def test_a_bayer_mosaic_that_says_it_is_gray(self, tmp_path: Path, corner: tuple[int, int]) -> None:
        gray = photograph()[0].astype(np.float64)
        sensitivity = np.ones_like(gray)
        y, x = corner
        sensitivity[y::2, x::2], sensitivity[1 - y :: 2, 1 - x :: 2] = 0.6, 0.8
        assert "raw colour mosaic (Bayer)" in refusal(
            tmp_path, encoded((gray * sensitivity).astype(np.uint8), "TIFF")
        )

    def test_a_raw_dng(self, tmp_path: Path) -> None:
        tags = TiffImagePlugin.ImageFileDirectory_v2()
        tags.tagtype[50706] = 1
        tags[50706] = b"\x01\x04\0\0"
        assert "raw DNG; develop it" in refusal(tmp_path, encoded(COLOUR, "TIFF", tiffinfo=tags))

    def test_several_images_in_a_tiff(self, tmp_path: Path) -> None:
        pages = [Image.fromarray(MOTTLED)]
        content = encoded(MOTTLED, "TIFF", save_all=True, append_images=pages)
        assert "several images" in refusal(tmp_path, content)

    def test_an_animated_png(self, tmp_path: Path) -> None:
        other = Image.fromarray(MOTTLED[::-1])
        assert "animated PNG" in refusal(
            tmp_path, encoded(MOTTLED, "PNG", save_all=True, append_images=[other])
        )

    def test_floating_point(self, tmp_path: Path) -> None:
        assert "floating-point" in refusal(tmp_path, encoded(MOTTLED.astype(np.float32), "TIFF"))

    def test_an_image_that_would_not_fit_into_memory(self, tmp_path: Path) -> None:
        content = bytearray(encoded(MOTTLED, "PNG"))
        content[16:24] = (200_000).to_bytes(4) * 2
        assert "200000×200000 px" in refusal(tmp_path, bytes(content))

    @pytest.mark.parametrize(
        "content", [b"", b"GIF89a" + bytes(100), b"\0\0\0\x18ftypheic" + bytes(100), bytes(64)]
    )
    def test_what_is_of_no_kind_that_is_read(self, tmp_path: Path, content: bytes) -> None:
        assert "expected a JPEG, PNG, TIFF, BMP, PGM, PPM or JPEG 2000" in refusal(tmp_path, content)
        with pytest.raises(UnknownFormatError):
            frame_size(tmp_path / "frame.img")

    def test_a_folder_and_a_file_that_is_not_there(self, tmp_path: Path) -> None:
        for path in (tmp_path, tmp_path / "none.jpg"):
            for read in (read_frame, frame_size):
                with pytest.raises(InputError, match="give the frames as files"):
                    read(path)

    @settings(max_examples=examples(40), suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(st.sampled_from(["JPEG", "PNG", "TIFF", "BMP", "PPM", "JPEG2000"]), st.data())
    def test_no_damage_raises_anything_but_a_parse_error(self, kind: str, data: st.DataObject) -> None:
        content = bytearray(encoded(COLOUR, kind))
        for _ in range(data.draw(st.integers(1, 8))):
            content[data.draw(st.integers(3, min(len(content) - 1, 700)))] = data.draw(st.integers(0, 255))
        damaged = bytes(content[: data.draw(st.integers(4, len(content)))])
        with contextlib.suppress(ParseError, UnknownFormatError):
            check_complete(damaged, read_head(damaged))


@pytest.mark.parametrize("kind", ["jpeg", "png", "tiff", "bmp", "pnm", "jp2"])
def test_a_file_that_ends_anywhere_is_told_and_read_to_the_end_it_is_whole(kind: str) -> None:
    out = io.BytesIO()
    Image.fromarray(MOTTLED).save(out, {"pnm": "ppm", "jp2": "jpeg2000"}.get(kind, kind))
    content = out.getvalue()
    whole = read_head(content)
    assert (whole.kind, whole.size, whole.channels, whole.bits) == (kind, (128, 96), 1, 8)
    check_complete(content, whole)
    for end in [*range(3, 200), len(content) - 13]:
        with pytest.raises((ParseError, UnknownFormatError)):
            check_complete(content[:end], read_head(content[:end]))


@pytest.mark.parametrize("segment", [b"\x00\xe0\x00\x10", b"\xff\xe0\x00\x01"])
def test_where_a_segment_of_a_jpeg_should_start_nothing_else_is_taken_for_one(segment: bytes) -> None:
    content = encoded(MOTTLED, "JPEG")
    with pytest.raises(ParseError, match="no JPEG segment at byte 20"):
        read_head(content[:20] + segment + content[20:])


def test_what_a_png_says_before_its_pixels_is_passed_over() -> None:
    out, words = io.BytesIO(), PngImagePlugin.PngInfo()
    words.add_text("Comment", "a board")
    Image.fromarray(MOTTLED).save(out, "png", pnginfo=words, dpi=(72, 72))
    content = out.getvalue()
    assert content.index(b"tEXt") < content.index(b"IDAT")
    assert read_head(content).size == (128, 96)


class TestSettings:
    CAMERA = CameraKey(make="Acme", model="A1", focal_mm=8.8, serial="ab12", firmware="1.0")

    def shot(self, **changes: object) -> Setting:
        given: dict[str, object] = {
            "camera": self.CAMERA,
            "image_size": (640, 480),
            "focus": "locked at infinity",
        }
        return Setting(**{**given, **changes})  # type: ignore[arg-type] # a table of cases

    def one_setting(self, odd: Setting) -> Setting:
        frames = {Path(f"a/IMG_{number}.jpg"): self.shot() for number in range(4)} | {Path("a/ODD.jpg"): odd}
        return the_one_setting(group_frames(frames, frames.__getitem__))

    @pytest.mark.parametrize(
        "changes",
        [
            {"camera": CameraKey(make="Acme", model="A1")},
            {"camera": CameraKey(firmware="1.0")},
            {"focus": None},
        ],
    )
    def test_a_frame_that_states_less_is_of_the_same(self, changes: dict[str, object]) -> None:
        assert self.one_setting(self.shot(**changes)) == self.shot()

    def test_frames_alike_have_one(self) -> None:
        assert self.one_setting(self.shot()) == self.shot()

    @pytest.mark.parametrize(
        ("changes", "expected"),
        [
            (
                {"image_size": (480, 640)},
                "2 sizes: 4 of 640×480 px (IMG_0.jpg, IMG_1.jpg, IMG_2.jpg, …); 1 of 480×640 px",
            ),
            (
                {"camera": CameraKey(make="Acme", model="A2")},
                "2 cameras: 4 of model A1 (IMG_0.jpg, IMG_1.jpg, IMG_2.jpg, …); 1 of model A2",
            ),
            (
                {"camera": CameraKey(make="Acme", model="A1", focal_mm=8.8, serial="ff00", firmware="1.0")},
                "1 of serial ff00 (ODD.jpg); calibrate one camera at a time, or, if they are of one, say so with "
                "--serial",
            ),
            ({"focus": "1.5 m"}, "2 focus settings: 4 of locked at infinity"),
            (
                {"camera": CameraKey(make="Acme", model="A1", capture_mode="dewarped")},
                "4 of capture-mode none",
            ),
        ],
    )
    def test_frames_that_differ_are_named(self, changes: dict[str, object], expected: str) -> None:
        with pytest.raises(InputError) as caught:
            self.one_setting(self.shot(**changes))
        assert expected in str(caught.value)
        assert "(ODD.jpg)" in str(caught.value)

    def test_no_frames_have_none(self) -> None:
        with pytest.raises(InputError, match="no frames"):
            the_one_setting({})


def test_the_most_common_size_wins_and_a_tie_is_a_question(tmp_path: Path) -> None:
    paths = [tmp_path / f"{number}.png" for number in range(4)]
    for path, size in zip(paths, [(400, 300), (200, 150), (400, 300)], strict=False):
        Image.new("L", size).save(path)
    paths[3].write_bytes(b"no image")
    most, kept, others = of_most_common_size(paths)
    assert most == (400, 300)
    # What cannot be read is left for the search to tell of.
    assert kept == (paths[0], paths[2], paths[3])
    assert others == {paths[1]: (200, 150)}
    with pytest.raises(InputError, match="neither is the size of most"):
        of_most_common_size(paths[:2])
