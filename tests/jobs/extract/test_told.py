"""The run as a page: the same verdicts, reasons and numbers as everywhere else, those that need attention first."""

from __future__ import annotations

import html
import re
from datetime import date
from pathlib import Path

import pytest

from calibrary.jobs.extract import told as told_module
from calibrary.jobs.extract.report import ExtractReport
from calibrary.jobs.extract.told import told
from calibrary.jobs.images.folders import SkippedFile
from calibrary.pages import render_page
from calibrary.records import replace
from calibrary.validation import Verdict
from calibrary.view import Badge, Details, Link, Note, Plots, Section, Table, Tone, View, text_of
from tests.jobs.extract.fleet import DEWARP, NOBODY, P4R, PLANE, gate, matrix, picture, plan


@pytest.fixture(scope="module")
def outcome(tmp_path_factory: pytest.TempPathFactory) -> ExtractReport:
    """Valid, unproven, rejected with numbers, rejected without, a stand-in, and a corrupt file."""
    folder = tmp_path_factory.mktemp("run")
    flight = folder / "flight"
    picture(flight / "valid.jpg", **P4R, dewarp=DEWARP, focal_35mm=24, body_serial="SECRET-4711")
    picture(flight / "unproven.jpg", **NOBODY, focal_35mm=36)
    picture(
        flight / "implausible.jpg", make="Example", model="Far", focal_mm=(600, 10), focal_35mm=24, **PLANE
    )
    picture(flight / "stripped.jpg")
    picture(flight / "stand-in.jpg", (4000, 3000), make="DJI", model="FC330", focal_mm=(0, 0), focal_35mm=20)
    (flight / "corrupt.jpg").write_bytes(b"\xff\xd8\xff")
    return gate(flight, fallback_k=matrix(folder / "fc330.npy", 2290.0, 2000.0, 1500.0))


@pytest.fixture(scope="module")
def page(outcome: ExtractReport, tmp_path_factory: pytest.TempPathFactory) -> View:
    return made(outcome, tmp_path_factory.mktemp("out"))


def made(outcome: ExtractReport, folder: Path) -> View:
    return told(plan(outcome, folder / "K_matrix.npy", None))


def text(page: View) -> str:
    """What a reader sees."""
    body = re.sub('<span class="whole">(.*?)</span>', r"\1", render_page(page).partition("<body>")[2])
    return html.unescape(re.sub(r"\s+", " ", re.sub(r"<[^>]+>", " ", body)))


def section(page: View, word: str) -> Section:
    [found] = [section for section in page.sections if word in section.title]
    return found


def overview(page: View) -> Table:
    [table] = [block for block in section(page, "Cameras").blocks if isinstance(block, Table)]
    return table


def test_the_cameras_that_need_attention_are_first(page: View) -> None:
    verdicts = [row[1].text for row in overview(page).rows if isinstance(row[1], Badge)]
    assert verdicts == sorted(verdicts, key=["rejected", "unread", "unproven", "valid"].index)
    assert len(set(verdicts)) == 4


def test_every_camera_of_the_overview_leads_to_its_section(page: View) -> None:
    targets = [row[0].target for row in overview(page).rows if isinstance(row[0], Link)]
    anchors = re.findall(r'<h2 id="([^"]+)"', render_page(page))
    assert len(targets) == 5
    assert {target.removeprefix("#") for target in targets} <= set(anchors)


def test_every_reason_and_every_way_out_is_told(outcome: ExtractReport, page: View) -> None:
    seen = text(page)
    for camera in outcome.judged:
        failures = camera.report.failures if camera.report is not None else ()
        for sentence in (camera.reason, camera.advice, *(finding.message for finding in failures)):
            assert sentence is None or re.sub(r"\s+", " ", sentence) in seen


