"""Draw the documentation's pictures from real output: the terminal's as SVG, pages as a browser shows them.

``make pictures`` runs this file after the output has changed; a test compares the terminal's picture with the
output. Pages need Chromium and Playwright, and are drawn only when they are asked for (``--pages``).
"""

from __future__ import annotations

import argparse
import io
import os
import re
import shutil
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import chdir, redirect_stderr, redirect_stdout
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING
from urllib.parse import urlencode, urlsplit
from urllib.request import HTTPCookieProcessor, build_opener

from rich.terminal_theme import TerminalTheme
from rich.text import Text

from calibrary.calib.board import Board
from calibrary.calib.synthesis import Settings, Truth, poses
from calibrary.calib.synthesis.cameras import example_camera, head
from calibrary.calib.synthesis.files import write_frames
from calibrary.cli.console import Screen
from calibrary.cli.main import main as command
from calibrary.cli.terminal import show
from calibrary.jobs.calibrate import calibrate
from calibrary.jobs.demo.flight import write_flight
from calibrary.jobs.desk import desk
from calibrary.jobs.diff.comparison import compare
from calibrary.jobs.diff.told import told as told_diff
from calibrary.jobs.extract.outputs import Wanted
from calibrary.jobs.extract.report import ExtractReport
from calibrary.jobs.extract.run import run
from calibrary.jobs.extract.told import told
from calibrary.jobs.site.building import build
from calibrary.pages import render_page

if TYPE_CHECKING:
    from docs.example_fleet import write_fleet
    from docs.make_lenses import write as write_lenses
else:
    # A program's own folder is where Python looks first.
    from example_fleet import write_fleet
    from make_lenses import write as write_lenses

DOCS = Path(__file__).parent
WIDTH = 90
COMMAND = "calibrary extract flight --recursive"

CHOSEN = (
    "100_0001/*.JPG",
    "DJI_202405170930_001/*.JPG",
    "micasense/0000SET/000/IMG_0000_1.tif",
    "phantom4pro/DJI_0102.JPG",
    "phone/*.jpg",
)
"""A story each: calibrated, two cameras under one Model, a band, a zoomed frame, a 35 mm equivalent, a torn file."""

THEME = TerminalTheme(
    background=(22, 25, 31),
    foreground=(222, 226, 232),
    normal=[
        (22, 25, 31),
        (239, 107, 107),
        (126, 201, 110),
        (229, 192, 89),
        (97, 155, 230),
        (190, 140, 220),
        (86, 190, 195),
        (222, 226, 232),
    ],
)

# rich's own frame fetches a typeface from the network; this one makes do with what the reader's machine has.
FRAME = """\
<svg class="rich-terminal" viewBox="0 0 {width} {height}" xmlns="http://www.w3.org/2000/svg">
<style>
.{unique_id}-matrix {{ font: {char_height}px/{line_height}px ui-monospace, Menlo, Consolas, "DejaVu Sans Mono", \
monospace; font-variant-east-asian: full-width; }}
.{unique_id}-title {{ font: bold 18px sans-serif; }}
{styles}
</style>
<defs>
<clipPath id="{unique_id}-clip-terminal">
<rect x="0" y="0" width="{terminal_width}" height="{terminal_height}"/>
</clipPath>
{lines}
</defs>
{chrome}
<g transform="translate({terminal_x}, {terminal_y})" clip-path="url(#{unique_id}-clip-terminal)">
{backgrounds}
<g class="{unique_id}-matrix">
{matrix}
</g>
</g>
</svg>
"""


BROWSERS = ("chromium", "google-chrome", "chromium-browser")
PAGE_WIDTH = 1180
PAGE_COLOURS = 128
EXTRACT_PARTS = (("header", 1090), ("#dji-fc6310r-5472x3648", 730))
"""The overview, and one camera whole."""

DIFF_PARTS = (("header", 1060), ("#section-3", 580))
"""The verdict with the numbers, and the maps."""

SITE_PARTS = (("header", 730),)
CAMERA_PARTS = (("header", 400), ("#section-6", 840))
"""What the camera is, which K to use, and its history."""

BOARD = Board(columns=11, rows=8, square_mm=40.0)
BOARD_FRAMES, BOARD_SEED = 24, 1
CALIBRATE_PARTS = (("header", 1010), ("#held", 800), ("#trust", 620))
"""The verdict with K, and of the plots coverage, tilt, uncertainty and what halves of the views disagree about."""


