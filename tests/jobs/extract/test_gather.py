"""Finding images and reading their heads, by one process or several."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from calibrary.errors import InputError
from calibrary.jobs.images.folders import find_images
from calibrary.jobs.images.listing import Listing
from calibrary.jobs.images.reading import BATCH, gather, here, read_images
from tests.jobs.extract.fleet import NOBODY, P4R, gate, picture


def names(folder: Path, *, recursive: bool = False) -> list[str]:
    return [path.relative_to(folder).as_posix() for path in find_images(folder, recursive=recursive)]


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    """Three batches of images of two cameras in three states, some of them corrupt."""
    for number in range(2 * BATCH + 10):
        path = tmp_path / f"{number:04}.jpg"
        if number % 50 == 7:
            path.write_bytes(b"\xff\xd8\xff\xe1 cut off")
        elif number % 3:
            picture(path, (64, 48), **P4R, software=f"v{number % 2}")
        else:
            picture(path, (64, 48), **NOBODY)
    return tmp_path


def test_images_are_found_by_suffix_in_any_case_and_in_a_fixed_order(tmp_path: Path) -> None:
    for name in ("b.JPG", "a.jpeg", "c.tif", "d.DNG", "e.heic", "f.png", "notes.txt", "K.npy", "jpg"):
        (tmp_path / name).touch()
    assert names(tmp_path) == ["a.jpeg", "b.JPG", "c.tif", "d.DNG", "e.heic", "f.png"]


def test_hidden_files_and_folders_are_left_alone(tmp_path: Path) -> None:
    for name in ("._a.jpg", ".thumbs/b.jpg", "day/.c.jpg", "day/d.jpg"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    assert names(tmp_path, recursive=True) == ["day/d.jpg"]


def test_sub_folders_are_entered_only_when_asked(tmp_path: Path) -> None:
    (tmp_path / "100MEDIA").mkdir()
    (tmp_path / "100MEDIA/a.jpg").touch()
    assert names(tmp_path) == []
    assert names(tmp_path, recursive=True) == ["100MEDIA/a.jpg"]


def test_a_link_to_a_folder_is_not_followed(tmp_path: Path) -> None:
    (tmp_path / "day").mkdir()
    (tmp_path / "day/a.jpg").touch()
    (tmp_path / "day/again").symlink_to(tmp_path / "day", target_is_directory=True)
    assert names(tmp_path, recursive=True) == ["day/a.jpg"]


@pytest.mark.parametrize("made", [False, True])
def test_a_folder_that_is_none_is_named(tmp_path: Path, made: bool) -> None:
    path = tmp_path / "flight"
    if made:
        path.touch()
    with pytest.raises(InputError, match="not a directory" if made else "does not exist") as caught:
        find_images(path, recursive=False)
    assert str(path) in str(caught.value)


def test_a_folder_without_images_says_where_they_may_be(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--recursive"):
        gate(tmp_path)
    with pytest.raises(InputError, match="no images") as caught:
        gate(tmp_path, recursive=True)
    assert "--recursive" not in str(caught.value)


def test_a_corrupt_image_is_a_row_with_its_reason(flight: Path) -> None:
    outcome = gate(flight)
    assert [row.name for row in outcome.rejected] == ["0007.jpg", "0057.jpg", "0107.jpg"]
    assert all(row.reason for row in outcome.rejected)
    assert sum(len(camera.camera.names) for camera in outcome.judged) == 2 * BATCH + 7


def test_what_cannot_be_opened_is_a_row_as_well(tmp_path: Path) -> None:
    picture(tmp_path / "good.jpg", **P4R)
    (tmp_path / "gone.jpg").symlink_to(tmp_path / "nowhere")
    os.mkfifo(tmp_path / "pipe.jpg")
    (tmp_path / "folder.jpg").mkdir()
    (tmp_path / "empty.jpg").touch()
    rows = {row.name: row.reason for row in gate(tmp_path).rejected}
    assert list(rows) == ["empty.jpg", "gone.jpg", "pipe.jpg"]
    assert "pipe" in rows["pipe.jpg"]
    assert "empty" in rows["empty.jpg"]


def test_an_image_whose_exif_is_of_another_frame_is_set_aside(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg", (3840, 2160), **P4R, pixel_size=(5472, 3648))
    outcome = gate(tmp_path)
    assert outcome.judged == ()
    assert outcome.exit_code == 1
    [row] = outcome.rejected
    assert "5472×3648" in row.reason
    assert "3840×2160" in row.reason


def test_two_workers_find_what_one_finds(flight: Path) -> None:
    alone, together = gate(flight, workers=1), gate(flight, workers=2)
    assert alone == together
    assert [c.slug for c in alone.judged] == [c.slug for c in together.judged]


def test_what_is_kept_grows_with_the_states_and_not_with_the_images(flight: Path) -> None:
    gathered = gather(find_images(flight, recursive=False), flight)
    assert len(gathered.states) == 3


@pytest.mark.parametrize("workers", [1, 2])
def test_progress_adds_up_to_the_number_that_was_announced(flight: Path, workers: int) -> None:
    steps: list[tuple[int, int, str]] = []
    gate(flight, workers=workers, progress=lambda *printed: steps.append(printed))
    total = 2 * BATCH + 10
    assert steps == [(done, total, "images") for done in (0, BATCH, 2 * BATCH, total)]


@pytest.mark.parametrize("workers", [1, 2])
def test_reading_leaves_off_after_the_first_rejected_image(flight: Path, workers: int) -> None:
    steps: list[int] = []
    images = Listing([flight], recursive=False)
    found = read_images(
        images, engine=here(workers, known=images.known), progress=steps.append, stop_at_first=True
    )
    assert [row.name for row in found.images.settled().unread] == ["0007.jpg", "0057.jpg"]
    assert steps == [BATCH]
