"""Check of a flight in a real browser: by a path and by dropped files, with the result of the command and its files."""

from __future__ import annotations

import json
import os
import tempfile
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from calibrary.errors import InputError
from calibrary.jobs.desk.flights import LARGEST_BESIDE, Drop
from tests.cli.registry.fleets import xml
from tests.jobs.desk.conftest import Tab
from tests.jobs.extract.fleet import DEWARP, NOBODY, P4R, picture
from tests.pages.test_in_chromium import PHONE, faults
from tests.pages.test_in_chromium import pytestmark as only_where_a_browser_is

if TYPE_CHECKING:
    from tests.conftest import Flight

pytestmark = only_where_a_browser_is
Open = Callable[..., Tab]


def by_path(one: Tab, place: Path | str, *, program: str = "no program") -> None:
    one.page.goto(f"{one.home}/flight")
    form = one.page.locator("form[action='/flight']")
    form.get_by_label("Folder or address").fill(str(place))
    form.get_by_label("Also files for").select_option(label=program)
    form.locator("button").click()


def dropped(one: Tab, files: list[Any]) -> None:
    one.page.goto(f"{one.home}/flight")
    one.page.locator("input[type=file]").set_input_files(files)
    one.page.get_by_role("button", name="Check these images").click()


def kept(one: Tab, folder: Path) -> dict[str, bytes]:
    """What a check gives to take along, once it is over."""
    one.page.get_by_role("link", name="Everything as a zip").wait_for(timeout=90_000)
    with one.page.expect_download() as download:
        one.page.get_by_role("link", name="Everything as a zip").click()
    download.value.save_as(folder / "flight.zip")
    with zipfile.ZipFile(folder / "flight.zip") as file:
        return {name: file.read(name) for name in file.namelist()}


def judged(files: dict[str, bytes]) -> dict[str, tuple[str, object, object]]:
    report = json.loads(files["K_matrix.json"])
    return {one["id"]: (one["verdict"], one["calibration"], one["use"]) for one in report["cameras"]}


def test_dropped_files_get_the_answer_of_their_folder(tab: Open, demo_flight: Flight, tmp_path: Path) -> None:
    one = tab()
    by_path(one, demo_flight[0])
    of_folder = kept(one, tmp_path)
    said = one.page.locator("main").inner_text()
    assert "11 cameras, judged by the fleet policy" in one.page.locator("body").inner_text()
    advice = [each["what_to_do"] for each in json.loads(of_folder["K_matrix.json"])["cameras"]]
    assert [text for text in advice if text and text not in said] == []
    dropped(one, [path for path in demo_flight[0].rglob("*") if path.is_file()])
    of_files = kept(one, tmp_path)
    assert judged(of_files) == judged(of_folder)
    assert len(judged(of_files)) == 11
    assert b"<title>" in of_files["report.html"]
    assert one.complaints == []


def test_a_program_gets_its_files(tab: Open, tmp_path: Path) -> None:
    picture(tmp_path / "flight/a.jpg", **P4R, dewarp=DEWARP)
    one = tab()
    by_path(one, tmp_path / "flight", program="odm")
    assert "cameras.json" in kept(one, tmp_path)
    command = one.page.locator("pre", has_text="calibrary extract").first.inner_text()
    assert command.endswith("--out K_matrix.npy --html report.html --to odm")


