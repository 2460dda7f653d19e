"""Pieces of a run."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture

from calibrary.jobs.demo.flight import farmland
from calibrary.jobs.images.observation import Image
from calibrary.jobs.images.reading import Unit, batches, here, read_images
from calibrary.parsers.imagery import reader
from calibrary.parsers.imagery.source import Block, Source
from calibrary.parsers.imagery.thumbnail import shows_whole_frame
from calibrary.synthetic import ExifValue, Head, headed, jpeg

IMAGES = [Image(f"{number:05}.jpg", f"/flight/{number:05}.jpg") for number in range(5000)]


def test_every_image_is_in_one_piece_in_its_order() -> None:
    assert [image for unit in batches(IMAGES, 64) for image in unit.images] == IMAGES


def test_a_piece_goes_to_another_process_and_back() -> None:
    unit = Unit((Image("caf\udce9.jpg", "/caf\udce9.jpg", "/b"), Image("b", "/b")))
    assert Unit.unpickled(unit.pickled()) == unit


def resized(folder: Path, cropped: tuple[int, ...] = ()) -> list[Image]:
    """A flight of 6 images that were resized by half, or cropped to it, with the thumbnails of the camera."""
    exif: dict[str, ExifValue] = {
        "Make": "Acme",
        "Model": "Nine",
        "ExifImageWidth": 800,
        "ExifImageHeight": 600,
    }
    whole = farmland((800, 600), seed=5)
    thumbnail = jpeg(np.asarray(Picture.fromarray(whole).resize((160, 120))), 80)
    small, part = np.asarray(Picture.fromarray(whole).resize((400, 300))), whole[150:450, 200:600]
    names = [f"{number}.jpg" for number in range(6)]
    for number, name in enumerate(names):
        pixels = jpeg(part if number in cropped else small, 80)
        (folder / name).write_bytes(headed(pixels, Head(exif=exif, thumbnail=thumbnail)))
    return [Image(name, str(folder / name)) for name in names]


def shown(images: list[Image]) -> dict[str, bool | None]:
    seen = read_images(images, engine=here(1, known=len(images))).images.settled().seen
    return {name: one.metadata.whole_frame for one, names in seen.items() for name in names.listed}


def test_the_pixels_of_two_images_tell_of_a_whole_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def counted(source: Source, exif: Block) -> bool | None:
        asked.append(source.name)
        return shows_whole_frame(source, exif)

    monkeypatch.setattr(reader, "shows_whole_frame", counted)
    images = resized(tmp_path)
    assert shown(images) == {image.name: True for image in images}
    assert len(asked) == 2


def test_each_image_is_asked_where_one_of_two_is_a_crop(tmp_path: Path) -> None:
    images = resized(tmp_path, cropped=(2, 5))
    assert shown(images) == {image.name: image.name not in {"2.jpg", "5.jpg"} for image in images}
