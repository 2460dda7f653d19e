"""A result is described once: terminal, page, desk and notebook show the same columns and words in one order."""

from __future__ import annotations

import html
import io
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

import calibrary
from calibrary.cli.console import Screen
from calibrary.cli.terminal import show
from calibrary.jobs.audit.told import told as audit_told
from calibrary.jobs.convert import convert
from calibrary.jobs.desk import boards, flights
from calibrary.jobs.diff.comparison import compare
from calibrary.jobs.extract.report import ExtractReport
from calibrary.jobs.extract.told import told
from calibrary.jobs.fleet import create_registry
from calibrary.jobs.inspect import inspect
from calibrary.jobs.onboard import onboard
from calibrary.pages import render_page
from calibrary.pages.notebook import in_notebook
from calibrary.records import encoded
from calibrary.view import Block, Section, SideBySide, Table, View, text_of, view_of
from tests.jobs.calibrate.boards import PROVISIONAL, corners
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
    return next(tables(view.sections[0].blocks))


def tables(blocks: Iterable[Block]) -> Iterator[Table]:
    """The tables that no summary hides."""
    for block in blocks:
        if isinstance(block, Table):
            yield block
        elif isinstance(block, SideBySide) or (isinstance(block, Section) and block.printed):
            yield from tables(block.blocks)


def cells(table: Table) -> list[str]:
    rows = [[text_of(cell) for cell in row] for row in table.rows]
    return [cell for row in ([one.title for one in table.columns], *rows) for cell in row if cell]


def rendered(view: View) -> str:
    body = render_page(view).partition("<main")[2]
    return html.unescape(re.sub(r"\s+", " ", re.sub(r"</?(span|bdi|wbr)[^>]*>", "", body)))


def shown_equally(view: View, in_notebook: str) -> None:
    """The tables of the answer are whole and in the same order in every medium."""
    shown = [*tables(view.sections)]
    assert shown
    order([one.title for table in shown for one in table.columns if one.below is None], terminal(view))
    order([text_of(cell) for table in shown for row in table.rows for cell in row if cell], terminal(view))
    order([word for table in shown for word in cells(table)], rendered(view))
    order([word for table in shown for word in cells(table)], html.unescape(in_notebook))


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
    shown_equally(view_of(found), found._repr_html_())


def test_a_calibration_is_shown_equally_and_the_desk_shows_its_sections(tmp_path: Path) -> None:
    report = calibrary.calibrate(corners=corners(tmp_path / "corners.json", how=PROVISIONAL))
    shown_equally(view_of(report), in_notebook(report))
    job = SimpleNamespace(words=["calibrate"], documents=[encoded(report)], is_cancelled=False, text="")
    job.title, job.command = "Board", "calibrary calibrate"
    at_desk = boards.solved(cast("Any", job), "/job/1", None)
    assert [*tables(at_desk.sections)] == [*tables(view_of(report).sections)]
    assert (at_desk.badge, at_desk.lead) == (view_of(report).badge, view_of(report).lead)


def test_what_a_payload_a_check_an_inspection_and_a_conversion_find_is_shown_equally(tmp_path: Path) -> None:
    picture(tmp_path / "flight/a.jpg", **P4R, dewarp=DEWARP)
    written, other = tmp_path / "flight/a.yml", tmp_path / "flight/b.yml"
    converted = convert([tmp_path / "flight/a.jpg"], str(written), to="opencv_storage")
    other.write_bytes(written.read_bytes())
    (tmp_path / "fleet").mkdir()
    fleet = create_registry(tmp_path / "fleet").place
    for result in (
        calibrary.check(tmp_path / "flight"),
        onboard(tmp_path / "flight", registry=fleet, html=tmp_path / "page.html"),
    ):
        shown_equally(view_of(result), in_notebook(result))
    many = convert([written, other], str(tmp_path / "many"), to="opencv_storage")
    shown_equally(view_of(many, place="many"), rendered(view_of(many, place="many")))
    for view in (view_of(inspect([written])), view_of(converted, place="a.yml")):
        for section in view.sections:
            order([text for text in section.blocks if isinstance(text, str)], terminal(view))
