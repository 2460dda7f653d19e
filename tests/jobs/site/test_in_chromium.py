"""The site in a real browser: search finds, filters filter, charts render, nothing is fetched, everyone can read it."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from calibrary.cli.main import main
from calibrary.jobs.site.building import Site
from tests.jobs.site.test_site import P4R_PAGE
from tests.pages.test_in_chromium import DESK, PHONE, PROGRAM, Seen, faults, watched
from tests.pages.test_in_chromium import pytestmark as only_where_a_browser_is
from tests.registry.git.repositories import seclude

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = only_where_a_browser_is

FLAT = "changes/example/flat/5472x3648+f24"
SHOWN = "#all-cameras ~ * tbody tr:not([hidden]) th"


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        root = hasattr(os, "geteuid") and os.geteuid() == 0
        options = ["--no-sandbox"] if root else []
        launched = playwright.chromium.launch(executable_path=PROGRAM, args=options)
        yield launched
        launched.close()


@pytest.fixture(scope="module")
def pages(site: Site) -> dict[str, Path]:
    """One page of each kind."""
    [change] = (site.root / FLAT).iterdir()
    return {"list": site.root / "index.html", "camera": site.root / P4R_PAGE, "change": change}


@pytest.fixture(scope="module")
def fleet_page(registry: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``calibrary diff --since … --html``."""
    folder = tmp_path_factory.mktemp("diff")
    out = folder / "fleet.html"
    with pytest.MonkeyPatch.context() as patch:
        seclude(patch, folder)
        assert (
            main(["diff", "--firmware", "01.08..01.09", "--registry", str(registry), "--html", str(out)]) == 1
        )
    return out


@pytest.fixture
def listed(browser: Browser, pages: dict[str, Path]) -> Iterator[tuple[Page, Seen]]:
    """The list, newly opened."""
    context = browser.new_context(viewport={"width": DESK[0], "height": DESK[1]})
    tab, seen = watched(context)
    tab.goto(pages["list"].as_uri())
    yield tab, seen
    assert seen.complaints == []
    context.close()