def test_a_valid_camera_has_its_k_its_distortion_and_its_lens(page: View) -> None:
    shown = section(page, "FC6310R")
    seen = text(replace(page, sections=(shown,)))
    for number in ("3660.50 px", "3655.25 px", "2731.50 px", "1846.75 px", "−0.268", "0.112"):
        assert number in seen
    [plots] = [block for block in shown.blocks if isinstance(block, Plots)]
    beginnings = [plot.alt[:6] for plot in plots.draw()]
    assert beginnings == ["fx by ", "Arrows", "Radial"]


def test_the_evidence_is_shown_side_by_side(outcome: ExtractReport, page: View) -> None:
    [camera] = [c for c in outcome.judged if c.camera.key.model == "FC6310R"]
    [plots] = [block for block in section(page, "FC6310R").blocks if isinstance(block, Plots)]
    evidence, *_ = plots.draw()
    for estimate in camera.camera.evidence.estimates:
        assert f"{estimate.tag} {estimate.intrinsics.fx:.1f} px" in evidence.alt
    assert "DewarpData 3660.5 px, used" in evidence.alt
    assert "Expected by the catalogue" in evidence.alt


def test_numbers_that_were_rejected_are_not_shown_as_a_k(page: View) -> None:
    shown = section(page, "Far")
    [folded] = [b for b in shown.blocks if isinstance(b, Details) and "rejected" in b.summary]
    rest = replace(
        shown, blocks=tuple(b for b in shown.blocks if b is not folded and not isinstance(b, Plots))
    )
    rejected = "18000.00 px"
    assert rejected in text(replace(page, sections=(replace(shown, blocks=(folded,)),)))
    assert rejected not in text(replace(page, sections=(rest,)))
    [row] = [row for row in overview(page).rows if isinstance(row[0], Link) and "Far" in row[0].text]
    assert row[3:6] == ("", "1", "")


def test_what_stands_in_is_told_with_all_that_was_tried(page: View) -> None:
    seen = text(replace(page, sections=(section(page, "FC330"),)))
    assert "fc330.npy is used; the images alone give no valid K" in seen
    assert "fallback-k taken fc330.npy" in seen


def test_images_that_were_set_aside_are_listed_with_the_reason(outcome: ExtractReport, page: View) -> None:
    seen = text(replace(page, sections=(section(page, "Images skipped"),)))
    assert f"corrupt.jpg {outcome.rejected[0].reason}" in seen


def test_no_serial_number_and_no_folder_is_in_it(page: View, tmp_path: Path) -> None:
    rendered = render_page(page)
    assert "SECRET" not in rendered
    assert str(tmp_path.parent.parent) not in rendered


def test_what_else_is_to_be_said_of_the_run_is_a_note(outcome: ExtractReport, tmp_path: Path) -> None:
    (tmp_path / "K_matrix.gone.npy").write_bytes(b"")
    notes = [b.text for b in section(made(outcome, tmp_path), "Cameras").blocks if isinstance(b, Note)]
    assert "K_matrix.gone.npy is left from an earlier run; remove it" in notes


def test_every_cause_that_keeps_images_from_a_k_is_a_row_with_its_next_step(
    outcome: ExtractReport, page: View
) -> None:
    due = [camera for camera in outcome.cameras if camera.verdict is not Verdict.VALID]
    rows = {text_of(row[0]): row[6:] for row in overview(page).rows}
    assert [rows[camera.name] for camera in due] == [(camera.why, camera.what_to_do) for camera in due]
    assert rows["corrupt.jpg"][0] == outcome.rejected[0].reason


def test_cameras_with_one_cause_share_a_row_with_their_number_and_the_first_of_them(tmp_path: Path) -> None:
    for number in range(5):
        picture(tmp_path / "flight" / f"{number}.jpg", make="Acme", model=f"No{number}", focal_mm=(0, 0))
    [table] = [b for b in told(gate(tmp_path / "flight")).sections[0].blocks if isinstance(b, Table)]
    [row] = table.rows
    assert text_of(row[0]) == "Acme No0 5472×3648 and 4 more"
    assert row[3] == "5"


