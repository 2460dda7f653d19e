"""Every command and every block of Python in the manual runs in the order of its page, and prints what is shown."""

from __future__ import annotations

import os
import re
import shutil
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.docs.examples import ELISION, Desk, blocks, matches
from tests.docs.test_manual import DOCS, PAGES
from tests.registry.git.repositories import seclude

if TYPE_CHECKING:
    from tests.conftest import Flight

ELSEWHERE = {
    "registry.md": "tests/test_registry_docs.py",
    "publishing.md": "tests/registry/published/test_documentation.py",
}
"""Pages whose blocks have a test of their own, which has what they need: a server, a digest."""

NOT_RUN = 16
"""At most so many blocks are shown and not run: they need another program, a cluster, a bucket or a hosting service."""

RUN = [
    page
    for page in PAGES
    if page.relative_to(DOCS).as_posix() not in ELSEWHERE and blocks(page.read_text("utf-8"))
]

LONG = {"tutorials/calibrate-from-a-board.md", "how-to/bucket.md"}
"""Pages that take seconds, for a thorough run: frames are rendered and solved, a bucket's server is started."""


@pytest.fixture
def desk(request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Desk:
    """A clean folder, with the demo's flight where the page says that it begins with it."""
    home = tmp_path / "home"
    home.mkdir()
    seclude(monkeypatch, home)
    for name in ("AUTHOR", "COMMITTER"):
        monkeypatch.setenv(f"GIT_{name}_NAME", "Ada")
        monkeypatch.setenv(f"GIT_{name}_EMAIL", "ada@example.com")
    # Pages show what a terminal of 80 columns shows, here one without colours.
    for name, value in {"TTY_COMPATIBLE": "1", "TERM": "dumb", "COLUMNS": "80"}.items():
        monkeypatch.setenv(name, value)
    for name in [name for name in os.environ if name.startswith("CALIBRARY_")]:
        monkeypatch.delenv(name)
    # Pages export this; monkeypatch takes it away again.
    monkeypatch.setenv("CALIBRARY_REGISTRY", "")
    folder = tmp_path / "work"
    folder.mkdir()
    if "calibrary demo ." in request.getfixturevalue("page").read_text(encoding="utf-8"):
        flight: Flight = request.getfixturevalue("demo_flight")
        shutil.copytree(flight[0], folder / "flight", copy_function=os.link)
    return Desk(folder)


@pytest.mark.parametrize(
    "page",
    [
        pytest.param(page, id=name, marks=[pytest.mark.thorough] if name in LONG else [])
        for page in RUN
        for name in [page.relative_to(DOCS).as_posix()]
    ],
)
def test_the_page_does_what_it_shows(page: Path, desk: Desk) -> None:
    for block in blocks(page.read_text(encoding="utf-8")):
        if block.reason is not None:
            continue
        where = f"{page.name}:{block.line}"
        assert block.kind != "sh", f"{where}: show commands as console, with what they print"
        if block.kind == "python":
            printed = desk.python(block.text)
            assert matches(block.printed(), printed), f"{where} prints\n{printed}"
            continue
        for command, shown in block.steps():
            assert desk.code == 0 or command == "echo $?", (
                f"{where}: the command before {command} ended with {desk.code}"
            )
            # The flight is there already: writing it takes longer than all that a page does with it.
            if command == "calibrary demo ." and shown.strip() == ELISION:
                continue
            printed = desk.command(command)
            assert matches(shown, printed), f"{where}: {command}\nprints\n{printed}"
        assert desk.code == 0, f"{where}: the last command ended with {desk.code}"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(DOCS).as_posix())
def test_commands_are_shown_in_blocks_that_are_run(page: Path) -> None:
    """Not indented, where no test would find them."""
    assert (
        re.findall(
            r"(?m)^    (?:\$ )?calibrary .*$", re.sub(r"(?ms)^```.*?^```$", "", page.read_text("utf-8"))
        )
        == []
    )


def test_what_is_not_run_is_little_and_says_why() -> None:
    unrun = [
        block
        for page in PAGES
        for block in blocks(page.read_text(encoding="utf-8"))
        if block.reason is not None
    ]
    assert len(unrun) <= NOT_RUN
    assert all(len(block.reason.split()) > 2 for block in unrun if block.reason is not None)


@pytest.mark.parametrize("name", ELSEWHERE)
def test_pages_with_a_test_of_their_own_have_one(name: str) -> None:
    text = (DOCS.parent / ELSEWHERE[name]).read_text(encoding="utf-8")
    assert re.search(rf"docs/{name}", text)


def test_an_elision_stands_for_lines_and_for_text_within_one() -> None:
    printed = "one 1.25 px\ntwo\n\nthree   \nfour\n"
    assert matches("one … px\n…\nfour", printed)
    assert matches("one 1.25 px\ntwo\nthree\nfour", printed)
    assert not matches("one 1.26 px\n…\nfour", printed)
    assert not matches("one 1.25 px\n…\nfive", printed)