def test_of_large_images_only_what_is_read_is_sent(
    tab: Open, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    files, taken, take = [], list[int](), Drop.take
    for number in range(30):
        files.append(picture(tmp_path / f"{number:02}.jpg", **P4R, dewarp=DEWARP))
        with files[-1].open("ab") as file:
            file.write(bytes(2 << 20))

    def counted(drop: Drop, body: bytes) -> object:
        taken.append(len(body))
        return take(drop, body)

    monkeypatch.setattr(Drop, "take", counted)
    one = tab()
    dropped(one, files)
    [(verdict, _, _)] = judged(kept(one, tmp_path)).values()
    assert verdict == "valid"
    assert 30 * 60_000 < sum(taken) < 30 * 70_000


def test_a_calibration_file_beside_the_images_is_weighed(tab: Open, tmp_path: Path) -> None:
    image = picture(tmp_path / "a.jpg", **NOBODY)
    one = tab()
    dropped(one, [image, xml(tmp_path / "camera.xml", 5473.0)])
    [(_, calibration, _)] = judged(kept(one, tmp_path)).values()
    assert "camera.xml" in json.dumps(calibration) + one.page.content()


def test_names_of_files_are_no_paths(tab: Open, tmp_path: Path) -> None:
    data = picture(tmp_path / "a.jpg", **P4R, dewarp=DEWARP).read_bytes()
    names = (
        "../../../up.jpg",
        "..\\..\\up.jpg",
        "CON.jpg",
        "gpj.\u202eexe.jpg",
        "<img src=x onerror=alert(1)>.jpg",
        f"{'図' * 90}.jpg",
        "a.jpg",
        "A.jpg",
    )
    one = tab()
    dropped(one, [{"name": name, "mimeType": "image/jpeg", "buffer": data} for name in names])
    kept(one, tmp_path)
    assert "1 camera, judged by the fleet policy" in one.page.locator("body").inner_text()
    assert "\u202e" not in one.page.content()
    assert one.complaints == []


@pytest.mark.parametrize(
    ("place", "said"),
    [("flight", "expected the whole path"), ("/no/such/folder", "no such folder"), ("--help", "whole path")],
)
def test_a_place_that_is_none_is_told(tab: Open, place: str, said: str) -> None:
    one = tab()
    by_path(one, place)
    assert said in one.page.locator("main").inner_text()


def test_a_folder_without_images_says_so(tab: Open, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    one = tab()
    by_path(one, tmp_path / "empty")
    one.page.get_by_text("There is no result.").wait_for(timeout=60_000)
    assert "contains no images" in one.page.locator("main").inner_text()


def test_a_check_is_stopped(tab: Open, tmp_path: Path) -> None:
    image = picture(tmp_path / "a.jpg", **P4R, dewarp=DEWARP)
    (tmp_path / "flight").mkdir()
    for number in range(20_000):
        os.link(image, tmp_path / f"flight/{number}.jpg")
    one = tab()
    by_path(one, tmp_path / "flight")
    one.page.get_by_role("button", name="Stop").click()
    one.page.get_by_text("Stopped; nothing was kept.").wait_for(timeout=60_000)


def test_a_drop_is_stopped(tab: Open, tmp_path: Path) -> None:
    files = [picture(tmp_path / f"{number:03}.jpg", **P4R) for number in range(60)]
    one = tab()
    one.page.route("**/flight/drop/*", lambda _: None)
    dropped(one, files)
    with one.page.expect_response("**/stop"):
        one.page.get_by_role("button", name="Stop").click()
    one.page.get_by_text("stopped; nothing was kept").wait_for()
    assert [*Path(tempfile.gettempdir()).glob(f"calibrary-desk-{os.getpid()}-*/*/dropped")] == []
    one.page.unroute("**/flight/drop/*")
    dropped(one, files[:1])
    assert len(judged(kept(one, tmp_path))) == 1


def test_without_scripts_a_folder_is_checked_to_its_end(tab: Open, tmp_path: Path) -> None:
    picture(tmp_path / "flight/a.jpg", **P4R, dewarp=DEWARP)
    one = tab(scripts=False)
    by_path(one, tmp_path / "flight")
    one.page.get_by_role("link", name="Everything as a zip").wait_for(timeout=90_000)


def test_pages_are_quiet_small_and_readable(tab: Open, demo_flight: Flight, tmp_path: Path) -> None:
    one = tab()
    one.page.goto(f"{one.home}/flight")
    assert faults(one.page) == []
    by_path(one, demo_flight[0])
    kept(one, tmp_path)
    assert len(one.page.content().encode()) < 300_000
    assert faults(one.page) == []
    one.page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
    assert one.page.evaluate("document.documentElement.scrollWidth") == PHONE[0]
    one.page.get_by_role("link", name="The whole report").click()
    assert len(one.page.content().encode()) < 300_000
    assert one.complaints == []


def message(heads: object, data: bytes = b"") -> bytes:
    head = json.dumps(heads).encode()
    return len(head).to_bytes(4, "big") + head + data


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"\xff\xff\xff\xff{",
        message({"number": 1}),
        message([[0, "a.jpg", 10, [[0, 11]]]], bytes(11)),
        message([[0, "a.jpg", 10, [[-1, 5]]]], bytes(6)),
        message([[0, "a.jpg", 10, [[0, 10]]]], bytes(5)),
        message([[5, "a.jpg", 10, [[0, 10]]]], bytes(10)),
        message([[-1, "a.jpg", 10, [[0, 10]]]], bytes(10)),
    ],
)
def test_what_the_page_does_not_send_is_refused(tmp_path: Path, body: bytes) -> None:
    with pytest.raises(InputError):
        Drop(tmp_path, 1).take(body)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_what_is_too_large_for_a_calibration_is_left_out(tmp_path: Path) -> None:
    drop = Drop(tmp_path, 1)
    assert drop.take(message([[0, "film.mp4", LARGEST_BESIDE + 1, [[0, 4]]]], b"ftyp")) == []
    assert (drop.done, drop.left_out) == (1, ["film.mp4"])
    assert [*drop.folder.iterdir()] == []