def names(tab: Page) -> list[str]:
    """The cameras that are listed, in their order, once the list stands still."""
    tab.evaluate("() => new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return tab.locator(SHOWN).all_inner_texts()


@pytest.mark.parametrize("name", ["list", "camera", "change", "fleet"])
def test_pages_are_quiet_and_readable(
    browser: Browser, pages: dict[str, Path], fleet_page: Path, name: str
) -> None:
    context = browser.new_context(
        viewport={"width": DESK[0], "height": DESK[1]},
        color_scheme="light",
        reduced_motion="reduce",
    )
    tab, seen = watched(context)
    tab.goto((pages | {"fleet": fleet_page})[name].as_uri())
    tab.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    assert [url for url in seen.requests if not url.startswith("data:")] == []
    assert seen.complaints == []
    assert tab.title() != "owned"
    assert faults(tab) == []
    context.close()


@pytest.mark.parametrize("name", ["list", "camera", "change"])
def test_on_a_phone_no_page_scrolls_sideways(browser: Browser, pages: dict[str, Path], name: str) -> None:
    context = browser.new_context(viewport={"width": PHONE[0], "height": PHONE[1]}, has_touch=True)
    tab, _ = watched(context)
    tab.goto(pages[name].as_uri())
    assert tab.evaluate("document.documentElement.scrollWidth") == PHONE[0]
    context.close()


@pytest.mark.parametrize(
    ("name", "screen"), [("list", PHONE), ("list", DESK), ("camera", DESK), ("change", DESK)]
)
def test_no_table_is_cut_off(
    browser: Browser, pages: dict[str, Path], name: str, screen: tuple[int, int]
) -> None:
    context = browser.new_context(viewport={"width": screen[0], "height": screen[1]})
    tab, _ = watched(context)
    tab.goto(pages[name].as_uri())
    cut = "[...document.querySelectorAll('.scroll')].filter(b => b.scrollWidth > b.clientWidth).length"
    assert tab.evaluate(cut) == 0
    context.close()


def test_charts_are_drawn(browser: Browser, pages: dict[str, Path]) -> None:
    context = browser.new_context(viewport={"width": DESK[0], "height": DESK[1]})
    tab, _ = watched(context)
    tab.goto(pages["camera"].as_uri())
    boxes = tab.evaluate(
        "[...document.querySelectorAll('.plot')].map(p => [p.getBoundingClientRect().width,"
        " p.querySelectorAll('path, circle, rect').length])"
    )
    assert len(boxes) == 4
    assert all(width > 300 and marks > 2 for width, marks in boxes)
    assert tab.locator(".plot circle").count() == 9
    context.close()


def test_search_finds_every_word_in_any_order_and_case(listed: tuple[Page, Seen]) -> None:
    tab, _ = listed
    assert len(names(tab)) == 8
    tab.get_by_label("search").fill("BROWN fc6310")
    assert names(tab) == ["dji/fc6310r/5472x3648+f8.8"]
    assert tab.get_by_role("status").inner_text() == "1 of 8 cameras"
    tab.get_by_label("search").fill("nobody has this")
    assert names(tab) == []
    tab.get_by_role("button", name="Show all").click()
    assert len(names(tab)) == 8


def test_a_hostile_search_is_a_search(listed: tuple[Page, Seen]) -> None:
    tab, _ = listed
    tab.get_by_label("search").fill("<script>document.title='owned'</script>")
    assert len(names(tab)) == 1
    assert tab.title() != "owned"


def test_filters_filter_together_with_the_search(listed: tuple[Page, Seen]) -> None:
    tab, _ = listed
    tab.get_by_label("make", exact=True).select_option("DJI")
    assert names(tab) == ["dji/fc330/4000x3000+f3.61", "dji/fc6310r/5472x3648+f8.8"]
    tab.get_by_label("uncertainty").select_option("covariance")
    assert names(tab) == ["dji/fc6310r/5472x3648+f8.8"]
    tab.get_by_label("search").fill("fc330")
    assert names(tab) == []


def test_a_filter_says_how_many_there_are(listed: tuple[Page, Seen]) -> None:
    tab, _ = listed
    options = tab.get_by_label("lens").locator("option").all_inner_texts()
    assert options == ["all", "brown (6)", "kannala-brandt (1)", "unknown (1)"]


def test_a_search_can_be_kept_and_handed_on(listed: tuple[Page, Seen], browser: Browser) -> None:
    tab, _ = listed
    tab.get_by_label("search").fill("fc")
    tab.get_by_label("uncertainty").select_option("none")
    kept = names(tab)
    context = browser.new_context()
    other, _ = watched(context)
    other.goto(tab.url)
    assert names(other) == kept == ["dji/fc330/4000x3000+f3.61"]
    context.close()


def test_columns_sort_by_number_with_the_unknown_last(listed: tuple[Page, Seen]) -> None:
    tab, _ = listed
    head = tab.get_by_role("columnheader", name=re.compile("^fx"))
    head.get_by_role("button").click()
    assert head.get_attribute("aria-sort") == "ascending"
    assert names(tab)[:2] == ["example/one_fish/1000x1000+f1.8", "dji/fc330/4000x3000+f3.61"]
    head.get_by_role("button").click()
    assert names(tab)[0] == "dji/fc6310r/5472x3648+f8.8"


def test_a_camera_and_its_changes_are_a_click_away(listed: tuple[Page, Seen]) -> None:
    tab, seen = listed
    tab.get_by_role("link", name="dji/fc6310r/5472x3648+f8.8").click()
    assert "DJI FC6310R" in tab.locator("h1").inner_text()
    tab.get_by_role("link", name="drift at ").click()
    assert "drift" in tab.locator("h1").inner_text()
    tab.get_by_role("link", name="All of dji/fc6310r/5472x3648+f8.8").click()
    tab.get_by_role("link", name="All cameras").click()
    assert len(names(tab)) == 8
    assert [url for url in seen.requests if not url.startswith("data:")] == []


def test_without_a_script_it_is_a_plain_list(browser: Browser, pages: dict[str, Path]) -> None:
    context = browser.new_context(java_script_enabled=False)
    tab, _ = watched(context)
    tab.goto(pages["list"].as_uri())
    assert tab.locator("tbody tr").count() == 8
    assert tab.locator("form, input, button").count() == 0
    context.close()


def test_another_script_would_not_run(browser: Browser, pages: dict[str, Path], tmp_path: Path) -> None:
    page = tmp_path / "slipped.html"
    text = pages["list"].read_text(encoding="utf-8")
    page.write_text(
        text.replace("<footer>", "<script>document.title = 'owned'</script><footer>"), encoding="utf-8"
    )
    context = browser.new_context()
    tab, seen = watched(context)
    tab.goto(page.as_uri())
    assert tab.title() != "owned"
    assert len(seen.complaints) == 1
    assert tab.get_by_label("search").count() == 1
    context.close()
