"""The desk in a real browser, as a person works with it: from a click to the file on disk."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import calibrary
from tests.jobs.desk.conftest import Tab
from tests.jobs.extract.fleet import DEWARP, P4R, picture
from tests.jobs.site.fleet import HOSTILE
from tests.pages.test_in_chromium import PHONE, faults
from tests.pages.test_in_chromium import pytestmark as only_where_a_browser_is

pytestmark = only_where_a_browser_is
Open = Callable[..., Tab]
CAMERA = "dji/fc6310r/5472x3648+f8.8"
PAGES = {
    "start": "/",
    "answer": f"/?q={CAMERA}",
    "camera": f"/cameras/{CAMERA}.html",
    "none": "/?q=nothing",
    "known": "/?q=mavic",
}


def look_up(tab: Tab, words: str) -> None:
    tab.page.get_by_label("Camera", exact=True).fill(words)
    with tab.page.expect_navigation():
        tab.page.keyboard.press("Enter")


def test_a_part_of_a_name_gives_k_and_its_file(tab: Open, fleet: Path, tmp_path: Path) -> None:
    one = tab()
    look_up(one, "6310r/5472")
    assert "3665.60 ± 0.30 px" in one.page.locator("main").inner_text()
    with one.page.expect_download() as download:
        one.page.get_by_role("link", name="OpenCV", exact=True).click()
    download.value.save_as(tmp_path / "camera.yml")
    [read] = calibrary.read_all(tmp_path / "camera.yml")
    used = calibrary.open_registry(fleet).resolve(CAMERA).calibration
    assert used is not None
    np.testing.assert_array_equal(read.intrinsics.matrix, used.intrinsics.matrix)
    assert one.complaints == []


def test_a_day_decides_and_the_command_says_the_same(tab: Open, fleet: Path) -> None:
    one = tab()
    one.page.get_by_label("Day").fill("2026-05-01")
    look_up(one, CAMERA)
    said = one.page.locator("pre", has_text="registry resolve").inner_text()
    assert said == f"calibrary registry resolve {CAMERA} --on 2026-05-01 --registry {fleet}"


def test_an_answer_has_an_address_to_send_on(tab: Open) -> None:
    one, other = tab(), tab()
    look_up(one, CAMERA)
    address = one.page.get_by_role("link", name="address of this answer").get_attribute("href") or ""
    other.page.goto(other.home + address)
    assert "3665.60" in other.page.locator("main").inner_text()


@pytest.mark.parametrize("name", ["DJI_0001.JPG", "gpj.\u202e<img src=x onerror=alert(1)>.JPG"])
def test_one_image_finds_its_k_whatever_it_is_called(tab: Open, tmp_path: Path, name: str) -> None:
    image = picture(tmp_path / "image.jpg", **P4R, dewarp=DEWARP)
    one = tab()
    one.page.locator("input[type=file]").set_input_files(
        {"name": name, "mimeType": "image/jpeg", "buffer": image.read_bytes()}
    )
    one.page.get_by_role("button", name="Look up this image").click()
    assert "Which K for" in one.page.locator("h1").inner_text()
    assert "\u202e" not in one.page.content()
    assert "3665.60" in one.page.locator("main").inner_text()
    assert "DewarpData" in one.page.locator("main").inner_text()
    assert one.complaints == []


def test_an_image_that_is_dropped_is_looked_up(tab: Open, tmp_path: Path) -> None:
    image = picture(tmp_path / "image.jpg", **P4R)
    one = tab()
    drop = """([form, bytes]) => {
        const files = new DataTransfer();
        files.items.add(new File([new Uint8Array(bytes)], "dropped.jpg"));
        form.dispatchEvent(new DragEvent("drop", { dataTransfer: files, bubbles: true, cancelable: true }));
    }"""
    form = one.page.locator("form[action='/look']").element_handle()
    with one.page.expect_navigation():
        one.page.evaluate(drop, [form, [*image.read_bytes()]])
    assert "Which K for dropped.jpg?" in one.page.locator("h1").inner_text()


def test_what_is_no_image_is_told_by_its_own_name(tab: Open) -> None:
    one = tab()
    one.page.locator("input[type=file]").set_input_files(
        {"name": "notes.txt", "mimeType": "text/plain", "buffer": b"no image"}
    )
    one.page.get_by_role("button", name="Look up this image").click()
    said = one.page.locator("main").inner_text()
    assert "notes.txt: is not an image" in said
    assert "calibrary-desk-" not in said


def test_a_camera_and_its_changes_are_pages_of_the_desk(tab: Open) -> None:
    one = tab()
    one.page.get_by_role("link", name=CAMERA).click()
    assert "DJI FC6310R" in one.page.locator("h1").inner_text()
    one.page.get_by_role("link", name="drift at ").click()
    assert "drift" in one.page.locator("h1").inner_text()
    one.page.get_by_role("link", name=f"All of {CAMERA}").click()
    with one.page.expect_download() as download:
        one.page.get_by_role("link", name="-entry.yaml").click()
    assert "intrinsics:" in Path(download.value.path()).read_text()
    one.page.get_by_role("link", name="All cameras").click()
    assert one.page.url == f"{one.home}/"


def test_the_keyboard_is_enough(tab: Open) -> None:
    one = tab()
    keys = one.page.keyboard
    for _ in range(20):
        keys.press("Tab")
        if one.page.evaluate("document.activeElement.name") == "q":
            break
    keys.type(CAMERA)
    keys.press("Enter")
    one.page.wait_for_url("**/?q=*")
    for _ in range(60):
        keys.press("Tab")
        if "Copy" in one.page.evaluate("document.activeElement.textContent"):
            break
    assert one.page.evaluate("document.activeElement.getAttribute('aria-label')").startswith("Copy: ")


@pytest.mark.parametrize(
    ("page", "form", "answers", "then"),
    [
        ("/compare", "/compare", {"a": f"{CAMERA}@firmware:01.08", "b": CAMERA}, "drift"),
        ("/compare", "/compare/since", {"since": "2026-01-01"}, "The registry since"),
        ("/onboard", "/onboard", {"place": ""}, "ayload"),
        ("/boards", "/boards/watch", {"place": "", "board": "checkerboard:9x6"}, "Watching"),
        ("/boards", "/boards", {"place": "", "board": "checkerboard:9x6"}, "Board in"),
    ],
)
def test_keys_alone_fill_and_send_forms_without_scripts(
    tab: Open, tmp_path: Path, page: str, form: str, answers: dict[str, str], then: str
) -> None:
    one = tab(scripts=False)
    one.page.goto(f"{one.home}{page}")
    at = "[document.activeElement.form?.getAttribute('action'), document.activeElement.name]"
    for name, text in answers.items():
        for _ in range(40):
            one.page.keyboard.press("Tab")
            if one.page.evaluate(at) == [form, name]:
                break
        assert one.page.evaluate(at) == [form, name], "in the order of the page"
        assert one.page.evaluate("getComputedStyle(document.activeElement).outlineStyle") != "none"
        one.page.keyboard.type(text or str(tmp_path))
    with one.page.expect_navigation():
        one.page.keyboard.press("Enter")
    assert then in one.page.locator("h1").inner_text()


def test_a_camera_without_an_entry_shows_what_the_catalogue_knows(tab: Open) -> None:
    one = tab()
    look_up(one, "mavic 3 enterprise")
    assert one.page.get_by_role("row", name="Mavic 3 Enterprise, wide M3E 5280×3956").is_visible()


def test_flags_are_copied_by_one_click(tab: Open) -> None:
    one = tab()
    one.page.context.grant_permissions(["clipboard-read", "clipboard-write"])
    look_up(one, CAMERA)
    one.page.get_by_role("button", name="Copy: The flags of colmap").click()
    one.page.get_by_text("Copied", exact=True).wait_for()
    copied = one.page.evaluate("navigator.clipboard.readText()")
    assert copied.startswith("--ImageReader.single_camera 1 --ImageReader.camera_model FULL_OPENCV")


def test_without_scripts_it_works(tab: Open) -> None:
    one = tab(scripts=False)
    look_up(one, CAMERA)
    assert "3665.60" in one.page.locator("main").inner_text()


@pytest.mark.parametrize("name", PAGES)
def test_pages_are_quiet_small_and_readable(tab: Open, name: str) -> None:
    one = tab()
    answer = one.page.goto(one.home + PAGES[name])
    assert answer is not None
    assert len(answer.body()) < 300_000
    one.page.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    assert one.complaints == []
    assert faults(one.page) == []


@pytest.mark.parametrize("name", PAGES)
def test_on_a_phone_no_page_scrolls_sideways(tab: Open, name: str) -> None:
    one = tab(size=PHONE)
    one.page.goto(one.home + PAGES[name])
    assert one.page.evaluate("document.documentElement.scrollWidth") == PHONE[0]


def test_hostile_names_of_the_registry_stay_names(tab: Open) -> None:
    one = tab()
    assert HOSTILE[0][:8] not in one.page.content().replace("&lt;script", "")
    assert one.page.title() == "Which K do I use? – calibrary"
    assert one.complaints == []