JOB_PARTS = (("header", 1100),)
DESK_PARTS = {"look-up": (("header", 1000),), "flight": (("header", 900),)}
"""Of the desk's pages: an answer, and a flight that was checked."""


def judge(flight: Path) -> ExtractReport:
    """What the gate makes of the chosen files of a demonstration flight."""
    with TemporaryDirectory() as temporary:
        folder = Path(temporary) / "flight"
        for pattern in CHOSEN:
            for path in sorted(flight.glob(pattern)):
                copy = folder / path.relative_to(flight)
                copy.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(path, copy)
        return run(folder, recursive=True, days=True)


def draw(outcome: ExtractReport) -> str:
    """What the terminal shows, as SVG."""
    console = Screen(
        record=True, width=WIDTH, file=io.StringIO(), force_terminal=True, color_system="truecolor"
    )
    console.print(Text.assemble(("$ ", "cyan"), COMMAND, "\n"))
    show(console, told(outcome))
    return console.export_svg(title="calibrary", theme=THEME, code_format=FRAME, unique_id="extract")


def extract_page(outcome: ExtractReport) -> str:
    """What ``--html`` writes."""
    with TemporaryDirectory() as folder:
        return render_page(told(Wanted(out=Path(folder) / "K_matrix.npy").plan(outcome)))


def board_page() -> str:
    """What ``calibrate --html`` writes of frames that were rendered."""
    camera = example_camera(BOARD_SEED)
    with TemporaryDirectory() as folder:
        out = Path(folder) / "frames"
        held = poses(BOARD, camera, BOARD_FRAMES, BOARD_SEED)
        truth = Truth(board=BOARD, calibration=camera, poses=held, settings=Settings())
        write_frames(out, truth, BOARD_SEED, lambda number: head(camera, None, number))
        page = Path(folder) / "board.html"
        calibrate(out, board=str(BOARD), square_mm=BOARD.square_mm, focus="locked at infinity", html=page)
        return page.read_text(encoding="utf-8")


def told_fleets() -> tuple[str, str, str]:
    """A comparison, and of the registry's site the list and a camera."""
    with TemporaryDirectory() as folder:
        registry = Path(folder) / "fleet"
        fleet = write_fleet(registry)
        before, after = (fleet.get(f"fc6310r@firmware:{version}") for version in ("01.08", "01.09"))
        labels = ("fc6310r@firmware:01.08", "fc6310r")
        compared = compare(before.entry.calibration, after.entry.calibration, labels=labels)
        diff = told_diff(compared, 100.0)
        site = build(registry, Path(folder) / "site", workers=1)
        listing, camera = (
            (site.root / name).read_text(encoding="utf-8")
            for name in ("index.html", "cameras/dji/fc6310r/5472x3648+f8.8.html")
        )
    return render_page(diff), listing, camera


def job_pages() -> tuple[str, str]:
    """What the audit of a flight writes, and what a payload's folder does."""
    # Within the folder, so that the pages name the flight as a user would and not this machine's temporary folder.
    with TemporaryDirectory() as folder, chdir(folder):
        flight, registry = Path("flight"), Path("fleet")
        write_flight(flight)
        write_fleet(registry)
        payload = flight / "100_0001"
        pages = [Path(name) for name in ("audit.html", "onboard.html")]
        named = ["--registry", str(registry), "--html"]
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            command(["registry", "audit", str(flight), *named, str(pages[0])])
            command(["onboard", str(payload), "--yes", "--for", "unit", *named, str(pages[1])])
        audit, onboard = (page.read_text(encoding="utf-8") for page in pages)
    return audit, onboard


