"""Pieces of a run, and what an earlier run made of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture

from calibrary.errors import InputError
from calibrary.jobs.demo.flight import farmland
from calibrary.jobs.extract.report import encode
from calibrary.jobs.images import reading
from calibrary.jobs.images.accumulator import Accumulator
from calibrary.jobs.images.observation import Image, Observation
from calibrary.jobs.images.reading import Partials, Question, Unit, batches, here, read_images, shards
from calibrary.parsers.imagery import reader
from calibrary.parsers.imagery.source import Block, Source
from calibrary.parsers.imagery.thumbnail import shows_whole_frame
from calibrary.records import to_json
from calibrary.synthetic import ExifValue, Head, headed, jpeg
from tests.jobs.extract.fleet import DEWARP, P4R, gate, picture

IMAGES = [Image(f"{number:05}.jpg", f"/flight/{number:05}.jpg") for number in range(5000)]


def keys(images: list[Image]) -> set[str | None]:
    return {unit.key for unit in shards(images, 100)}


def test_every_image_is_in_one_piece_in_its_order() -> None:
    for made in (batches(IMAGES, 64), shards(IMAGES, 100)):
        assert [image for unit in made for image in unit.images] == IMAGES


def test_a_new_image_changes_the_shard_it_is_in_and_no_other() -> None:
    added = [Image("0.jpg", "/flight/0.jpg"), *IMAGES]
    assert len(keys(IMAGES)) > 30
    assert len(keys(IMAGES) - keys(added)) == 1


def test_an_image_that_was_changed_is_another_piece() -> None:
    assert keys([Image("a", "/a", version="1")]) != keys([Image("a", "/a", version="2")])


def test_a_piece_goes_to_another_process_and_back() -> None:
    unit = Unit((Image("caf\udce9.jpg", "/caf\udce9.jpg", "/b", "3"), Image("b", "/b")), "key")
    assert Unit.unpickled(unit.pickled()) == unit


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    for number in range(60):
        picture(tmp_path / "im" / f"{number:02}.jpg", **P4R, dewarp=DEWARP if number % 2 else None)
    (tmp_path / "im" / "broken.jpg").write_bytes(b"no image")
    return tmp_path / "im"


def report(folder: Path, **request: object) -> bytes:
    return encode(to_json(gate(folder, **request)))


def test_a_run_that_was_interrupted_reads_only_what_is_missing(
    flight: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reading, "shards", lambda images: shards(images, 8))
    kept, whole, read = tmp_path / "kept", report(flight), []

    def counted(image: Image, **asked: bool) -> Observation:
        read.append(image.name)
        if interrupted and len(read) > 30:
            raise KeyboardInterrupt
        return observed(image, **asked)

    observed, interrupted = reading._read, True
    monkeypatch.setattr(reading, "_read", counted)
    with pytest.raises(KeyboardInterrupt):
        report(flight, partials=kept)
    before = len(read)
    interrupted = False
    assert report(flight, partials=kept) == whole
    assert before < len(read) < 61 + before
    done = len(read)
    assert report(flight, partials=kept) == whole
    assert len(read) == done
    picture(flight / "07.jpg", **P4R, software="v2")
    assert report(flight, partials=kept) == report(flight) != whole
    assert all(path.suffix == ".part" for path in kept.iterdir())


def test_what_is_damaged_or_asks_less_is_read_again(flight: Path, tmp_path: Path) -> None:
    kept, whole = tmp_path / "kept", report(flight)
    assert report(flight, partials=kept) == whole
    # Where the folder lies decides how many shards there are.
    for path in kept.iterdir():
        path.write_bytes(path.read_bytes()[:100])
    assert report(flight, partials=kept) == whole
    images = [Image(one.name, str(one)) for one in sorted(flight.iterdir())]
    found = read_images(images, Question(list_all=False), engine=here(1, known=61), partials=kept)
    assert not found.images.list_all


def test_what_another_attempt_may_read_is_not_kept(tmp_path: Path) -> None:
    part, unit = Accumulator(), Unit((IMAGES[0],), "key")
    part.add(Observation(id=IMAGES[0].id, name="a", reason="503", passing=True))
    partials = Partials(tmp_path, "asked")
    partials.put(unit, part)
    assert partials.get(unit) is None


def test_a_file_is_no_place_for_partial_results(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match="expected a folder"):
        Partials(tmp_path / "file", "asked")


def test_shards_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reading, "MOST", 1)
    assert max(len(unit.images) for unit in shards(IMAGES, 100)) == 100


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
