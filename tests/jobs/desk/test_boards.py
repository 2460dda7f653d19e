"""Boards in a real browser: frames that are watched as they arrive, solved, and proposed once that is confirmed."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

import calibrary
from calibrary.registry.entry import Status
from tests.jobs.calibrate.boards import frames
from tests.jobs.desk.conftest import Tab
from tests.pages.test_in_chromium import PHONE, faults
from tests.pages.test_in_chromium import pytestmark as only_where_a_browser_is

pytestmark = only_where_a_browser_is
Open = Callable[..., Tab]
BOARD = "checkerboard:9x6"
CAMERA = "example/board_one"


@pytest.fixture(scope="module")
def taken(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return frames(tmp_path_factory.mktemp("taken"), 8)


def asked(one: Tab, form: str, **answers: str) -> None:
    one.page.goto(f"{one.home}/boards")
    place = one.page.locator(f"form[action='{form}']")
    for name, text in answers.items():
        place.locator(f"[name='{name}']").fill(text)
    place.locator("button").click()


def test_frames_of_a_folder_are_solved_and_proposed_once_it_is_confirmed(
    tab: Open, fleet: Path, taken: list[Path]
) -> None:
    one, before = tab(), calibrary.open_registry(fleet).commit
    asked(one, "/boards", place=str(taken[0].parent), board=BOARD)
    one.page.get_by_role("button", name="Propose it").wait_for(timeout=120_000)
    shown = one.page.locator("main").inner_text()
    assert "start from it" in shown
    assert calibrary.open_registry(fleet).commit == before
    one.page.get_by_role("link", name="The whole report").click()
    assert "frame_00.jpg" in one.page.content()
    one.page.go_back()
    one.page.get_by_label("Why, for the history").fill("new lens")
    one.page.get_by_role("button", name="Propose it").click()
    one.page.get_by_text("not used until it is approved").wait_for(timeout=120_000)
    entry = calibrary.open_registry(fleet).registry.get(CAMERA).entry
    assert entry.status is Status.DRAFT
    assert f"{entry.calibration.intrinsics.fx:.0f}" in shown
    assert {one.name for one in entry.calibration.provenance.sources} == {path.name for path in taken}
    assert one.complaints == []


def test_dropped_frames_are_solved(tab: Open, taken: list[Path]) -> None:
    one = tab()
    one.page.goto(f"{one.home}/boards")
    form = one.page.locator("form[data-drops]")
    form.locator("input[type=file]").set_input_files(taken)
    form.get_by_role("button", name="Solve these frames").click()
    one.page.get_by_role("button", name="Propose it").wait_for(timeout=120_000)
    assert "Example Board One" in one.page.locator("h1").inner_text()


def test_a_folder_is_watched_while_frames_arrive(tab: Open, taken: list[Path], tmp_path: Path) -> None:
    arriving = tmp_path / "DCIM"
    arriving.mkdir()
    one = tab()
    asked(one, "/boards/watch", place=str(arriving), board=BOARD)
    one.page.get_by_text("No frame has arrived yet.").wait_for()
    shutil.copy(taken[0], arriving)
    one.page.get_by_text("1 of 1 frames count").wait_for(timeout=60_000)
    assert one.page.locator("svg.plot").count() == 1
    for path in taken[1:5]:
        shutil.copy(path, arriving)
    one.page.get_by_text("5 of 5 frames count").wait_for(timeout=120_000)
    assert "The largest σ over the frame is then expected" in one.page.locator("main").inner_text()
    assert faults(one.page) == []
    one.page.get_by_role("button", name="Stop").click()
    one.page.get_by_role("button", name="Solve these frames").click(timeout=60_000)
    one.page.get_by_role("heading", name="Board in").wait_for(timeout=120_000)
    assert one.complaints == []


def test_what_cannot_be_solved_says_why_and_asks_again(tab: Open, fleet: Path, tmp_path: Path) -> None:
    one = tab()
    (tmp_path / "empty").mkdir()
    asked(one, "/boards", place=str(tmp_path / "empty"))
    one.page.get_by_text("There is no result.").wait_for(timeout=60_000)
    assert "a folder without images" in one.page.locator(".note").inner_text()
    assert one.page.get_by_role("button", name="Solve again").is_visible()
    assert fleet.exists()


def test_pages_are_quiet_small_and_readable(tab: Open) -> None:
    one = tab()
    one.page.goto(f"{one.home}/boards")
    assert faults(one.page) == []
    one.page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
    assert one.page.evaluate("document.documentElement.scrollWidth") == PHONE[0]
    assert one.complaints == []
