"""Desks of a registry with a past, each in a thread of this process."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import pytest

from calibrary.jobs.desk import desk
from calibrary.jobs.desk.guard import Desk
from tests.jobs.site.conftest import registry
from tests.pages.test_in_chromium import DESK, browser
from tests.registry.git.repositories import nobodys_git

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

__all__ = ["browser", "nobodys_git", "registry"]


@dataclass(slots=True)
class Tab:
    """A tab that was let in, and what it did beside being shown."""

    page: Page
    home: str
    complaints: list[str] = field(default_factory=list)
    foreign: list[str] = field(default_factory=list)


@pytest.fixture
def fleet(registry: Path, tmp_path: Path) -> Path:
    """A copy of the registry, to write to."""
    return shutil.copytree(registry, tmp_path / "fleet")


@pytest.fixture
def served(fleet: Path) -> Iterator[Desk]:
    """A desk of the registry."""
    server = desk(fleet)
    thread = threading.Thread(target=server.run)
    thread.start()
    yield server
    server.stop()
    thread.join()


@pytest.fixture
def tab(served: Desk, browser: Browser) -> Iterator[Callable[..., Tab]]:
    """Opens the desk in a browser of its own, as a person does."""
    opened = []

    def open_(size: tuple[int, int] = DESK, *, scripts: bool = True) -> Tab:
        context = browser.new_context(
            viewport={"width": size[0], "height": size[1]},
            color_scheme="light",
            java_script_enabled=scripts,
            reduced_motion="reduce",
        )
        place = urlsplit(served.address)
        made = Tab(page=context.new_page(), home=f"{place.scheme}://{place.netloc}")
        made.page.set_default_timeout(30_000)
        made.page.on("console", lambda message: made.complaints.append(message.text))
        made.page.on("pageerror", lambda error: made.complaints.append(str(error)))
        made.page.on(
            "request",
            lambda one: (
                made.foreign.append(one.url) if not one.url.startswith((made.home, "data:")) else None
            ),
        )
        made.page.goto(served.address)
        made.page.wait_for_url(f"{made.home}/")
        opened.append((context, made))
        return made

    yield open_
    for context, made in opened:
        assert made.foreign == []
        context.close()
