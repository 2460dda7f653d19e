"""A result is described once: terminal, page, desk and notebook show the same columns and words in one order."""

from __future__ import annotations

import html
import io
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

import calibrary
from calibrary.cli.console import Screen
from calibrary.cli.shown import show
from calibrary.jobs.audit.told import told as audit_told
from calibrary.jobs.desk import flights
from calibrary.jobs.diff.comparison import compare
from calibrary.jobs.diff.told import told as diff_told
from calibrary.jobs.extract.report import ExtractReport
from calibrary.jobs.extract.told import told
from calibrary.pages import render_page
from calibrary.view import SideBySide, Table, View, text_of
from tests.jobs.diff.cameras import changed
from tests.jobs.extract.fleet import DEWARP, P4R, entry, files, gate, picture, plan
from tests.workshop import CAMERA


def terminal(view: View) -> str:
    screen = Screen(file=io.StringIO(), width=300)
    show(screen, view)
    assert isinstance(screen.file, io.StringIO)
    return screen.file.getvalue()


def order(words: list[str], text: str) -> None:
    """Each of the words is in the text, in this order."""
    at = 0
    for word in words:
        found = text.find(word, at)
        assert found >= 0, (word, text)
        at = found + len(word)


def answer(view: View) -> Table:
    return next(block for block in view.sections[0].blocks if isinstance(block, Table))


def cells(table: Table) -> list[str]:
    rows = [[text_of(cell) for cell in row] for row in table.rows]
    return [cell for row in ([one.title for one in table.columns], *rows) for cell in row if cell]


def rendered(view: View) -> str:
    body = render_page(view).partition("<main")[2]
    return html.unescape(re.sub(r"\s+", " ", re.sub(r"</?(span|bdi|wbr)[^>]*>", "", body)))


def shown_equally(view: View, in_notebook: str) -> None:
    """The table of the answer is whole and in the same order in every medium."""
    table = answer(view)
    beside = [one.title for one in table.columns if one.below is None]
    order(beside, terminal(view))
    order([text_of(cell) for row in table.rows for cell in row if cell], terminal(view))
    order(cells(table), rendered(view))
    order(cells(table), html.unescape(in_notebook))


@pytest.fixture
def extracted(tmp_path: Path) -> ExtractReport:
    flight = tmp_path / "flight"
    picture(flight / "a.jpg", **P4R, dewarp=DEWARP)
    picture(flight / "b.jpg", (4000, 3000), make="Acme", model="Nine", focal_mm=(0, 0))
    (flight / "torn.jpg").write_bytes(b"\xff\xd8\xff")
    return plan(gate(flight), tmp_path / "K_matrix.npy")


def test_extract_is_shown_equally(extracted: ExtractReport) -> None:
    shown_equally(told(extracted), extracted._repr_html_())


def test_the_desk_shows_what_extract_shows(extracted: ExtractReport, tmp_path: Path) -> None:
    for path, content in extracted.outputs.files.items():
        path.write_bytes(content)
    job = SimpleNamespace(
        folder=tmp_path, is_cancelled=False, text="", command="calibrary extract", title="Check"
    )
    at_desk = flights.checked(cast("Any", job), "/job/1", None)
    assert answer(at_desk) == answer(told(extracted))
    assert (at_desk.badge, at_desk.lead) == (told(extracted).badge, told(extracted).lead)


def test_twenty_cameras_and_what_a_program_gets_of_them_are_told_in_three_dozen_lines(tmp_path: Path) -> None:
    for number in range(300):
        camera = number % 20
        if camera < 15:
            picture(tmp_path / f"{number}.jpg", **P4R | {"body_serial": str(camera)}, dewarp=DEWARP)
        else:
            picture(tmp_path / f"{number}.jpg", make="Acme", model=f"No{camera}", focal_mm=(0, 0))
    report = plan(gate(tmp_path), tmp_path / "K_matrix.npy", "odm")
    assert len(terminal(told(report, files=True)).splitlines()) <= 36


def test_an_audit_is_shown_equally(tmp_path: Path) -> None:
    picture(tmp_path / "flight/a.jpg", **P4R, dewarp=DEWARP)
    picture(tmp_path / "flight/b.jpg", (4000, 3000), make="Acme", model="Nine", focal_mm=(5, 1))
    entry(tmp_path / "fleet", fx=3659.0)
    done = calibrary.open_registry(files(tmp_path / "fleet")).audit([tmp_path / "flight"])
    shown_equally(audit_told(done), done._repr_html_())


def test_an_audit_of_twenty_cameras_without_an_entry_is_told_in_six_lines(tmp_path: Path) -> None:
    for number in range(20):
        picture(tmp_path / f"flight/{number}.jpg", make="Acme", model=f"No{number}", focal_mm=(5, 1))
    (tmp_path / "fleet").mkdir()
    entry(tmp_path / "fleet", fx=3659.0)
    done = calibrary.open_registry(files(tmp_path / "fleet")).audit([tmp_path / "flight"])
    assert len(terminal(audit_told(done)).splitlines()) <= 6


def test_a_comparison_is_shown_equally() -> None:
    found = compare(CAMERA, changed(CAMERA, fx=1.01 * CAMERA.intrinsics.fx), labels=("a.xml", "b.xml"))
    table = next(b for b in diff_told(found).sections[1].blocks if isinstance(b, SideBySide)).blocks[0]
    assert isinstance(table, Table)
    for medium in (
        terminal(diff_told(found)),
        rendered(diff_told(found)),
        html.unescape(found._repr_html_()),
    ):
        order(cells(table), medium)
