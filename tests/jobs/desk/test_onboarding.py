"""Onboarding in a real browser: each source beside the others, and a draft only once a person confirms it."""

from __future__ import annotations

import hashlib
import json
import subprocess
from collections.abc import Callable
from datetime import datetime, timedelta, tzinfo
from pathlib import Path
from types import SimpleNamespace
from typing import Self, cast

import pytest

import calibrary
from calibrary.cli.main import main
from calibrary.jobs.desk.onboarding import command, proposing
from calibrary.jobs.desk.work import Job
from tests.calib.photographs import saved
from tests.jobs.desk.conftest import Tab
from tests.jobs.onboard.payloads import survey
from tests.pages.test_in_chromium import PHONE, faults
from tests.pages.test_in_chromium import pytestmark as only_where_a_browser_is

pytestmark = only_where_a_browser_is
Open = Callable[..., Tab]
BRANCH = "onboard/example-survey_one"


@pytest.fixture
def payload(tmp_path: Path) -> Path:
    return survey(tmp_path / "payload")


def look(one: Tab, payload: Path, serves: str = "this unit only") -> str:
    one.page.goto(f"{one.home}/onboard")
    form = one.page.locator("form[action='/onboard']")
    form.get_by_label("Or their folder").fill(str(payload))
    form.get_by_label("A measured K is valid for").select_option(label=serves)
    form.locator("button").click()
    return over(one)


def over(one: Tab) -> str:
    one.page.get_by_role("link", name="Onboard another payload").wait_for(timeout=90_000)
    return one.page.locator("body").inner_text()


def branches(fleet: Path) -> list[str]:
    words = ["git", "-C", str(fleet), "branch", "--list", "onboard/*", "--format=%(refname:short)"]
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout.split()


def test_a_payload_is_looked_at_and_proposed_once_it_is_confirmed(
    tab: Open, fleet: Path, payload: Path
) -> None:
    one = tab()
    said = look(one, payload)
    assert "ready, not written" in said
    assert "1 camera: ready, not written" in said
    assert "papers/camera.xml" in said
    assert "EXIF FocalLengthIn35mmFilm" in said
    assert branches(fleet) == []
    one.page.get_by_label("Why, for the history").fill("came by mail")
    one.page.get_by_role("button", name="Propose it").click()
    one.page.get_by_text("not used until it is approved").wait_for(timeout=90_000)
    assert branches(fleet) == [BRANCH]
    drafted = calibrary.open_registry(fleet).registry.get(f"example/survey_one@{BRANCH}").entry
    assert drafted.calibration.intrinsics.fx == 968.0
    assert " '--reason=came by mail'" in one.page.locator("pre", has_text="calibrary onboard").inner_text()
    one.page.get_by_role("link", name="Review it").click()
    one.page.get_by_role("link", name=f"@{BRANCH}").click()
    one.page.get_by_label("Why, for").fill("looked at")
    one.page.get_by_role("button", name="Approve").click()
    one.page.get_by_text(": done").wait_for()
    used = calibrary.open_registry(fleet).resolve("example/survey_one").calibration
    assert used is not None
    assert used.intrinsics.fx == 968.0
    assert one.complaints == []


def test_what_changed_since_it_was_looked_at_is_shown_and_not_proposed(
    tab: Open, fleet: Path, payload: Path
) -> None:
    one = tab()
    look(one, payload)
    file = next(payload.rglob("camera.xml"))
    file.write_text(file.read_text().replace("968", "969"))
    one.page.get_by_role("button", name="Propose it").click()
    one.page.get_by_text("the files changed since they were looked at").wait_for(timeout=90_000)
    assert branches(fleet) == []
    one.page.get_by_role("button", name="Propose it").click()
    one.page.get_by_text("not used until it is approved").wait_for(timeout=90_000)
    assert branches(fleet) == [BRANCH]


@pytest.mark.thorough
def test_frames_without_a_day_keep_the_one_that_was_shown(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    named = ["--square-mm=25", "--make=Example", "--model=One", "--for=model"]
    frames = saved(tmp_path / "frames", 10)[0].parent
    words, title = command(fleet, tmp_path, {"place": str(frames)})
    assert main([*words, *named]) == 0
    shown = capsys.readouterr().out.encode()
    looked = SimpleNamespace(words=[*words, *named], folder=tmp_path, documents=[shown], title=title)
    confirmed = proposing(cast("Job", looked), tmp_path, {})

    class Tomorrow(datetime):
        @classmethod
        def now(cls, tz: tzinfo | None = None) -> Self:
            return super().now(tz) + timedelta(days=1)

    monkeypatch.setattr("calibrary.jobs.calibrate.run.datetime", Tomorrow)
    assert main(confirmed) == 0
    [drafted] = branches(fleet)
    [stored] = calibrary.open_registry(fleet, at=drafted).snapshot.proposals()
    assert (
        stored.entry.calibration.provenance.date
        == json.loads(shown)["cameras"][0]["entry"]["calibration"]["provenance"]["date"]
    )


def test_dropped_files_are_kept_whole_and_their_hashes_are_of_them(
    tab: Open, fleet: Path, payload: Path
) -> None:
    files = [path for path in payload.rglob("*") if path.is_file()]
    with files[0].open("ab") as file:
        file.write(bytes(9 << 20))
    one = tab()
    one.page.goto(f"{one.home}/onboard")
    form = one.page.locator("form[data-drops]")
    form.locator("input[type=file]").set_input_files(files)
    form.get_by_role("button", name="Look at these files").click()
    assert "only a person knows" in over(one) or "unit" in over(one)
    one.page.get_by_label("A measured K is valid for").select_option(label="this unit only")
    one.page.get_by_role("button", name="Look again").click()
    one.page.get_by_role("button", name="Propose it").click(timeout=90_000)
    one.page.get_by_text("not used until it is approved").wait_for(timeout=90_000)
    drafted = calibrary.open_registry(fleet).registry.get(f"example/survey_one@{BRANCH}").entry
    known = {hashlib.sha256(path.read_bytes()).hexdigest() for path in files}
    assert {source.sha256 for source in drafted.calibration.provenance.sources} <= known
    assert "dropped" in one.page.locator("pre", has_text="calibrary onboard").inner_text()
    assert "calibrary-desk-" not in one.page.content()


def test_a_folder_that_states_no_camera_says_what_is_missing_and_asks_again(
    tab: Open, fleet: Path, tmp_path: Path
) -> None:
    payload = survey(tmp_path / "payload")
    for image in payload.rglob("*.jpg"):
        image.unlink()
    one = tab()
    said = look(one, payload)
    assert "--make" in said
    one.page.get_by_label("Make, if").fill("Example")
    one.page.get_by_label("Model, if").fill("Survey One")
    one.page.get_by_role("button", name="Look again").click()
    one.page.get_by_role("heading", name="New payload: Example Survey One").wait_for(timeout=90_000)
    assert branches(fleet) == []


def test_pages_are_quiet_small_and_readable(tab: Open, payload: Path) -> None:
    one = tab()
    one.page.goto(f"{one.home}/onboard")
    assert faults(one.page) == []
    look(one, payload)
    assert len(one.page.content().encode()) < 300_000
    assert faults(one.page) == []
    one.page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
    assert one.page.evaluate("document.documentElement.scrollWidth") == PHONE[0]
    assert one.complaints == []