def desk_pages() -> Iterator[tuple[str, str]]:
    """Names and pages of a desk, as its browser gets them."""
    with TemporaryDirectory() as folder:
        fleet, flight = Path(folder) / "fleet", Path(folder) / "flight"
        write_fleet(fleet)
        write_flight(flight)
        server = desk(fleet)
        thread = threading.Thread(target=server.run)
        thread.start()
        try:
            browser, place = build_opener(HTTPCookieProcessor()), urlsplit(server.address)

            def page(address: str, **asked: str) -> str:
                data = urlencode(asked).encode() if asked else None
                # Names of this machine's temporary folder tell a reader nothing.
                said: str = browser.open(f"{place.scheme}://{place.netloc}{address}", data).read().decode()
                return said.replace(folder, "/home/ada")

            browser.addheaders = [("Origin", f"{place.scheme}://{place.netloc}")]
            browser.open(server.address)
            yield "look-up", page("/?q=fc6310r")
            [token] = set(re.findall(r'name="token" value="(\w+)"', page("/flight")))
            checked = page("/flight", token=token, place=str(flight), to="odm")
            while (state := re.search(r'data-state="(/job/[^"]+)/state"', checked)) is not None:
                time.sleep(0.5)
                checked = page(state[1])
            yield "flight", checked
        finally:
            server.stop()
            thread.join()


def screenshot(html: str, out: Path, *, parts: Sequence[tuple[str, int]]) -> None:
    """Parts of a page as Chromium shows them, one below the other, in few colours.

    Args:
        html: the page.
        out: the PNG to write.
        parts: where each begins, as a CSS selector, and its height in px of the screen.
    """
    from PIL import Image
    from playwright.sync_api import sync_playwright  # noqa: PLC0415  only who draws pages needs it

    program = next((found for name in BROWSERS if (found := shutil.which(name)) is not None), None)
    if program is None:
        raise SystemExit(f"pages are drawn by one of {', '.join(BROWSERS)}, and none is installed")
    picture = Image.new("RGB", (PAGE_WIDTH, sum(height for _, height in parts)))
    with TemporaryDirectory() as folder, sync_playwright() as playwright:
        page = Path(folder) / "page.html"
        page.write_text(html, encoding="utf-8")
        root = hasattr(os, "geteuid") and os.geteuid() == 0
        options = ["--no-sandbox"] if root else []
        browser = playwright.chromium.launch(executable_path=program, args=options)
        tab = browser.new_page(viewport={"width": PAGE_WIDTH, "height": 900}, color_scheme="light")
        tab.goto(page.as_uri())
        below = 0
        for selector, height in parts:
            top = tab.locator(selector).bounding_box()
            if top is None:
                raise SystemExit(f"the page has no {selector}")
            taken = tab.screenshot(
                full_page=True,
                clip={"x": 0.0, "y": max(0.0, top["y"] - 8.0), "width": PAGE_WIDTH, "height": height},
            )
            with Image.open(io.BytesIO(taken)) as shot:
                picture.paste(shot.convert("RGB"), (0, below))
            below += height
        browser.close()
    picture.quantize(PAGE_COLOURS, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE).save(
        out, optimize=True
    )


def main() -> int:
    """Draw into a folder, this one unless another is named."""
    parser = argparse.ArgumentParser(description="Draw the documentation's pictures.")
    parser.add_argument(
        "out", type=Path, nargs="?", default=DOCS, help="folder (default: where this file lies)"
    )
    parser.add_argument("--flight", type=Path, help="a demonstration flight that is there already")
    parser.add_argument("--pages", action="store_true", help="also those of pages, which Chromium draws")
    arguments = parser.parse_args()
    if arguments.flight is not None:
        outcome = judge(arguments.flight)
    else:
        with TemporaryDirectory() as folder:
            write_flight(Path(folder))
            outcome = judge(Path(folder))
    write_lenses(arguments.out / "lenses")
    (arguments.out / "extract.svg").write_text(draw(outcome), encoding="utf-8")
    if arguments.pages:
        screenshot(extract_page(outcome), arguments.out / "extract-page.png", parts=EXTRACT_PARTS)
        screenshot(board_page(), arguments.out / "calibrate-page.png", parts=CALIBRATE_PARTS)
        diff, listing, camera = told_fleets()
        screenshot(diff, arguments.out / "diff-page.png", parts=DIFF_PARTS)
        screenshot(listing, arguments.out / "site-page.png", parts=SITE_PARTS)
        screenshot(camera, arguments.out / "camera-page.png", parts=CAMERA_PARTS)
        audit, onboard = job_pages()
        screenshot(audit, arguments.out / "audit-page.png", parts=JOB_PARTS)
        screenshot(onboard, arguments.out / "onboard-page.png", parts=JOB_PARTS)
        for name, page in desk_pages():
            screenshot(page, arguments.out / f"desk-{name}.png", parts=DESK_PARTS[name])
    return 0


if __name__ == "__main__":
    sys.exit(main())
