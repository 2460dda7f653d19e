"""``registry audit``: which images count, what the page and the report show, and what cannot be read."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from calibrary.cli.main import main
from calibrary.jobs.demo.flight import DemoImage
from tests.cli.registry.audits import TODAY, approved, audited, flight, phantom, rules
from tests.cli.registry.conftest import Filled
from tests.cli.registry.fleets import add, commit_of, run, xml
from tests.registry.git.repositories import git

__all__ = ["flight"]


def test_older_images_are_left_out_and_undated_ones_are_not(
    fleet: Path, flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    approved(fleet, xml(tmp_path / "a.xml"))
    phantom(flight / "old" / "b.jpg", (4000, 2000), date_time="2025:01:01 00:00:00")
    phantom(flight / "c.jpg", date_time=None)
    document = audited(capsys, flight, "--since", "2026-01-01")
    assert (document["images"], document["images_before"], document["images_undated"]) == (2, 1, 1)
    assert rules(document) == []
    assert document["cameras"][0]["last"] == "2026-03-05"


def test_folders_within_one_another_count_once(
    fleet: Path, flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    approved(fleet, xml(tmp_path / "a.xml"))
    phantom(tmp_path / "second" / "b.jpg")
    document = audited(capsys, flight, tmp_path / "second", flight.parent / "flight")
    assert (document["images"], document["cameras"][0]["images"]) == (2, 2)


def test_nothing_private_is_repeated_and_nothing_is_written(
    fleet: Path, demo_flight: tuple[Path, list[DemoImage]], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, images = demo_flight
    private = {text for image in images for text in image.private}
    before = commit_of(fleet), git(fleet, "status", "--porcelain")
    page = tmp_path / "audit.html"
    code, out, err = run(capsys, "audit", folder, "--html", page)
    _, document, _ = run(capsys, "audit", folder, "--json")
    assert code == 1
    printed = out + err + document + page.read_text()
    assert not [text for text in private if text in printed]
    assert before == (commit_of(fleet), git(fleet, "status", "--porcelain"))


@pytest.mark.usefixtures("fleet")
def test_the_page_shows_what_to_do_and_how_far_images_lie(
    fleet: Path, flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    approved(fleet, xml(tmp_path / "a.xml", 3800.0))
    run(capsys, "audit", flight, "--html", tmp_path / "a.html")
    page = (tmp_path / "a.html").read_text()
    assert "what to do" in page
    assert "K drifted" in page
    assert "<svg" in page


@pytest.mark.usefixtures("fleet")
def test_a_folder_without_images_and_a_missing_registry_have_their_codes(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "empty").mkdir()
    assert run(capsys, "audit", tmp_path / "empty")[0] == 3
    assert run(capsys, "audit", tmp_path / "missing")[0] == 3
    assert run(capsys, "audit", flight, "--registry", tmp_path / "nowhere")[0] == 4
    for flags in (["--since", "spring"], ["--stale-after-months", "0"]):
        with pytest.raises(SystemExit) as ended:
            main(["registry", "audit", str(flight), *flags])
        assert ended.value.code == 2
    capsys.readouterr()


def test_an_entry_that_cannot_be_read_is_told_and_stops_nothing(
    fleet: Path, flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    approved(fleet, xml(tmp_path / "a.xml"))
    broken = fleet / "cameras" / "example" / "one" / "4000x3000.yaml"
    broken.parent.mkdir(parents=True)
    broken.write_text("schema: [")
    git(fleet, "add", ".")
    git(fleet, "commit", "-qm", "broken")
    document = audited(capsys, flight)
    assert "example/one/4000x3000" in str(document["not_compared"])
    assert document["cameras"][0]["use"] == "used"


def enter_two(fleet: Path) -> None:
    own = phantom(fleet.parent / "1.jpg", body_serial="SERIAL1")
    for number, calibration in ((1, own), (3, xml(fleet.parent / "3.xml", 3800.0))):
        serial = ("--serial", f"SERIAL{number}", "--label", f"P4R-0{number}")
        add(calibration, "--approve", "--date", TODAY, *serial, "--force", "--reason", "as measured")


@pytest.fixture
def season(fleet: Path, tmp_path: Path, filled: Filled) -> Path:
    """Three units of one model on two flights: one with its entry, one without, one whose images contradict it."""
    filled(fleet, enter_two)
    flown = tmp_path / "flown"
    for number in (1, 2, 3):
        image = flown / "2026-03-05 north/DCIM/100MEDIA" / f"{number}.jpg"
        phantom(image, body_serial=f"SERIAL{number}")
    phantom(flown / "2026-03-09 south" / "1.jpg", body_serial="SERIAL1", date_time="2026:03:09 08:00:00")
    return flown


def test_an_audit_tells_each_unit_once_with_its_finding_and_what_to_do(
    season: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = audited(capsys, season)
    units = document["units"]
    assert [(one["label"], one["level"]) for one in units] == [
        (None, "error"),
        ("P4R-03", "error"),
        ("P4R-01", None),
    ]
    assert [one["findings"][0]["rule"] for one in units[:2]] == ["no entry", "K drifted"]
    assert units[0]["next"] == f"calibrary onboard '{season}/2026-03-05 north/DCIM/100MEDIA'"
    assert sum(one["images"] for one in units) == document["images"] == 4
    assert [leg["flight"] for leg in units[2]["flights"]] == ["2026-03-05 north", "2026-03-09 south"]
    code, out, _ = run(capsys, "audit", season, "--html", tmp_path / "a.html")
    assert code == 1
    assert out.splitlines()[1].startswith(units[0]["name"])
    assert [out.count(one["name"]) for one in units] == [1, 1, 1]
    assert [out.count(one["findings"][0]["message"][:30]) for one in units[:2]] == [1, 1]
    assert f"→ {units[0]['next']}" in " ".join(out.split())
    assert f"{units[2]['name']} clean 2 2026-03-05 north and 1 more {units[2]['entries'][0]}" in " ".join(
        out.split()
    )
    page = re.sub('<span class="whole">(.*?)</span>', r"\1", (tmp_path / "a.html").read_text())
    flights, section = page.index(">Flights</bdi></h2>"), page.index('id="unit-2"')
    assert page.index('<a href="#unit-2"><bdi>P4R-03, DJI FC6310R') < section < flights
    # Each thing to do is in the overview once, and once at its unit.
    assert page.count(units[0]["next"].replace("'", "&#39;")) == 2


def test_an_audit_goes_by_flight_with_those_that_need_attention_first(
    season: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    north, south = audited(capsys, season)["flights"]
    assert (north["name"], north["images"], north["level"]) == ("2026-03-05 north", 3, "error")
    assert (south["name"], south["first"], south["level"]) == ("2026-03-09 south", "2026-03-09", None)
    assert (len(north["units"]), len(north["without"])) == (3, 1)
    assert south["units"][0].startswith("P4R-01, DJI FC6310R, unit ")


def test_a_finding_names_the_unit_as_its_keeper_does(
    season: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    [drift] = [one for one in audited(capsys, season)["findings"] if one["rule"] == "K drifted"]
    assert drift["camera"].startswith("P4R-03, DJI FC6310R")
