"""A field of the provenance is one line in its record; a place where it would be silent is named here."""

from __future__ import annotations

from collections.abc import Callable
from datetime import date
from pathlib import Path

import pytest

from calibrary.arguments import Stated
from calibrary.calibration import Calibration
from calibrary.cli.main import main
from calibrary.jobs.diff.comparison import compare
from calibrary.jobs.diff.told import told as told_diff
from calibrary.jobs.extract.told import _origin as extracted
from calibrary.jobs.site.building import entry_files
from calibrary.jobs.site.folder import Place
from calibrary.pages import render_page
from calibrary.parsers.format import STATED
from calibrary.provenance import ABOUT, HOW_MADE, Provenance, SourceFile, facts
from calibrary.records import replace
from calibrary.registry.fields import entry_row, entry_rows, known_fields
from calibrary.registry.query import find_field, parse_where, select
from tests.registry.entries import an_entry

JOBS = Path(__file__).parents[2] / "src" / "calibrary" / "jobs"
SPECIAL = {
    "kind": "adjustment",
    "reference_size": (4000, 3000),
    "assumptions": ("assumptions of the test",),
    "sha256": "5c" * 32,
    "sources": (SourceFile(name="sources of the test", sha256="5c" * 32),),
    "date": "2023-04-05",
}
MADE = Provenance(
    **{name: SPECIAL.get(name, f"{name} of the test") for name in Provenance.__struct_fields__}  # type: ignore[arg-type]
)
TEXTS = {"kind": "adjustment", "reference_size": "4000×3000", "sha256": "5c" * 32, "date": "2023-04-05"}
LISTED = {name for name, one in ABOUT.items() if one.listed}
FLAGS = {name for name, one in ABOUT.items() if one.flag is not None}


def calibrated() -> Calibration:
    return an_entry(provenance=MADE).calibration


def camera_page() -> str:
    entry = an_entry(provenance=MADE)
    pages = entry_files(
        entry, data=b"", id_=entry.id, place=Place.of(entry.path, proper=True), revisions=(), changes=()
    )
    return b"".join(data for address, data in pages.items() if address.endswith(".html")).decode()


def of_extract() -> str:
    return extracted(calibrated())


SHOWS: dict[str, tuple[Callable[[], str], set[str]]] = {
    "registry show": (lambda: str(entry_rows(an_entry(provenance=MADE))), set(ABOUT)),
    "the page of a camera": (camera_page, set(ABOUT)),
    "the page of a comparison": (
        lambda: render_page(told_diff(compare(calibrated(), replace(calibrated(), notes=())), 100.0)),
        LISTED,
    ),
    "the page of an extraction": (of_extract, LISTED - {"sha256"}),
    "the calibration in a notebook": (lambda: calibrated()._repr_html_(), LISTED),
}


@pytest.mark.parametrize("place", SHOWS)
def test_every_field_is_shown(place: str) -> None:
    made, expected = SHOWS[place]
    text = made()
    silent = [name for name in expected if TEXTS.get(name, f"{name} of the test") not in text]
    assert silent == []


def test_every_page_that_tells_of_a_calibration_takes_the_fields_from_their_declaration() -> None:
    # inspect tells what a file's reading assumed, and nothing of how its camera was calibrated.
    shown = {*JOBS.rglob("*page*.py"), *JOBS.rglob("told.py")} - {JOBS / "inspect" / "told.py"}
    pages = [path for path in shown if ".provenance" in path.read_text(encoding="utf-8")]
    assert len(pages) >= 4
    assert [
        str(path.relative_to(JOBS)) for path in pages if "facts(" not in path.read_text(encoding="utf-8")
    ] == []


@pytest.mark.parametrize("name", [name for name in ABOUT if name not in {"kind", "sources"}])
def test_every_field_is_searched_by_its_own_name(name: str) -> None:
    row = entry_row(an_entry(provenance=MADE))
    field = find_field(name, known_fields())
    [words] = {str(row[field])}
    found = select([("a", row), ("b", {})], parse_where(f'{name}="{words}" {name}'), sort=f"-{name}")
    assert found.paths == ("a",)


@pytest.mark.parametrize("command", ["registry add", "onboard"])
def test_every_field_with_a_flag_has_it(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main([*command.split(), "--help"])
    text = capsys.readouterr().out
    assert [name for name in FLAGS if f"--{name.replace('_', '-')} " not in text] == []


@pytest.mark.parametrize("way", ["", "flight", "rig"])
def test_calibrate_takes_what_it_does_not_know_itself(way: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["calibrate", *way.split(), "--help"])
    text = capsys.readouterr().out
    assert [name for name in FLAGS - {"tool"} if f"--{name.replace('_', '-')} " not in text] == []


def test_what_a_user_states_replaces_or_completes_what_the_source_states() -> None:
    said = Stated(**{name: date(2020, 1, 1) if ABOUT[name].flag == "day" else "a flag" for name in FLAGS})
    of_it = {name: getattr(said.of(MADE), name) for name in FLAGS}
    assert of_it == {name: str(getattr(said, name)) for name in FLAGS}
    assert said.completing(MADE) == MADE
    assert len([*said.warnings(MADE)]) == len(FLAGS)


def test_a_calibration_file_may_state_how_it_was_made() -> None:
    assert {*STATED} == {*HOW_MADE} - {"firmware"}


def test_what_is_not_stated_is_not_shown() -> None:
    assert facts(Provenance(kind="seed")) == (("source", "seed"),)
    assert facts(Provenance(kind="seed"), traced=False) == ()