def test_valid_cameras_beyond_ten_share_a_row(tmp_path: Path) -> None:
    for number in range(15):
        serial = {"body_serial": str(number)}
        picture(tmp_path / "flight" / f"{number}.jpg", **P4R | serial, dewarp=DEWARP)
    [table] = [b for b in told(gate(tmp_path / "flight")).sections[0].blocks if isinstance(b, Table)]
    assert len(table.rows) == 11
    assert text_of(table.rows[-1][0]) == "5 more"


def test_images_with_one_fault_share_a_row(tmp_path: Path) -> None:
    for number in range(15):
        (tmp_path / f"{number}.jpg").write_bytes(b"")
    [table] = [b for b in told(gate(tmp_path)).sections[0].blocks if isinstance(b, Table)]
    assert [text_of(row[0]) for row in table.rows] == ["0.jpg and 14 more"]


def test_folder_and_days_are_at_the_top_as_far_as_they_are_known(
    outcome: ExtractReport, page: View, tmp_path: Path
) -> None:
    assert page.facts == (("folder", "flight"),)
    flown = replace(outcome, days=(date(2026, 4, 30), date(2026, 5, 1)))
    stated = told(plan(flown, tmp_path / "K_matrix.npy", None), checked=date(2026, 5, 2))
    assert [value for _, value in stated.facts] == ["flight", "2026-04-30 to 2026-05-01", "2026-05-02"]


def test_the_days_of_a_flight_are_read_when_they_are_asked_for(tmp_path: Path) -> None:
    for day in ("2024:05:18", "2024:05:17"):
        picture(tmp_path / "flight" / f"{day[-2:]}.jpg", **P4R, date_time=f"{day} 09:30:00")
    assert gate(tmp_path / "flight").days is None
    assert gate(tmp_path / "flight", days=True).days == (date(2024, 5, 17), date(2024, 5, 18))


def test_a_run_without_a_fault_says_so(tmp_path: Path) -> None:
    picture(tmp_path / "flight/a.jpg", **P4R, dewarp=DEWARP)
    page = made(gate(tmp_path / "flight"), tmp_path)
    assert page.badge == Badge("every K is valid", Tone.GOOD)
    assert page.lead == "1 camera, judged by the fleet policy: 1 valid"


def test_a_run_of_very_many_cameras_stays_a_page(
    outcome: ExtractReport, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(told_module, "MOST_CAMERAS", 3)
    monkeypatch.setattr(told_module, "MOST_DRAWN", 2)
    monkeypatch.setattr(told_module, "MOST_NAMES", 4)
    torn = tuple(SkippedFile(name=f"{n}.jpg", reason="torn") for n in range(9))
    page = made(replace(outcome, rejected=torn), tmp_path)
    drawn = [any(isinstance(block, Plots) for block in s.blocks) for s in page.sections]
    assert drawn.count(True) <= 2
    seen = text(page)
    assert "5 more are listed in the report." in seen


def test_the_same_run_gives_the_same_bytes(outcome: ExtractReport, page: View, tmp_path: Path) -> None:
    assert render_page(made(outcome, tmp_path)) == render_page(page)


def test_the_images_of_several_states_are_shown_by_state(tmp_path: Path) -> None:
    flight = tmp_path / "flight"
    picture(flight / "old.jpg", **P4R, dewarp=DEWARP, body_serial="1", software="v1")
    picture(flight / "lost.jpg", **P4R, body_serial="1", software="v2")
    seen = text(made(gate(flight), tmp_path))
    assert "The images by what can change K or its meaning" in seen
    assert "takes over the camera's K" in seen
    assert "1 of 2 images lack drone-dji:DewarpData" in seen


@pytest.mark.parametrize(("most", "more"), [(1, True), (2, False)])
def test_the_images_beyond_those_shown_are_counted(
    most: int, more: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(told_module, "MOST_NAMES", most)
    for name in ("a", "b"):
        picture(tmp_path / "flight" / f"{name}.jpg", **P4R, dewarp=DEWARP)
    seen = text(made(gate(tmp_path / "flight"), tmp_path))
    assert ("and 1 more, listed in the report" in seen) is more
