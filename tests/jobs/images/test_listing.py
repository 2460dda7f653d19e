"""Which images are meant, and that each is looked for once."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from calibrary.jobs.extract.report import encode
from calibrary.jobs.extract.run import run
from calibrary.jobs.images import folders, listing
from calibrary.jobs.images.listing import Listing
from calibrary.records import to_json
from tests.jobs.extract.fleet import DEWARP, P4R, gate, picture


def names(given: list[Path], *, recursive: bool = False) -> list[str]:
    return [image.name for image in Listing(given, recursive=recursive)]


def test_names_are_told_below_the_folder_or_below_what_several_have_in_common(tmp_path: Path) -> None:
    for name in ("a/1.jpg", "b/c/2.jpg"):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).touch()
    assert names([tmp_path], recursive=True) == ["a/1.jpg", "b/c/2.jpg"]
    assert names([tmp_path / "a", tmp_path / "b/c/2.jpg"]) == ["a/1.jpg", "b/c/2.jpg"]
    assert names([tmp_path / "b/c/2.jpg"]) == ["2.jpg"]


def test_one_image_has_one_id_however_it_is_reached(tmp_path: Path) -> None:
    (tmp_path / "day").mkdir()
    (tmp_path / "day/a.jpg").touch()
    (tmp_path / "day/b.jpg").write_bytes((tmp_path / "day/a.jpg").read_bytes())
    (tmp_path / "day/link.jpg").symlink_to("a.jpg")
    (tmp_path / "again").symlink_to("day", target_is_directory=True)
    by_name = {image.name: image.id for image in Listing([tmp_path / "day"], recursive=False)}
    assert by_name["a.jpg"] == by_name["link.jpg"] != by_name["b.jpg"]
    roundabout = [
        tmp_path / "again" / "a.jpg",
        tmp_path / "day/../day/link.jpg",
        Path(os.path.relpath(tmp_path)) / "again",
    ]
    assert {image.id for image in Listing(roundabout, recursive=False)} == {
        by_name["a.jpg"],
        by_name["b.jpg"],
    }


def test_an_image_that_is_given_twice_counts_once(tmp_path: Path) -> None:
    first = picture(tmp_path / "a.jpg", **P4R, dewarp=DEWARP)
    picture(tmp_path / "b.jpg", **P4R, dewarp=DEWARP)
    once = gate(tmp_path)
    twice = run(tmp_path, first, tmp_path / "b.jpg", first)
    assert encode(to_json(twice)) == encode(to_json(once))
    assert twice.images == 2


def test_the_order_of_a_list_changes_nothing(tmp_path: Path) -> None:
    """Two calibrations of equally many images: by arrival one or the other would stand for the camera."""
    one = picture(tmp_path / "a.jpg", **P4R, dewarp=DEWARP)
    other = picture(tmp_path / "b.jpg", **P4R, dewarp=DEWARP.replace("3660.5", "3664.0"))
    reports = [encode(to_json(run(*order))) for order in ((one, other), (other, one))]
    assert reports[0] == reports[1]


def test_a_folder_is_gone_through_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    picture(tmp_path / "a.jpg", **P4R)
    (tmp_path / "sub").mkdir()
    picture(tmp_path / "sub/b.jpg", **P4R)
    (tmp_path / "sub/camera.xml").write_text("<nothing/>")
    scanned: list[str] = []
    entries = folders._entries

    def counted(directory: Path | str) -> list[os.DirEntry[str]]:
        scanned.append(Path(directory).name)
        return entries(directory)

    monkeypatch.setattr(folders, "_entries", counted)
    gate(tmp_path, recursive=True)
    assert scanned == [tmp_path.name, "sub"]


def test_of_very_many_images_no_list_is_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(listing, "LISTED", 5)
    for number in range(9):
        (tmp_path / f"{number}.jpg").touch()
    images = Listing([tmp_path], recursive=False)
    assert images.known is None
    assert sum(1 for _ in images) == 9


def test_files_that_may_be_calibrations_are_remembered_in_one_order(tmp_path: Path) -> None:
    for name in ("b/x.xml", "a.txt", "c.jpg", "b-1/y.xml", "z.pdf"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    images = Listing([tmp_path], recursive=True, keep=lambda entry: entry.name.endswith((".xml", ".txt")))
    assert [image.name for image in images] == ["c.jpg"]
    assert [path.relative_to(tmp_path).as_posix() for path in images.other_files] == [
        "a.txt",
        "b/x.xml",
        "b-1/y.xml",
    ]
