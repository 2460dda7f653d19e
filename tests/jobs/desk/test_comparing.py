"""Compare in a real browser: any two calibrations, the registry then and now, and units over their flights."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.cli.registry.fleets import xml
from tests.jobs.desk.conftest import Tab
from tests.jobs.extract.fleet import DEWARP, P4R, picture
from tests.pages.test_in_chromium import PHONE, faults
from tests.pages.test_in_chromium import pytestmark as only_where_a_browser_is

pytestmark = only_where_a_browser_is
Open = Callable[..., Tab]
CAMERA = "dji/fc6310r/5472x3648+f8.8"


def compare(one: Tab, a: str = "", b: str = "") -> str:
    one.page.goto(f"{one.home}/compare")
    form = one.page.locator("form[action='/compare']")
    form.get_by_label("A, the earlier").fill(a)
    form.get_by_label("B, the later").fill(b)
    form.get_by_role("button", name="Compare", exact=True).click()
    one.page.wait_for_url("**/compare?*")
    return one.page.locator("main").inner_text()


def test_two_states_of_an_entry_are_compared_by_a_part_of_its_name(tab: Open, fleet: Path) -> None:
    one, other = tab(), tab()
    said = compare(one, "6310r/5472@firmware:01.08", "6310r/5472")
    assert "drift" in one.page.locator("h1").inner_text()
    assert "3661.25" in said
    assert one.page.locator("svg.plot").count() == 1
    assert one.complaints == []
    words = shlex.split(one.page.locator("pre", has_text="calibrary diff").inner_text())
    assert words[:2] == ["calibrary", "diff"]
    assert words[-2:] == ["--registry", str(fleet)]
    address = one.page.get_by_role("link", name="address of this comparison").get_attribute("href") or ""
    other.page.goto(other.home + address)
    assert "3661.25" in other.page.locator("main").inner_text()


def test_an_entry_is_compared_with_a_file_by_its_path_and_with_an_image(tab: Open, tmp_path: Path) -> None:
    file = xml(tmp_path / "camera.xml", 3673.0)
    image = picture(tmp_path / "a.jpg", **P4R, dewarp=DEWARP)
    one = tab()
    assert "3673.00" in compare(one, CAMERA, str(file))
    assert str(image) in compare(one, str(file), str(image))


def test_files_are_sent_and_compared_under_their_own_names(tab: Open, tmp_path: Path) -> None:
    one = tab()
    one.page.goto(f"{one.home}/compare")
    for side, fx in (("A", 3650.0), ("B", 3673.0)):
        sent = xml(tmp_path / f"{side}.xml", fx).read_bytes()
        one.page.get_by_label(f"or a file for {side}").set_input_files(
            {"name": f"<b>{side}\u202e.xml", "mimeType": "text/xml", "buffer": sent}
        )
    one.page.get_by_role("button", name="Compare", exact=True).click()
    one.page.get_by_text("A file that was sent is not kept").wait_for()
    assert "calibrary-desk-" not in one.page.content()
    assert "\u202e" not in one.page.content()
    assert "<b>A" in one.page.locator("main").inner_text()
    assert one.complaints == []


def test_what_cannot_be_compared_says_why_and_keeps_the_question(tab: Open, tmp_path: Path) -> None:
    one = tab()
    said = compare(one, CAMERA, "nothing/such")
    assert "nothing/such" in said
    assert one.page.get_by_label("A, the earlier").input_value() == CAMERA
    assert "no such folder" in compare(one, CAMERA, str(tmp_path / "none.xml"))
    assert "expected a camera" in compare(one, CAMERA)
    assert "~nobody" in compare(one, CAMERA, "~nobody/K.xml")
    assert "name too long" in compare(one, CAMERA, "/" + "x" * 300)


def test_the_registry_is_compared_with_a_day_and_with_its_flights(tab: Open, tmp_path: Path) -> None:
    one = tab()
    one.page.goto(f"{one.home}/compare")
    one.page.get_by_label("Firmware before and after").fill("01.08..01.09")
    one.page.get_by_role("button", name="Compare firmwares").click()
    one.page.get_by_role("link", name="The whole report").click(timeout=90_000)
    assert "from firmware 01.08 to 01.09" in one.page.locator("h1").inner_text()
    picture(tmp_path / "flights/a.jpg", **P4R, dewarp=DEWARP)
    one.page.goto(f"{one.home}/compare")
    one.page.get_by_label("Folder of flights").fill(str(tmp_path / "flights"))
    one.page.get_by_role("button", name="Compare with flights").click()
    one.page.get_by_role("link", name="The whole report").click(timeout=90_000)
    assert "Audit of the registry" in one.page.locator("h1").inner_text()


@pytest.mark.parametrize(
    "query", ["", f"?a={CAMERA.replace('+', '%2B')}@firmware:01.08&b={CAMERA.replace('+', '%2B')}"]
)
def test_pages_are_quiet_small_and_readable(tab: Open, query: str) -> None:
    one = tab()
    answer = one.page.goto(f"{one.home}/compare{query}")
    assert answer is not None
    assert len(answer.body()) < 300_000
    assert one.complaints == []
    assert faults(one.page) == []
    one.page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
    assert one.page.evaluate("document.documentElement.scrollWidth") == PHONE[0]


def test_the_page_of_a_camera_leads_to_a_comparison_with_it(tab: Open) -> None:
    one = tab()
    one.page.goto(f"{one.home}/cameras/{CAMERA}.html")
    one.page.get_by_role("link", name="Compare it with another").click()
    assert one.page.get_by_label("B, the later").input_value() == CAMERA
    assert "Not compared" not in one.page.locator("main").inner_text()
