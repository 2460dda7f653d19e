"""The units as a table: exported, edited and imported; approvals and reports know their labels."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from datetime import date
from pathlib import Path
from typing import Any

import pytest

from calibrary.calibration import Grade
from calibrary.cli.main import main
from calibrary.records import replace
from calibrary.registry.entry import Alias, Entry, Sensor, Validity
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.firmware import FirmwareRange
from calibrary.registry.registry import Registry
from calibrary.registry.statements import content_of
from tests.cli.registry.direct import put, put_bytes
from tests.cli.registry.fleets import commit_of, held, printed, run, xml
from tests.cli.registry.labelled import SERIALS, a_unit, labelled, six
from tests.jobs.extract.fleet import DEWARP, picture
from tests.registry.git.repositories import git

__all__ = ["labelled", "six"]

EXPORTED: tuple[tuple[str, Callable[[str], bytes]], ...] = (
    ("as it was", str.encode),
    ("with a byte order mark", lambda text: b"\xef\xbb\xbf" + text.encode()),
    ("with semicolons", lambda text: _again(text, ";").encode()),
    ("with decimal commas", lambda text: _again(text, ";", decimal=",").encode()),
    ("with tabs, as Unicode text", lambda text: _again(text, "\t").encode("utf-16")),
    ("with sep= and CRLF", lambda text: b"sep=;\r\n" + _again(text, ";").replace("\n", "\r\n").encode()),
    ("in Windows-1252", lambda text: _again(text, ";").encode("cp1252")),
)


def _again(text: str, delimiter: str, *, decimal: str = ".") -> str:
    """A table as another spreadsheet saves it."""
    out = io.StringIO()
    rows = [*csv.reader(io.StringIO(text))]
    fx = rows[0].index("fx")
    writer = csv.writer(out, delimiter=delimiter, lineterminator="\n")
    writer.writerows(
        [cell.replace(".", decimal) if at == fx else cell for at, cell in enumerate(row)] for row in rows
    )
    return out.getvalue()


class TestTable:
    @pytest.fixture
    def table(self, six: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Path:
        """The units as they are exported, with notes and tags that a spreadsheet could take for more than text."""
        strange = replace(
            held(six, "P4R-02").entry.calibration, notes=("=1+1", "'quoted'", 'a "word", größer')
        )
        put(six, replace(held(six, "P4R-02").entry, calibration=strange, tags=("lab", "old")))
        assert run(capsys, "set", "--out", tmp_path / "fleet.csv")[0] == 0
        return tmp_path / "fleet.csv"

    @pytest.mark.parametrize(("form", "saved"), EXPORTED, ids=[name for name, _ in EXPORTED])
    def test_a_table_saved_unchanged_changes_nothing(
        self,
        form: str,
        saved: Callable[[str], bytes],
        six: Path,
        table: Path,
        capsys: pytest.CaptureFixture[str],
    ) -> None:
        before = commit_of(six)
        table.write_bytes(saved(table.read_text(encoding="utf-8")))
        code, out, err = run(capsys, "set", "--table", table, "--yes")
        assert (code, commit_of(six)) == (0, before), (form, out, err)
        assert "nothing to change" in out

    def test_no_cell_is_a_formula(self, table: Path) -> None:
        with table.open(encoding="utf-8", newline="") as file:
            cells = [cell for row in csv.reader(file) for cell in row]
        assert "'=1+1\n'quoted'\na \"word\", größer" in cells
        assert not [cell for cell in cells if cell.startswith(("=", "+", "@", "-"))]

    def edited(self, table: Path, unit: str, **cells: str) -> None:
        """Another table, in which some cells of a unit's row are others."""
        with table.open(encoding="utf-8", newline="") as file:
            rows = [*csv.DictReader(file)]
        rows = [row | cells if row["label"] == unit else row for row in rows]
        with table.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, [*rows[0]])
            writer.writeheader()
            writer.writerows(rows)

    def test_what_was_edited_is_one_commit_and_the_rest_is_told(
        self, six: Path, table: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        before = commit_of(six)
        self.edited(table, "P4R-03", label="Hugo", tags="lab, spare", notes="one\ntwo", fx="3000.5")
        code, _, err = run(capsys, "set", "--table", table, "--yes")
        entry = held(six, "Hugo").entry
        assert (code, Registry.open(six).commit("HEAD~1")) == (0, before)
        assert (entry.tags, entry.notes) == (("lab", "spare"), ("one", "two"))
        assert (entry.calibration.intrinsics.fx, entry.status.value) == (3657.0, "approved")
        assert "fx (1 rows)" in err

    def test_a_label_in_one_row_of_a_unit_is_of_all_its_entries(
        self, six: Path, table: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        with table.open(encoding="utf-8", newline="") as file:
            rows = [*csv.reader(file)]
        next(row for row in rows if row[0] == "P4R-01")[0] = "Hugo"
        with table.open("w", encoding="utf-8", newline="") as file:
            csv.writer(file).writerows(rows)
        assert run(capsys, "set", "--table", table, "--yes")[0] == 0
        assert held(six, "Hugo/4864").entry.label == held(six, "Hugo/5472").entry.label == "Hugo"

    @pytest.mark.parametrize(
        ("cells", "expected"),
        [
            ({"label": "P4R-04"}, "of another unit"),
            ({"tags": "Not Small"}, "is not a tag"),
            ({"entry": "dji/nothing"}, "no such camera"),
            ({"entry": ""}, ""),
        ],
    )
    def test_nothing_is_written_while_a_row_is_bad(
        self, cells: dict[str, str], expected: str, six: Path, table: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        before = commit_of(six)
        self.edited(table, "P4R-02", notes="a good row")
        self.edited(table, "P4R-03", **(cells if cells != {"entry": ""} else {"entry": "", "serial": ""}))
        code, out, said = run(capsys, "set", "--table", table, "--yes")
        assert (code, commit_of(six)) == (1, before)
        assert expected in out + said
        document = json.loads(run(capsys, "set", "--table", table, "--yes", "--json")[1])
        assert len({one["line"] for one in document["problems"]}) == 1

    def test_what_a_colleague_wrote_since_the_export_stays(
        self, six: Path, table: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        run(capsys, "set", "P4R-03", "notes=from a colleague", "--yes")
        self.edited(table, "P4R-03", tags="mine")
        assert run(capsys, "set", "--table", table, "--yes")[0] == 0
        entry = held(six, "P4R-03").entry
        assert (entry.notes, entry.tags) == (("from a colleague",), ("mine",))

    def test_a_cell_that_both_changed_is_a_conflict(
        self, six: Path, table: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        run(capsys, "set", "P4R-03", "notes=from a colleague", "--yes")
        before = commit_of(six)
        self.edited(table, "P4R-03", notes="mine")
        code, _, err = run(capsys, "set", "--table", table, "--yes")
        assert (code, commit_of(six), "since the export" in err) == (1, before, True)

    def test_a_table_of_ones_own_names_units_by_their_serial_numbers(
        self, six: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        rows = "".join(f"{serial};Drohne {n}\n" for n, serial in enumerate(SERIALS, start=1))
        table = tmp_path / "mine.csv"
        table.write_text(f"Serial;Label\n{rows}", encoding="utf-8")
        assert run(capsys, "set", "--table", table, "--yes")[0] == 0
        assert held(six, "drohne 3").entry.calibration.intrinsics.fx == 3657.0
        assert SERIALS[2].encode() not in b"".join(path.read_bytes() for path in six.rglob("*.yaml"))


class TestApprovals:
    """What changes an approved entry and what becomes of its approval: the table of docs/registry.md."""

    @pytest.mark.parametrize(
        ("change", "goes_on"),
        [
            (lambda entry: replace(entry, label="Hugo"), True),
            (lambda entry: replace(entry, tags=("survey",)), True),
            (lambda entry: replace(entry, calibration=replace(entry.calibration, notes=("new lens",))), True),
            (lambda entry: replace(entry, validity=Validity(last=date(2030, 1, 1))), False),
            (lambda entry: replace(entry, tolerance=0.1), False),
            (lambda entry: replace(entry, override="it is right"), False),
            (lambda entry: replace(entry, aliases=(Alias(make="DJI", model="P4R"),)), False),
            (lambda entry: replace(entry, firmware=FirmwareRange(min="1.0")), False),
            (lambda entry: replace(entry, sensor=Sensor(width_mm=13.2)), False),
            (
                lambda entry: replace(entry, calibration=replace(entry.calibration, grade=Grade.ADJUSTED)),
                False,
            ),
            (lambda entry: replace(entry, calibration=replace(entry.calibration, distortion=None)), False),
            (lambda entry: _with_fx(replace(entry, label="Hugo", tags=("x",)), 3657.1), False),
        ],
    )
    def test_what_is_approved_is_all_but_label_tags_and_notes(
        self, change: Callable[[Entry], Entry], goes_on: bool
    ) -> None:
        entry = a_unit(2)
        assert (content_of(change(entry)) == content_of(entry)) is goes_on

    def test_a_unit_is_labelled_where_two_people_have_to_approve(
        self, six: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        configuration = six / "registry.yaml"
        text = f"{configuration.read_text()}\napprovals:\n  count: 2\n"
        configuration.write_text(text)
        git(six, "commit", "-qam", "Two approve")
        base = commit_of(six)
        assert run(capsys, "set", "P4R-03", "label=Hugo", "--yes")[0] == 0
        assert run(capsys, "set", "Hugo", "+survey", "--yes")[0] == 0
        document = printed(capsys, "registry-check-1", "check", f"{base}..HEAD")
        assert document["verdict"] == "good", document["findings"]

    def test_a_k_that_comes_with_a_label_is_an_unapproved_k(
        self, six: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        configuration = six / "registry.yaml"
        configuration.write_text(f"{configuration.read_text()}\napprovals:\n  count: 2\n")
        git(six, "commit", "-qam", "Two approve")
        base = commit_of(six)
        unit = _with_fx(replace(held(six, "P4R-03").entry, label="Hugo"), 3657.1)
        put_bytes(six, {unit.path: entry_yaml(unit)})
        findings = printed(capsys, "registry-check-1", "check", f"{base}..HEAD")["findings"]
        assert [one["rule"] for one in findings if one["severity"] == "error"] == []
        assert held(six, f"{unit.id}@proposed").entry.label == "Hugo"


def _with_fx(entry: Entry, fx: float) -> Entry:
    """The same with another fx."""
    K = replace(entry.calibration.intrinsics, fx=fx)
    return replace(entry, calibration=replace(entry.calibration, intrinsics=K))


def test_extract_names_a_unit_as_its_keeper_does(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    camera = ("--make", "DJI", "--model", "FC6310R", "--serial", SERIALS[2], "--label", "P4R-03")
    assert run(capsys, "add", xml(tmp_path / "c.xml"), *camera, "--approve", "--yes")[0] == 0
    tags: dict[str, Any] = {"make": "DJI", "model": "FC6310R", "focal_mm": (88, 10), "dewarp": DEWARP}
    picture(tmp_path / "flight/a.jpg", (5472, 3648), **tags, body_serial=SERIALS[2])
    capsys.readouterr()
    command = ["extract", str(tmp_path / "flight"), "--registry", str(fleet), "--dry-run"]
    main([*command])
    assert "P4R-03: DJI FC6310R" in capsys.readouterr().out
    main([*command, "--json"])
    [camera_of_unit] = json.loads(capsys.readouterr().out)["cameras"]
    assert camera_of_unit["label"] == "P4R-03"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--out", "t.csv", "label=P4R-09"), "sets nothing"),
        (("--out", "t.csv", "--table", "u.csv"), "sets nothing"),
    ],
)
def test_to_write_the_table_and_to_set_something_are_two_commands(
    six: Path, words: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = commit_of(six)
    with pytest.raises(SystemExit) as raised:
        run(capsys, "set", *words)
    assert raised.value.code == 2
    assert said in capsys.readouterr().err
    assert commit_of(six) == before
