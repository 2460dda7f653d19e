"""Pages in a real browser: nothing fetched, nothing complained of, readable by everyone, on a phone too."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from calibrary.cli.main import main
from calibrary.jobs.extract.told import told
from calibrary.pages import render_page
from tests.house.project import ROOT
from tests.jobs.extract.fleet import DEWARP, NOBODY, P4R, gate, picture, plan
from tests.pages.gallery import gallery
from tests.registry.git.repositories import seclude

if TYPE_CHECKING:
    from playwright.sync_api import Browser, BrowserContext, Page, Route

BROWSERS = ("chromium", "google-chrome", "chromium-browser")
PROGRAM = next((path for name in BROWSERS if (path := shutil.which(name)) is not None), None)
PHONE, DESK = (360, 740), (1280, 900)
A4_WIDTH = 688
"""px between the margins of the print stylesheet: 182 mm."""
SHEET = re.compile(rb"/Type\s*/Page\b")
PAGES = ("gallery", "extract")
COMMANDS = ("audit", "onboard", "diff")
"""Whose pages are written by the commands themselves."""

MANUAL = ROOT / "build" / "manual"

AXE = resources.files("axe_playwright_python").joinpath("axe.min.js")

pytestmark = pytest.mark.skipif(
    PROGRAM is None, reason=f"no {', '.join(BROWSERS)}: install Debian's chromium to test pages in it"
)


@dataclass(slots=True)
class Seen:
    """What a page did beside being shown."""

    requests: list[str] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        # Chromium's sandbox does not start for root, as whom containers run.
        root = hasattr(os, "geteuid") and os.geteuid() == 0
        options = ["--no-sandbox"] if root else []
        launched = playwright.chromium.launch(executable_path=PROGRAM, args=options)
        yield launched
        launched.close()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The pages, as files."""
    out = tmp_path_factory.mktemp("pages")
    (out / "gallery.html").write_text(render_page(gallery()), encoding="utf-8")
    flight = out / "flight"
    picture(flight / "valid.jpg", **P4R, dewarp=DEWARP, focal_35mm=24)
    picture(flight / "unproven.jpg", **NOBODY, focal_35mm=36)
    picture(flight / "<script>alert(1)<!--.jpg", make="<b>Example", model="\" onload='x", focal_mm=(600, 10))
    picture(flight / "stripped.jpg")
    (flight / "torn.jpg").write_bytes(b"\xff\xd8\xff")
    outcome = gate(flight)
    page = told(plan(outcome, out / "K_matrix.npy", None))
    (out / "extract.html").write_text(render_page(page), encoding="utf-8")
    written_by_commands(out)
    return out


def written_by_commands(out: Path) -> None:
    """The pages of the keeper's, the integrator's and the engineer's commands."""
    registry, payload = out / "registry", out / "payload"
    picture(payload / "a.jpg", **P4R, dewarp=DEWARP, focal_35mm=24)
    with pytest.MonkeyPatch.context() as patch:
        (out / "home").mkdir()
        seclude(patch, out / "home")
        patch.chdir(out)
        named = ["--registry", str(registry)]
        assert main(["registry", "init", str(registry)]) == 0
        assert main(["registry", "audit", str(out / "flight"), *named, "--html", "audit.html"]) == 1
        assert main(["onboard", str(payload), *named, "--yes", "--html", "onboard.html"]) == 0
        pair = [str(payload / "a.jpg"), str(out / "flight/valid.jpg")]
        assert main(["diff", *pair, "--html", "diff.html"]) == 0


def watched(context: BrowserContext) -> tuple[Page, Seen]:
    """A tab in which every request but for the page itself is recorded and refused."""
    seen, tab = Seen(), context.new_page()

    def refuse(route: Route) -> None:
        url = route.request.url
        if url.startswith("file:") and route.request.is_navigation_request():
            route.continue_()
            return
        seen.requests.append(url)
        route.abort()

    tab.route("**/*", refuse)
    tab.on("console", lambda message: seen.complaints.append(message.text))
    tab.on("pageerror", lambda error: seen.complaints.append(str(error)))
    tab.on("dialog", lambda dialog: seen.complaints.append(dialog.message))
    return tab, seen


