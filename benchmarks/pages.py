"""How long a registry's pages take to make, and how long its list takes to answer: beside the goals.

    python -m benchmarks.pages [--entries N] [--workers N] [--no-browser]

A fleet of 1 000 cameras in 170 commits: half of them calibrated a second time, a fifth a third time, a third with a
covariance. The goals are 60 s for the whole site on two processors, and a tenth of a second from a key pressed in the
search to the list standing still, which is what people call at once. Nothing here fails on a slow machine; a goal is
met or missed, and that is printed. The processors' time is printed too, which a busy machine does not lengthen much.
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.table import show
from calibrary.calibration import Calibration, CameraKey, Covariance, Grade, Intrinsics, Provenance, Quality
from calibrary.distortion import BrownConrady
from calibrary.jobs.site.building import build
from calibrary.registry.entry import Entry, Status
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.git.writing import Change
from calibrary.registry.init import init
from calibrary.registry.proposals import note_of, write_changes
from calibrary.registry.registry import Registry

if TYPE_CHECKING:
    from playwright.sync_api import Page

BROWSERS = ("chromium", "google-chrome", "chromium-browser")
SITE_GOAL_S = 60.0
ANSWER_GOAL_MS = 100.0
BATCH = 10
SAMPLE = 100
MAKES = 20
NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
STD = np.array([0.3, 0.3, 0.4, 0.4, 2e-4, 4e-4, 1e-5, 1e-5, 3e-4])


def an_entry(number: int, seed: int = 0) -> Entry:
    """One camera of the fleet, as it was calibrated for the seed-th time."""
    once, now = np.random.default_rng(number), np.random.default_rng((number, seed))
    fx = float(once.uniform(2500, 4200) + now.normal(0, 0.5))
    cx, cy = (float(side / 2 + once.normal(0, 8)) for side in (5472, 3648))
    size = (5472, 3648)
    quality = Quality(
        rms_px=0.3, views=40, covariance=Covariance.from_matrix(NAMES, np.diag(STD**2)), kappa2=1.5
    )
    calibration = Calibration(
        camera=CameraKey(make=f"Maker {number % MAKES:02d}", model=f"Model {number:05d}", image_size=size),
        intrinsics=Intrinsics(fx=fx, fy=fx * 0.9995, cx=cx, cy=cy, image_size=size),
        distortion=BrownConrady(
            k1=float(once.normal(-0.1, 0.05)), k2=0.08, p1=float(once.normal(0, 5e-4)), p2=1e-4, k3=-0.02
        ),
        grade=Grade.CALIBRATED,
        quality=quality if number % 3 == 0 else None,
        provenance=Provenance(
            kind="calibration-file",
            source=f"camera-{number}.xml",
            sha256=f"{number:064x}",
            date=f"202{4 + seed}-0{1 + number % 9}-17",
            firmware=f"01.0{seed}.0100",
            tool="bench 1.0",
        ),
    )
    return Entry(calibration=calibration, status=Status.DRAFT if number % 9 == 0 else Status.APPROVED)


def fleet(folder: Path, entries: int) -> None:
    """A registry of so many cameras with their past."""
    registry = Registry.open(init(folder).place)
    for seed, share in ((0, 1.0), (1, 0.5), (2, 0.2)):
        for batch in _batches(range(round(share * entries))):
            _save(registry, [an_entry(number, seed) for number in batch])


def _batches(numbers: Sequence[int]) -> Iterator[Sequence[int]]:
    for start in range(0, len(numbers), BATCH):
        yield numbers[start : start + BATCH]


def _save(registry: Registry, entries: Sequence[Entry]) -> None:
    paths = registry.snapshot().paths
    changes = [
        Change(path=entry.path, data=entry_yaml(entry), base=paths.get(entry.path)) for entry in entries
    ]
    write_changes(registry.repo, changes, note_of("Calibrate", entries))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--entries", type=int, default=1_000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--no-browser", action="store_true")
    arguments = parser.parse_args()
    for name in ("AUTHOR", "COMMITTER"):
        os.environ |= {f"GIT_{name}_NAME": "Fleet Keeper", f"GIT_{name}_EMAIL": "keeper@example.com"}
    print(f"Python {platform.python_version()}, {os.cpu_count()} processors, load {os.getloadavg()[0]:.1f}")
    with tempfile.TemporaryDirectory() as folder:
        registry, out = Path(folder) / "fleet", Path(folder) / "site"
        fleet(registry, arguments.entries)
        _make(registry, out, arguments.entries, arguments.workers)
        _cost(Path(folder), arguments.entries, arguments.workers)
        if not arguments.no_browser:
            _answer(out)


def _make(registry: Path, out: Path, entries: int, workers: int) -> None:
    start = time.perf_counter()
    site = build(registry, out, workers=workers)
    elapsed = time.perf_counter() - start
    files = [path for path in out.rglob("*") if path.is_file()]
    pages = [path for path in files if path.suffix == ".html"]
    size = sum(path.stat().st_size for path in files)
    goal = SITE_GOAL_S * entries / 1_000
    print(f"\nsite of {len(site.cards)} entries: {len(pages)} pages, {len(files)} files, {size / 1e6:.0f} MB")
    _row("built", f"{elapsed:.1f} s", f"≤ {goal:.0f} s", met=elapsed <= goal)
    index = out / "index.html"
    print(f"  {'the list':<34}{index.stat().st_size / 1e3:.0f} kB")
    plain = _seconds(lambda: shutil.copytree(out, out.parent / "copy"))
    print(f"  {'only copying it':<34}{plain:.1f} s")


def _cost(folder: Path, entries: int, workers: int) -> None:
    """What one processor works on an entry, git's share included: the time without the machine's other work."""
    fleet(folder / "sample", SAMPLE)
    build(folder / "sample", folder / "warm", workers=1)
    used = _processor_s()
    build(folder / "sample", folder / "measured", workers=1)
    used = (_processor_s() - used) / SAMPLE
    alone = used * entries / workers
    print(
        f"  {'processor time an entry':<34}{1e3 * used:.0f} ms, so {alone:.0f} s on {workers} that do nothing else"
    )


def _answer(out: Path) -> None:
    from playwright.sync_api import sync_playwright  # noqa: PLC0415  only who has a browser needs it

    program = next((found for name in BROWSERS if (found := shutil.which(name)) is not None), None)
    if program is None:
        print(f"\nthe list in a browser: not measured, none of {', '.join(BROWSERS)} is installed")
        return
    version = subprocess.run(
        [program, "--version"], capture_output=True, text=True, check=True
    ).stdout.strip()
    print(f"\nthe list in {version}")
    root = hasattr(os, "geteuid") and os.geteuid() == 0
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"] if root else [])
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        opened = _seconds(lambda: page.goto((out / "index.html").as_uri()))
        print(f"  {'opened':<34}{1e3 * opened:.0f} ms")
        for what, act in (
            ("a key in the search", "search.value = text"),
            ("a filter", "status.value = text === 'model 0' ? 'draft' : ''"),
        ):
            took = median(_answers(page, act))
            _row(what, f"{took:.0f} ms", f"≤ {ANSWER_GOAL_MS:.0f} ms", met=took <= ANSWER_GOAL_MS)
        browser.close()


def _answers(page: Page, act: str) -> list[float]:
    """From an input to the frame that shows its answer, in ms."""
    script = """async (text) => {
      const search = document.querySelector('#search'), status = document.querySelector('#of-status');
      const start = performance.now();
      ACT;
      search.dispatchEvent(new Event('input'));
      await new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(done))));
      document.body.getBoundingClientRect();
      return performance.now() - start;
    }"""
    return [
        float(page.evaluate(script.replace("ACT", act), text)) for text in ("model 0", "", "maker 07", "") * 5
    ]


def _row(what: str, found: str, goal: str, *, met: bool) -> None:
    show(what, found, limit=goal, met=met)


def _seconds(act: Callable[[], object]) -> float:
    start = time.perf_counter()
    act()
    return time.perf_counter() - start


def _processor_s() -> float:
    own, workers = resource.getrusage(resource.RUSAGE_SELF), resource.getrusage(resource.RUSAGE_CHILDREN)
    return own.ru_utime + own.ru_stime + workers.ru_utime + workers.ru_stime


if __name__ == "__main__":
    main()
