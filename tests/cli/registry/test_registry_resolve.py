"""``registry resolve`` and ``show IMAGE``: which calibration answers, why this one, and what else was near."""

from __future__ import annotations

import json
import shutil
from datetime import date
from pathlib import Path
from typing import Any

import pytest

from calibrary.calibration import Quality
from calibrary.distortion import BrownConrady
from calibrary.errors import ParseError
from calibrary.jobs.extract.knowledge import Knowledge
from calibrary.jobs.resolve.run import FleetAnswer
from calibrary.known_camera import hash_serial
from calibrary.parsers.imagery import read_metadata
from calibrary.quality import Covariance
from calibrary.records import from_json
from calibrary.registry.entry import Alias, Status, Validity
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.firmware import FirmwareRange
from calibrary.schemas import require
from calibrary.validation import Severity
from tests.cli.registry.conftest import Filled
from tests.cli.registry.direct import put
from tests.cli.registry.fleets import P4R, add, printed, run, xml
from tests.jobs.extract.fleet import gate, picture
from tests.registry.entries import an_entry
from tests.registry.git.repositories import git

TAGS: dict[str, Any] = {"make": "DJI", "model": "FC6310R", "focal_mm": (88, 10)}


def test_an_image_gets_the_entry_of_its_camera(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    commit = put(fleet, an_entry(focal_mm=None))
    answer = printed(capsys, "resolution-1", "resolve", picture(tmp_path / "a.jpg", **TAGS))
    assert answer["entry"]["id"] == P4R
    assert answer["commit"] == commit
    assert answer["calibration"]["intrinsics"]["fx"] == 3661.25
    assert answer["camera"]["focal_mm"] == 8.8
    assert answer["known_by"].startswith("the image: Phantom 4 RTK")


def test_what_a_document_says_of_the_use_comes_back_from_it(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, an_entry(focal_mm=None))
    answer = printed(capsys, "resolution-1", "resolve", "dji/fc6310r")
    read = from_json(FleetAnswer, answer)
    assert (read.use, read.use_reason) == (answer["use"], answer["use_reason"]) != (None, None)
    assert read.to_dict() == answer
    with pytest.raises(ParseError, match="perhaps"):
        from_json(FleetAnswer, answer | {"use": "perhaps"})


def test_the_terminal_states_the_use_the_entry_and_k_in_one_line(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, an_entry())
    assert run(capsys, "resolve", "dji/fc6310r")[1] == (
        f"start  {an_entry().path}  fx 3661.2500  fy 3658.7500  cx 2731.5000  cy 1831.2500 px  5472×3648\n"
    )


def test_show_tells_of_an_image_what_resolve_prints_and_the_story_of_its_entry(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    commit = put(fleet, an_entry(label="P4R-03"))
    image = picture(tmp_path / "a.jpg", **TAGS)
    code, text, _ = run(capsys, "show", image)
    rows = {line.split()[0]: " ".join(line.split()[1:]) for line in text.splitlines() if line.strip()}
    assert code == run(capsys, "resolve", image)[0] == 0
    assert "(P4R-03)" in text
    assert rows["entry"] == f"{an_entry().path} at {commit[:12]}, approved"
    assert rows["grade"] == "calibrated"
    assert [rows[name] for name in ("fx", "fy", "cx", "cy")] == [
        "3661.25 px",
        "3658.75 px",
        "2731.50 px",
        "1831.25 px",
    ]
    assert rows["adapted"] == "no, it is of this size"
    assert rows["distortion"] == "brown"
    assert rows["k1"] == "−0.262"
    assert rows["recorded"].endswith(f"commit {commit[:12]}")
    assert run(capsys, "resolve", image)[1].split()[0] == rows["use"]
    assert "contradicts" not in text


def test_show_and_resolve_of_an_image_are_one_document(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, an_entry(focal_mm=None))
    image = picture(tmp_path / "a.jpg", **TAGS)
    assert run(capsys, "show", image, "--json") == run(capsys, "resolve", image, "--json")


@pytest.mark.parametrize(
    ("k1", "use", "why"), [(-0.9, "none", "not monotonic"), (-0.1, "start", "how well is not stated")]
)
def test_show_and_resolve_give_a_forced_entry_one_use(
    k1: float, use: str, why: str, fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, an_entry(distortion=BrownConrady(k1=k1, k2=0.0, p1=0.0, p2=0.0), override="it is so"))
    asked = [
        printed(capsys, *words, P4R) for words in (("registry-show-1", "show"), ("resolution-1", "resolve"))
    ]
    assert [one["use"] for one in asked] == [use, use]
    assert all(why in one["use_reason"] for one in asked)


@pytest.mark.parametrize("flag", [["--yaml"], ["--diff", "HEAD"]])
def test_show_of_an_image_has_no_file_and_no_revision(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], flag: list[str]
) -> None:
    put(fleet, an_entry())
    with pytest.raises(SystemExit, match="2"):
        run(capsys, "show", picture(tmp_path / "a.jpg", **TAGS), *flag)
    assert "--diff and --yaml: of an entry" in capsys.readouterr().err


def test_a_word_too_long_for_a_name_is_no_camera(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    put(fleet, an_entry())
    code, _, err = run(capsys, "resolve", "a" * 5000)
    assert (code, "no such camera" in err) == (4, True)


def test_what_a_solver_may_do_is_said_of_k_at_the_size_of_the_answer(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    # At twice the size a pixel is half as large.
    known = Quality(covariance=Covariance.from_matrix(("fx", "fy"), [[0.16, 0.16], [0.16, 0.16]]))
    put(fleet, an_entry(focal_mm=None, quality=known))
    camera = ("resolve", "--make", "DJI", "--model", "FC6310R", "--image-size")
    uses = [printed(capsys, "resolution-1", *camera, size)["use"] for size in ("5472x3648", "10944x7296")]
    assert uses == ["fixed", "start"]


def test_an_image_is_one_by_its_content_and_not_by_its_name(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, an_entry(focal_mm=None))
    picture(tmp_path / "a.jpg", **TAGS).rename(tmp_path / "DJI_0001.original")
    assert printed(capsys, "resolution-1", "resolve", tmp_path / "DJI_0001.original")["entry"]["id"] == P4R
    xml(tmp_path / "lens.xml").rename(tmp_path / "lens.jpg")
    code, _, err = run(capsys, "resolve", tmp_path / "lens.jpg")
    assert code == 3
    assert "is not an image; 'calibrary registry add FILE' takes a calibration file" in " ".join(err.split())


def test_the_same_entry_answers_that_extract_would_take(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(
        fleet,
        an_entry(focal_mm=None),
        an_entry(focal_mm=None, fx=3600.0, distortion=None, firmware=FirmwareRange(min="01.09")),
    )
    image = picture(tmp_path / "a.jpg", **TAGS, software="01.10")
    answer = printed(capsys, "resolution-1", "resolve", image)
    taken = Knowledge.load(fleet).of(read_metadata(image)).resolution
    assert taken is not None
    assert answer["entry"]["path"] == taken.path
    assert answer["calibration"]["intrinsics"]["fx"] == taken.calibration.intrinsics.fx == 3600.0


def test_a_smaller_image_gets_k_scaled_and_a_shorter_one_cropped(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, an_entry())
    half = printed(capsys, "resolution-1", "resolve", "dji/fc6310r", "--image-size", "2736x1824")
    assert half["calibration"]["provenance"]["adaptation"] == "scaled 5472×3648 → 2736×1824"
    answer = printed(capsys, "resolution-1", "resolve", "dji/fc6310r", "--image-size", "5472x3078")
    assert answer["calibration"]["intrinsics"]["cy"] == 1824 + 7.25 - (3648 - 3078) / 2
    assert answer["calibration"]["provenance"]["adaptation"] == "cropped 5472×3648 → 5472×3078"
    assert answer["calibration"]["provenance"]["assumptions"] == ["the crop is centred"]


def test_flags_alone_say_which_camera(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    put(fleet, an_entry())
    code, out, _ = run(capsys, "resolve", "--make", "dji", "--model", "FC6310R")
    assert (code, "fx 3661.2500" in out) == (0, True)


def test_a_serial_number_finds_the_entry_of_that_unit(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, an_entry(), an_entry(fx=3655.5, serial=hash_serial("DJI", "0V2LG3H0")))
    answer = printed(
        capsys, "resolution-1", "resolve", "--make", "DJI", "--model", "FC6310R", "--serial", "0V2LG3H0"
    )
    assert answer["calibration"]["intrinsics"]["fx"] == 3655.5
    assert answer["why"].endswith("1 more match and are less specific")
    assert [item["path"] for item in answer["near"]] == [an_entry().path]


@pytest.mark.usefixtures("fleet")
def test_a_unit_is_found_however_its_make_was_typed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    unit = ("--model", "FC6310R", "--serial", "0V2LG3H0")
    approved = ("--approve", "--reason", "measured")
    add(xml(tmp_path / "a.xml", 3655.5), *approved, camera=("--make", "dji", *unit))
    for typed in ("DJI", "dji"):
        answer = printed(capsys, "resolution-1", "resolve", "--make", typed, *unit)
        assert answer["calibration"]["intrinsics"]["fx"] == 3655.5
        assert answer["camera"]["serial"] == hash_serial("DJI", "0V2LG3H0")


def test_none_is_exit_code_4_with_what_is_near_and_why_not(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, an_entry(status=Status.DRAFT))
    code, out, err = run(capsys, "resolve", "--make", "DJI", "--model", "FC6310R")
    assert (code, out) == (4, "")
    assert f"near: {an_entry().path}: dji/fc6310r/5472x3648+f8.8 is proposed" in err
    assert "registry approve" in err
    code, out, _ = run(capsys, "resolve", "--make", "DJI", "--model", "FC6310R", "--json")
    document = json.loads(out)
    require(document, "resolution-1")
    assert (code, document["entry"], document["calibration"]) == (4, None, None)


def test_two_that_fit_alike_are_named(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first, other = an_entry(focal_mm=None), an_entry(focal_mm=None, size=(4864, 3648))
    put(fleet, first, other)
    code, _, err = run(capsys, "resolve", "dji/fc6310r")
    assert code == 4
    assert first.path in err
    assert other.path in err


def test_another_name_of_a_camera_finds_it(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    put(fleet, an_entry(aliases=(Alias(make="Other Maker", model="P4 RTK"),)))
    for _ in range(2):  # the second time from what the first has left in the cache
        answer = printed(capsys, "resolution-1", "resolve", "Other Maker/P4 RTK")
        assert answer["entry"]["id"] == an_entry().id
        answer = printed(capsys, "resolution-1", "resolve", "--make", "other maker", "--model", "P4 RTK")
        assert "of which this is an alias" in answer["why"]


def test_the_day_it_is_for_and_the_state_of_the_registry_are_two_things(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = put(fleet, an_entry(fx=3600.0, distortion=None))
    put(fleet, an_entry(fx=3700.0, validity=Validity(first=date(2026, 5, 1))))
    by_day = ["resolve", "dji/fc6310r", "--on", "2026-04-30"]
    earlier = printed(capsys, "resolution-1", *by_day)
    assert (earlier["calibration"]["intrinsics"]["fx"], earlier["commit"] != first) == (3600.0, True)
    assert "by what was approved for the days until 2026-04-30" in earlier["why"]
    answer = printed(capsys, "resolution-1", *by_day, "--at", first)
    assert (answer["calibration"]["intrinsics"]["fx"], answer["commit"]) == (3600.0, first)
    assert printed(capsys, "resolution-1", "resolve", P4R, "--on", "2026-05-01")["on"] == "2026-05-01"


SPRING, AUTUMN = Validity(first=date(2026, 3, 1), last=date(2026, 8, 31)), Validity(first=date(2026, 9, 1))


def enter_a_year(fleet: Path) -> None:
    for fx, validity in ((3640.0, None), (3650.0, SPRING), (3660.0, AUTUMN)):
        put(fleet, an_entry(focal_mm=None, fx=fx, validity=validity))


class TestTheDayOfTheImage:
    @pytest.fixture
    def periods(self, fleet: Path, filled: Filled) -> Path:
        """One unit over a year: of unknown days, of the spring, of the autumn."""
        return filled(fleet, enter_a_year)

    @pytest.mark.parametrize(
        ("taken", "fx"), [("2025:07:01", 3640.0), ("2026:05:05", 3650.0), ("2026:10:10", 3660.0)]
    )
    def test_resolve_extract_and_audit_give_the_k_of_that_day(
        self, periods: Path, tmp_path: Path, taken: str, fx: float, capsys: pytest.CaptureFixture[str]
    ) -> None:
        image = picture(tmp_path / "flight/a.jpg", **TAGS, date_time=f"{taken} 12:00:00")
        answer = printed(capsys, "resolution-1", "resolve", image)
        assert answer["calibration"]["intrinsics"]["fx"] == fx
        assert answer["on"] == taken.replace(":", "-")
        [camera] = gate(tmp_path / "flight", registry=periods).judged
        [state] = camera.camera.states
        assert state.known.calibration is not None
        assert state.known.calibration.intrinsics.fx == fx
        findings = printed(capsys, "registry-audit-1", "audit", tmp_path / "flight")["findings"]
        assert "expired" not in {finding["rule"] for finding in findings}

    def test_flights_of_two_periods_in_one_folder_are_told_apart(self, periods: Path, tmp_path: Path) -> None:
        for name, taken in (("a", "2026:05:05"), ("b", "2026:05:06"), ("c", "2026:10:10")):
            picture(tmp_path / f"flight/{name}.jpg", **TAGS, date_time=f"{taken} 12:00:00")
        [camera] = gate(tmp_path / "flight", registry=periods).judged
        found = {
            state.names: state.known.calibration.intrinsics.fx
            for state in camera.camera.states
            if state.known.calibration is not None
        }
        assert found == {("a.jpg", "b.jpg"): 3650.0, ("c.jpg",): 3660.0}

    def test_a_flight_over_two_periods_is_not_of_two_units(self, fleet: Path, tmp_path: Path) -> None:
        for fx, validity in ((3600.0, SPRING), (3670.0, AUTUMN)):
            put(fleet, an_entry(focal_mm=None, fx=fx, validity=validity))
        for name, taken in (("a", "2026:08:31"), ("b", "2026:09:01")):
            tags = {**TAGS, "focal_mm": (88, 10), "date_time": f"{taken} 12:00:00"}
            picture(tmp_path / f"flight/{name}.jpg", **tags)
        [camera] = gate(tmp_path / "flight", registry=fleet).judged
        report = camera.camera.report
        assert report is not None
        failed = [one.rule for one in report.findings if one.severity is Severity.ERROR]
        assert "one-k-per-camera" not in failed

    def test_a_retired_entry_answers_for_no_day(
        self, periods: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        put(periods, an_entry(focal_mm=None, status=Status.RETIRED, validity=AUTUMN))
        assert run(capsys, "resolve", P4R, "--on", "2026-05-05")[0] == 4


def test_what_is_proposed_is_mentioned_and_not_used(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, an_entry(focal_mm=None))
    add(xml(tmp_path / "new.xml", 3670.0))
    answer = printed(capsys, "resolution-1", "resolve", P4R)
    assert answer["calibration"]["intrinsics"]["fx"] == 3661.25
    assert answer["entry"]["proposal"] == f"{P4R}@proposed"
    assert "approved, proposal pending" in run(capsys, "list")[1]
    assert "another K waits for approval" in " ".join(run(capsys, "show", P4R)[1].split())


def test_a_bare_registry_and_a_plain_folder_answer_as_well(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, an_entry())
    git(tmp_path, "clone", "--quiet", "--bare", str(fleet), "bare.git")
    shutil.copytree(fleet / "cameras", tmp_path / "plain/cameras")
    for place in (tmp_path / "bare.git", f"folder:{tmp_path / 'plain'}"):
        answer = printed(capsys, "resolution-1", "resolve", "dji/fc6310r", "--registry", place)
        assert answer["calibration"]["intrinsics"]["fx"] == 3661.25
    assert answer["commit"] is None
    code, _, err = run(
        capsys, "resolve", "dji/fc6310r", "--registry", f"folder:{tmp_path / 'plain'}", "--at", "main"
    )
    assert (code, "no revisions" in err) == (4, True)


def test_what_is_committed_answers_and_not_what_lies_in_the_work_tree(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    entry = an_entry()
    put(fleet, entry)
    (fleet / entry.path).write_bytes(entry_yaml(an_entry(fx=9999.0)))
    assert printed(capsys, "resolution-1", "resolve", P4R)["calibration"]["intrinsics"]["fx"] == 3661.25


@pytest.mark.parametrize(
    ("arguments", "code", "expected"),
    [
        (["nobody/at-all"], 4, "no such camera"),
        (["missing.jpg"], 3, "no such file"),
        (["--make", "DJI"], 3, "state it with --model NAME"),
        (["dji/fc6310r", "--registry", "nowhere"], 4, "no such folder"),
    ],
)
def test_what_cannot_be_asked_is_one_line_with_its_exit_code(
    fleet: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], code: int, expected: str
) -> None:
    put(fleet, an_entry())
    got, _, said = run(capsys, "resolve", *arguments)
    assert got == code
    assert expected in said
    assert said.count("\n") == 1


@pytest.mark.usefixtures("fleet")
def test_asking_for_nothing_is_a_misuse(capsys: pytest.CaptureFixture[str]) -> None:
    code, _, said = run(capsys, "resolve")
    assert (code, "say which camera" in said) == (2, True)