@pytest.fixture(scope="module", params=PAGES)
def shown(request: pytest.FixtureRequest, browser: Browser, folder: Path) -> Iterator[tuple[Page, Seen]]:
    """Each page, opened."""
    context = browser.new_context(
        viewport={"width": DESK[0], "height": DESK[1]}, color_scheme="light", reduced_motion="reduce"
    )
    tab, seen = watched(context)
    tab.goto((folder / f"{request.param}.html").as_uri())
    yield tab, seen
    context.close()


def test_a_page_fetches_nothing_and_the_console_stays_empty(shown: tuple[Page, Seen]) -> None:
    tab, seen = shown
    tab.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    # A data: address is no request; anything else would have been recorded.
    assert [url for url in seen.requests if not url.startswith("data:")] == []
    assert seen.complaints == []


def faults(tab: Page) -> list[str]:
    """What axe-core calls serious or critical in a page, and in its dark theme what cannot be read."""
    tab.evaluate(AXE.read_text(encoding="utf-8"))
    light = tab.evaluate("axe.run({resultTypes: ['violations']})")
    tab.emulate_media(color_scheme="dark")
    dark = tab.evaluate("axe.run({resultTypes: ['violations'], runOnly: ['color-contrast']})")
    tab.emulate_media(color_scheme="light")
    return [
        f"{rule['impact']}: {rule['id']}: {rule['help']}: {node['html'][:200]}"
        for rule in (*light["violations"], *dark["violations"])
        for node in rule["nodes"][:3]
        if rule["impact"] in {"serious", "critical"}
    ]


def test_axe_finds_nothing_serious(shown: tuple[Page, Seen]) -> None:
    tab, _ = shown
    tab.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    assert faults(tab) == []


@pytest.mark.parametrize(
    "pale", ["p { color: #bbb }", "@media (prefers-color-scheme: dark) { p { color: #bbb } }"]
)
def test_axe_would_find_something(browser: Browser, pale: str) -> None:
    context = browser.new_context()
    tab = context.new_page()
    tab.set_content(f"<html lang=en><title>x</title><style>{pale}</style><p>pale</p><img src='data:,'>")
    assert {fault.split(": ")[1] for fault in faults(tab)} >= {"color-contrast", "image-alt"}
    context.close()


def test_plots_follow_the_theme(shown: tuple[Page, Seen]) -> None:
    tab, _ = shown
    colours = (
        "[getComputedStyle(document.querySelector('.plot text')).fill,"
        " getComputedStyle(document.body).backgroundColor]"
    )
    assert tab.evaluate(colours) == ["rgb(27, 31, 36)", "rgb(255, 255, 255)"]
    tab.emulate_media(color_scheme="dark")
    ink, ground = tab.evaluate(colours)
    tab.emulate_media(color_scheme="light")
    assert ink == "rgb(230, 233, 238)"
    assert ground != "rgb(255, 255, 255)"


def test_every_plot_is_drawn(shown: tuple[Page, Seen]) -> None:
    tab, _ = shown
    sizes = tab.evaluate(
        "[...document.querySelectorAll('.plot')].map(p => [p.getBoundingClientRect().width,"
        " p.querySelectorAll('svg *, image').length])"
    )
    assert sizes
    assert all(width > 300 and marks > 2 for width, marks in sizes)


@pytest.mark.parametrize("name", COMMANDS)
def test_a_commands_page_is_quiet_and_readable_by_everyone(browser: Browser, folder: Path, name: str) -> None:
    context = browser.new_context(
        viewport={"width": DESK[0], "height": DESK[1]}, color_scheme="light", reduced_motion="reduce"
    )
    tab, seen = watched(context)
    tab.goto((folder / f"{name}.html").as_uri())
    tab.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    assert [url for url in seen.requests if not url.startswith("data:")] == []
    assert seen.complaints == []
    assert faults(tab) == []
    context.close()


