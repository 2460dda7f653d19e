"""A thumbnail tells a crop from a resized image: no crop is ever called the whole frame."""

from __future__ import annotations

import io
from pathlib import Path

import exifread
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from calibrary.evidence.originality import Pixels, originality
from calibrary.jobs.demo.flight import farmland
from calibrary.parsers.imagery import read_metadata
from calibrary.synthetic import ExifValue, Head, headed, jpeg

SIZE = (1600, 1200)
PICTURE = farmland(SIZE, seed=5)


def written(folder: Path, pixels: NDArray[np.uint8], thumbnail: NDArray[np.uint8] | None = None) -> Path:
    """An image that says that it is of :data:`SIZE`, with a thumbnail of the whole picture."""
    shown = np.asarray(Image.fromarray(PICTURE if thumbnail is None else thumbnail).resize((160, 120)))
    exif: dict[str, ExifValue] = {"Make": "Acme", "Model": "Nine"}
    exif |= {"ExifImageWidth": SIZE[0], "ExifImageHeight": SIZE[1]}
    path = folder / "a.jpg"
    path.write_bytes(headed(jpeg(pixels, 80), Head(exif=exif, thumbnail=jpeg(shown, 80))))
    return path


@pytest.mark.parametrize("size", [(800, 600), (400, 300), (1200, 900)])
def test_an_image_that_was_resized_is_the_whole_frame(tmp_path: Path, size: tuple[int, int]) -> None:
    metadata = read_metadata(written(tmp_path, np.asarray(Image.fromarray(PICTURE).resize(size))))
    assert metadata.whole_frame is True
    assert originality(metadata).pixels is Pixels.ALTERED
    assert originality(metadata).done == ()


@pytest.mark.parametrize("share", [0.95, 0.9, 0.75, 0.5, 0.3])
@pytest.mark.parametrize("corner", [0.0, 0.5, 1.0])
def test_a_crop_is_not_the_whole_frame(tmp_path: Path, share: float, corner: float) -> None:
    width, height = round(SIZE[0] * share / 8) * 8, round(SIZE[1] * share / 6) * 6
    left, top = round((SIZE[0] - width) * corner), round((SIZE[1] - height) * corner)
    metadata = read_metadata(written(tmp_path, PICTURE[top : top + height, left : left + width]))
    assert metadata.whole_frame is not True
    assert originality(metadata).done


def test_a_crop_that_the_thumbnail_shows_is_called_one(tmp_path: Path) -> None:
    metadata = read_metadata(written(tmp_path, PICTURE[150:1050, 200:1400]))
    assert metadata.whole_frame is False
    assert originality(metadata).done[0].startswith("cropped")


def test_a_thumbnail_of_something_else_tells_nothing(tmp_path: Path) -> None:
    other = np.random.default_rng(3).integers(0, 255, (120, 160, 3), dtype=np.uint8)
    metadata = read_metadata(
        written(tmp_path, np.asarray(Image.fromarray(PICTURE).resize((800, 600))), other)
    )
    assert metadata.whole_frame is None


def test_an_image_of_the_size_that_exif_states_is_not_decoded(tmp_path: Path) -> None:
    assert read_metadata(written(tmp_path, PICTURE)).whole_frame is None


def test_pixels_that_cannot_be_decoded_tell_nothing(tmp_path: Path) -> None:
    path = written(tmp_path, np.asarray(Image.fromarray(PICTURE).resize((800, 600))))
    data = path.read_bytes()
    path.write_bytes(data[: data.rfind(b"\xff\xda") + 20])
    assert read_metadata(path).whole_frame is not True


def test_the_thumbnail_is_one_that_other_programs_read(tmp_path: Path) -> None:
    with written(tmp_path, PICTURE).open("rb") as file:
        found = exifread.process_file(file)["JPEGThumbnail"]
    with Image.open(io.BytesIO(found)) as shown:
        assert shown.size == (160, 120)
