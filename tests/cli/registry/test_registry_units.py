"""Six units of one model, distinguished by label, serial number and tags, in lists, in edits and in a spreadsheet."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import pytest

from calibrary.errors import AmbiguousCameraError
from calibrary.known_camera import hash_serial
from calibrary.records import replace
from calibrary.registry.registry import Registry
from tests.cli.desk import terminal, unstyled
from tests.cli.registry.direct import put
from tests.cli.registry.fleets import commit_of, held, printed, run, xml
from tests.cli.registry.labelled import SERIALS, labelled, six

__all__ = ["labelled", "six"]


def listed(capsys: pytest.CaptureFixture[str], *arguments: str) -> list[str | None]:
    return [one["label"] for one in printed(capsys, "entry-listing-1", "list", *arguments)["entries"]]


class TestKeys:
    @pytest.mark.parametrize(
        "key",
        [
            "P4R-03",
            "p4r-03",
            SERIALS[2],
            hash_serial("DJI", SERIALS[2])[:5],
            "sn-" + hash_serial("DJI", SERIALS[2]),
        ],
    )
    def test_a_unit_goes_by_its_label_its_serial_number_and_its_hash(
        self, key: str, six: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert held(six, key).entry.label == "P4R-03"
        shown = printed(capsys, "registry-show-1", "show", key)
        answer = printed(capsys, "resolution-1", "resolve", key)
        assert shown["label"] == answer["entry"]["label"] == "P4R-03"
        assert answer["calibration"]["intrinsics"]["fx"] == 3657.0

    def test_one_of_several_entries_of_a_unit_is_named_behind_its_label(self, six: Path) -> None:
        assert held(six, "P4R-01/4864").entry.calibration.intrinsics.fx == 3654.0
        with pytest.raises(AmbiguousCameraError, match=r"fits 2 entries: .*4864x3648.*5472x3648"):
            held(six, "P4R-01")

    @pytest.mark.usefixtures("six")
    def test_an_ambiguous_key_is_a_usage_error_that_names_the_candidates(
        self, capsys: pytest.CaptureFixture[str]
    ) -> None:
        code, _, err = run(capsys, "show", "P4R-01")
        assert (code, err.count("/4864x3648"), err.count("/5472x3648")) == (2, 1, 1)
        assert run(capsys, "show", "P4R-77")[0] == 4

    @pytest.mark.usefixtures("six")
    def test_resolving_a_label_of_two_frames_takes_the_size_that_is_stated(
        self, capsys: pytest.CaptureFixture[str]
    ) -> None:
        found = printed(capsys, "resolution-1", "resolve", "P4R-01", "--image-size", "4864x3648")
        assert found["entry"]["id"].endswith("/4864x3648")
        assert found["camera"]["serial"] == hash_serial("DJI", SERIALS[0])

    @pytest.mark.usefixtures("six")
    @pytest.mark.parametrize("command", ["log", "show", "lock"])
    def test_every_command_takes_a_label(
        self,
        command: str,
        tmp_path: Path,
        monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str],
    ) -> None:
        monkeypatch.chdir(tmp_path)
        assert run(capsys, command, "P4R-03")[0] == 0

    def test_a_unit_is_retired_by_its_label(self, six: Path, capsys: pytest.CaptureFixture[str]) -> None:
        assert run(capsys, "retire", "P4R-06", "--reason", "sold")[0] == 0
        assert held(six, "P4R-06").entry.status.value == "retired"


class TestLabel:
    def test_all_entries_of_a_unit_are_labelled_in_one_commit(
        self, six: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        before = commit_of(six)
        assert run(capsys, "set", SERIALS[0], "label=Hugo", "--yes")[0] == 0
        assert held(six, "Hugo/4864").entry.label == held(six, "Hugo/5472").entry.label == "Hugo"
        assert Registry.open(six).commit("HEAD~1") == before

    def test_two_units_do_not_share_a_label(self, six: Path, capsys: pytest.CaptureFixture[str]) -> None:
        before = commit_of(six)
        code, out, _ = run(capsys, "set", "P4R-03", "label=p4r-04", "--yes")
        assert (code, "of another unit" in out) == (1, True)
        assert commit_of(six) == before

    def test_the_check_finds_two_units_that_a_merge_gave_one_label(
        self, six: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        base = commit_of(six)
        put(six, replace(held(six, "P4R-05").entry, label="P4R-04"))
        for span in ((), (f"{base}..HEAD",)):
            document = printed(capsys, "registry-check-1", "check", *span)
            assert [one["rule"] for one in document["findings"] if one["severity"] == "error"] == ["label"]

    @pytest.mark.parametrize("label", ["=1+1", "a/b", "a@b", "a  b", "FC6310R"])
    def test_what_is_no_label_is_refused(
        self, label: str, six: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        before = commit_of(six)
        assert run(capsys, "set", "P4R-03", f"label={label}", "--yes")[0] != 0
        assert commit_of(six) == before

    def test_a_label_taken_away_is_free_again(self, six: Path, capsys: pytest.CaptureFixture[str]) -> None:
        assert run(capsys, "set", "P4R-03", "label=", "--yes")[0] == 0
        assert run(capsys, "set", "P4R-04", "label=P4R-03", "--yes")[0] == 0
        assert held(six, "P4R-03").entry.calibration.intrinsics.fx == 3658.0

    def test_a_new_calibration_of_a_unit_is_labelled_as_the_unit_is(
        self, six: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        camera = ("--make", "DJI", "--model", "FC6310R", "--serial", SERIALS[1])
        assert run(capsys, "add", xml(tmp_path / "c.xml", 3657.0), *camera, "--yes")[0] == 0
        proposed = held(six, "P4R-02@proposed").entry
        assert (proposed.label, proposed.calibration.intrinsics.fx) == ("P4R-02", 3657.0)

    def test_add_labels_and_tags_a_new_unit(
        self, fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        camera = (
            "--make",
            "DJI",
            "--model",
            "FC6310R",
            "--serial",
            "7777777",
            "--label",
            "New 1",
            "--tag",
            "spare",
        )
        assert run(capsys, "add", xml(tmp_path / "c.xml"), *camera, "--approve", "--yes")[0] == 0
        assert (held(fleet, "new 1").entry.label, held(fleet, "7777777").entry.tags) == ("New 1", ("spare",))


class TestList:
    @pytest.mark.usefixtures("six")
    @pytest.mark.parametrize("width", [80, 120])
    def test_every_entry_has_one_line_that_fits(
        self, width: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
    ) -> None:
        terminal(monkeypatch, width)
        _, out, _ = run(capsys, "list")
        head, *rows = unstyled(out).splitlines()
        assert head.split()[:2] == ["label", "entry"]
        assert len(rows) == 7
        assert max(map(len, rows)) <= width

    @pytest.mark.usefixtures("six")
    def test_what_a_line_calls_an_entry_is_a_key(self, capsys: pytest.CaptureFixture[str]) -> None:
        _, out, _ = run(capsys, "list")
        for row in out.splitlines()[1:]:
            label, key = row.split()[:2]
            assert printed(capsys, "registry-show-1", "show", key)["label"] == label

    @pytest.mark.usefixtures("six")
    @pytest.mark.parametrize(
        ("where", "numbers"),
        [
            ("grade=design", [3]),
            ("grade=design,adjusted", [3]),
            ("grade!=design label~0", [1, 1, 2, 4, 5, 6]),
            ("date<2022", [1, 1, 2]),
            ("date<2022-03-03", [1, 1, 2]),
            ("date<=2022-03", [1, 1, 2, 3]),
            ("date=2024", [5]),
            ("fx>=3658 fx<3660", [4, 5]),
            ("label~r-0 label!=P4R-01", [2, 3, 4, 5, 6]),
            ("size=4864x3648", [1]),
            ("!until tags", []),
            ("!tags k1<0 date>2024", [6]),
            ("model='fc6310r' tool~\"lab 3\" date>=2025", [6]),
        ],
    )
    def test_entries_are_chosen_by_any_field(
        self, where: str, numbers: list[int], capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert sorted(map(str, listed(capsys, "--where", where))) == [f"P4R-0{number}" for number in numbers]

    @pytest.mark.usefixtures("six")
    def test_several_conditions_have_to_hold_all(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert listed(capsys, "--where", "date>=2022", "--where", "fx<3659") == ["P4R-03", "P4R-04"]

    @pytest.mark.usefixtures("six")
    def test_rows_are_sorted_by_fields_in_either_direction(self, capsys: pytest.CaptureFixture[str]) -> None:
        assert listed(capsys, "--sort", "-fx") == [
            "P4R-06",
            "P4R-05",
            "P4R-04",
            "P4R-03",
            "P4R-02",
            "P4R-01",
            "P4R-01",
        ]
        assert listed(capsys, "--sort", "grade,-label")[-1] == "P4R-03"

    @pytest.mark.usefixtures("six")
    @pytest.mark.parametrize(
        ("arguments", "expected"),
        [
            (("--where", "grad=design"), "grade"),
            (("--where", "fx<wide"), "fx is a number"),
            (("--where", "grade="), "not a condition"),
            (("--sort", "focl"), "focal"),
            (("--columns", "lable"), "label"),
        ],
    )
    def test_what_is_no_condition_or_field_is_told_with_what_is_near(
        self, arguments: tuple[str, ...], expected: str, capsys: pytest.CaptureFixture[str]
    ) -> None:
        code, _, said = run(capsys, "list", *arguments)
        assert (code, expected in said) == (3, True), said

    @pytest.mark.usefixtures("six")
    def test_columns_and_csv_hold_the_fields_that_were_asked_for(
        self, capsys: pytest.CaptureFixture[str]
    ) -> None:
        _, out, _ = run(capsys, "list", "--where", "fx>3657 fx<3659", "--columns", "label,fx,serial,k1")
        assert out.splitlines()[1].split() == ["P4R-04", "3658", hash_serial("DJI", SERIALS[3]), "-0.262"]
        _, out, _ = run(capsys, "list", "--where", "label=P4R-04", "--columns", "label,fx,k1", "--table", "-")
        assert [*csv.reader(io.StringIO(out))] == [["label", "fx_px", "k1"], ["P4R-04", "3658.0", "-0.262"]]


class TestTagsAndEdits:
    def test_tags_come_and_go_in_one_commit(self, six: Path, capsys: pytest.CaptureFixture[str]) -> None:
        before = commit_of(six)
        assert run(capsys, "set", "P4R-01", "P4R-02", "+survey", "+lab", "--yes")[0] == 0
        assert Registry.open(six).commit("HEAD~1") == before
        assert run(capsys, "set", "--where", "tags=survey size=5472x3648", "-survey", "--yes")[0] == 0
        assert listed(capsys, "--where", "tags=survey") == ["P4R-01"]
        assert listed(capsys, "--where", "tags=lab", "--sort", "label") == ["P4R-01", "P4R-01", "P4R-02"]

    def test_a_dry_run_shows_the_table_and_writes_nothing(
        self, six: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        before = commit_of(six)
        code, out, _ = run(capsys, "set", "--where", "grade=design", "notes=spare lens", "--dry-run")
        assert (code, commit_of(six)) == (0, before)
        assert out.split()[5:9] == ["notes", "–", "spare", "lens"]

    def test_many_entries_are_set_as_one_commit(self, six: Path, capsys: pytest.CaptureFixture[str]) -> None:
        before = commit_of(six)
        assert (
            run(capsys, "set", "--where", "date<2023", "tags=old,lab", "notes+=to be done", "--yes")[0] == 0
        )
        assert Registry.open(six).commit("HEAD~1") == before
        entry = held(six, "P4R-03").entry
        assert (entry.tags, entry.notes, entry.status.value) == (("lab", "old"), ("to be done",), "approved")

    @pytest.mark.parametrize(
        "word", ["fx=3000", "status=approved", "grade=calibrated", "model=X", "tgas=x", "label+=x"]
    )
    def test_k_and_what_finds_it_cannot_be_set(
        self, word: str, six: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        before = commit_of(six)
        code, _, _ = run(capsys, "set", "P4R-03", word, "--yes")
        assert (code, commit_of(six)) == (3, before)

    def test_other_days_are_proposed_and_not_used(
        self, six: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        assert run(capsys, "set", "P4R-03", "valid-until=2030-12-31", "--yes")[0] == 0
        assert held(six, "P4R-03").entry.validity is None
        proposed = held(six, "P4R-03@proposed").entry
        assert str(proposed.validity) == "until 2030-12-31"
        assert run(capsys, "approve", "P4R-03", "--digest", str(held(six, "P4R-03@proposed").oid))[0] == 0
        assert str(held(six, "P4R-03").entry.validity) == "until 2030-12-31"


def test_a_unit_goes_by_a_serial_number_of_three_letters(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = xml(tmp_path / "a.xml")
    words = ("add", file, "--make", "Fleet", "--model", "CamA", "--serial", "SN1", "--approve", "--yes")
    assert run(capsys, *words)[0] == 0
    for word in ("SN1", "CamA"):
        assert printed(capsys, "resolution-1", "resolve", word)["entry"]["id"] == held(fleet, "SN1").id