@pytest.mark.parametrize("name", [*PAGES, *COMMANDS])
def test_on_a_phone_no_page_scrolls_sideways_and_no_table_is_cut_off(
    browser: Browser, folder: Path, name: str
) -> None:
    context = browser.new_context(viewport={"width": PHONE[0], "height": PHONE[1]}, has_touch=True)
    tab, _ = watched(context)
    tab.goto((folder / f"{name}.html").as_uri())
    tab.evaluate("document.querySelectorAll('details').forEach(d => d.open = true)")
    assert tab.evaluate("document.documentElement.scrollWidth") == PHONE[0]
    cut = tab.evaluate(
        "[...document.querySelectorAll('.scroll:has(table)')].filter(b => b.scrollWidth > b.clientWidth)"
        ".map(b => b.getAttribute('aria-label'))"
    )
    assert cut == []
    context.close()


def test_a_script_that_slipped_in_would_not_run(browser: Browser, folder: Path) -> None:
    html = (folder / "gallery.html").read_text(encoding="utf-8")
    slipped = (
        "<script>document.title = 'owned'</script><img src='https://example.org/x.png'><p style='color:red'>x"
    )
    (folder / "slipped.html").write_text(html.replace("<footer>", f"{slipped}<footer>"), encoding="utf-8")
    context = browser.new_context()
    tab, seen = watched(context)
    tab.goto((folder / "slipped.html").as_uri())
    assert tab.title() != "owned"
    assert seen.requests == []
    assert len(seen.complaints) == 3
    assert all("Content Security Policy" in complaint for complaint in seen.complaints)
    context.close()


def test_the_keyboard_reaches_the_content_first_and_sees_where_it_is(browser: Browser, folder: Path) -> None:
    context = browser.new_context()
    tab, _ = watched(context)
    tab.goto((folder / "gallery.html").as_uri())
    tab.keyboard.press("Tab")
    left, outline = tab.evaluate(
        "[document.activeElement.getBoundingClientRect().left, getComputedStyle(document.activeElement).outlineWidth]"
    )
    assert (left >= 0, outline) == (True, "3px")
    tab.keyboard.press("Enter")
    assert tab.evaluate("document.activeElement.id") == "content"
    context.close()


def test_paper_is_light_and_shows_what_is_folded_away(browser: Browser, folder: Path) -> None:
    context = browser.new_context(color_scheme="dark")
    tab, _ = watched(context)
    tab.goto((folder / "gallery.html").as_uri())
    tab.emulate_media(media="print")
    assert tab.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"
    assert tab.evaluate("document.querySelector('details table').getBoundingClientRect().height") > 0
    context.close()


@pytest.mark.parametrize("name", ["extract", *COMMANDS])
def test_a_page_prints_as_one_sheet_on_which_nothing_is_cut_off(
    browser: Browser, folder: Path, name: str
) -> None:
    context = browser.new_context(viewport={"width": A4_WIDTH, "height": 900})
    tab, _ = watched(context)
    tab.goto((folder / f"{name}.html").as_uri())
    tab.emulate_media(media="print")
    wide = "[...document.querySelectorAll('.scroll')].filter(b => b.scrollWidth > b.clientWidth + 1).length"
    assert tab.evaluate(wide) == 0
    assert len(SHEET.findall(tab.pdf(prefer_css_page_size=True))) == 1
    summary = tab.inner_text("body")
    assert "A summary;" in summary
    assert "SHA-256" not in summary
    tab.evaluate("document.querySelector('#print-all').checked = true")
    assert len(tab.inner_text("body")) > len(summary)
    context.close()


@pytest.mark.skipif(not MANUAL.is_dir(), reason="there is no build/manual: make docs builds it")
@pytest.mark.parametrize("page", ["index", "distortion", "how-to/bucket"])
@pytest.mark.parametrize("screen", [DESK, PHONE], ids=["desk", "phone"])
def test_the_manual_is_readable_by_everyone(browser: Browser, page: str, screen: tuple[int, int]) -> None:
    context = browser.new_context(
        viewport={"width": screen[0], "height": screen[1]}, color_scheme="light", reduced_motion="reduce"
    )
    tab = context.new_page()
    tab.goto((MANUAL / f"{page}.html").as_uri())
    assert faults(tab) == []
    assert tab.evaluate("document.documentElement.scrollWidth") == screen[0]
    context.close()
