"""Review in a real browser: what was looked at is what is written, by the person whose desk it is, or nothing is."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest

import calibrary
from calibrary.records import replace
from calibrary.registry.entry import Status
from tests.jobs.desk.conftest import Tab
from tests.jobs.site.fleet import SETTLED, later
from tests.pages.test_in_chromium import PHONE, faults
from tests.pages.test_in_chromium import pytestmark as only_where_a_browser_is

pytestmark = only_where_a_browser_is
Open = Callable[..., Tab]
CAMERA = "dji/fc6310r/5472x3648+f8.8"
USED, PROPOSED = 3665.60, 3667.60


@pytest.fixture(autouse=True)
def proposed(fleet: Path) -> None:
    propose(fleet, 2.0)


def propose(fleet: Path, fx: float) -> None:
    entry = later(SETTLED, fx=fx, firmware="01.10", date="2026-10-01")
    calibrary.open_registry(fleet).propose_entries(replace(entry, status=Status.DRAFT)).write()


def fx(fleet: Path) -> float:
    found = calibrary.open_registry(fleet).resolve(CAMERA).calibration
    assert found is not None
    return round(found.intrinsics.fx, 2)


def git(fleet: Path, *words: str) -> str:
    done = subprocess.run(["git", "-C", str(fleet), *words], capture_output=True, text=True, check=True)
    return done.stdout.strip()


def opened(tab: Open) -> Tab:
    """The page of the proposal, by the way that a person takes."""
    one = tab()
    one.page.get_by_role("link", name="Review").click()
    one.page.get_by_role("link", name=f"{CAMERA}@proposed").click()
    return one


def decide(one: Tab, button: str, label: str, reason: str) -> str:
    one.page.get_by_label(label).fill(reason)
    one.page.get_by_role("button", name=button, exact=True).click()
    one.page.wait_for_url("**after=*")
    return one.page.locator("main").inner_text()


@pytest.mark.walk
def test_a_proposal_is_approved_beside_what_it_replaces(tab: Open, fleet: Path) -> None:
    one = opened(tab)
    shown = one.page.locator("main").inner_text()
    assert f"{USED:.2f}" in shown
    assert f"{PROPOSED:.2f}" in shown
    assert one.page.locator("svg.plot").count() >= 1
    said = decide(one, "Approve", "Why, for", "measured again")
    assert "Approve dji/fc6310r/5472x3648+f8.8: done" in said
    assert "Nothing waits." in said
    assert fx(fleet) == PROPOSED
    assert git(fleet, "log", "-1", "--format=%an <%ae> %B").startswith("Ada Keeper <ada@example.com> Approve")
    assert "measured again" in git(fleet, "log", "-1", "--format=%B")
    assert one.complaints == []


def test_a_change_that_matters_takes_a_reason(tab: Open, fleet: Path) -> None:
    one = opened(tab)
    field = one.page.get_by_label("Why, for")
    assert field.get_attribute("required") is not None
    field.evaluate("field => { field.required = false }")  # as a browser would that knows no such forms
    said = decide(one, "Approve", "Why, for", "")
    assert "not done" in said
    assert "write a reason, then decide again" in said
    assert fx(fleet) == USED


def test_what_was_not_looked_at_is_not_approved(tab: Open, fleet: Path) -> None:
    one = opened(tab)
    propose(fleet, 9.0)
    said = decide(one, "Approve", "Why, for", "measured again")
    assert "nothing was written" in said
    assert "3674.60" in said, "what is proposed now is shown"
    assert fx(fleet) == USED
    assert "done. " in decide(one, "Approve", "Why, for", "looked at it again")
    assert fx(fleet) == 3674.60


def test_of_two_browsers_one_decides_and_the_other_is_told(tab: Open, fleet: Path) -> None:
    one, other = opened(tab), opened(tab)
    decide(one, "Approve", "Why, for", "measured again")
    other.page.get_by_label("Why not").fill("no")
    other.page.get_by_role("button", name="Reject").click()
    other.page.get_by_text("Not done").wait_for()
    assert fx(fleet) == PROPOSED


def test_a_rejected_proposal_stays_in_the_history(tab: Open, fleet: Path) -> None:
    said = decide(opened(tab), "Reject", "Why not", "-- the board was bent")
    assert "Nothing waits." in said
    assert fx(fleet) == USED
    assert "the board was bent" in git(fleet, "log", "-1", "--format=%B")


def test_an_entry_is_retired_with_a_reason(tab: Open, fleet: Path) -> None:
    one = tab()
    one.page.goto(f"{one.home}/cameras/{CAMERA}.html")
    assert "done. " in decide(one, "Retire", "Why retire", "crashed")
    assert calibrary.open_registry(fleet).show(CAMERA).status is Status.RETIRED


def test_an_entry_that_changed_since_is_not_retired(tab: Open, fleet: Path) -> None:
    one = tab()
    one.page.goto(f"{one.home}/cameras/{CAMERA}.html")
    calibrary.open_registry(fleet).propose_edit([CAMERA], ["+spare"]).write()
    assert "nothing was written: what is there now has the digest" in decide(
        one, "Retire", "Why retire", "crashed"
    )
    assert calibrary.open_registry(fleet).show(CAMERA).status is Status.APPROVED


def test_commits_are_exchanged_by_a_button_and_told_in_words(tab: Open, fleet: Path, tmp_path: Path) -> None:
    one = tab()
    one.page.goto(f"{one.home}/review")
    one.page.get_by_role("button", name="Exchange").click()
    one.page.get_by_text("no remote 'origin'").first.wait_for()
    git(fleet, "init", "--quiet", "--bare", str(tmp_path / "hub.git"))
    git(fleet, "remote", "add", "origin", str(tmp_path / "hub.git"))
    git(fleet, "push", "--quiet", "origin", "HEAD:main")
    propose(fleet, 3.0)
    one.page.get_by_role("button", name="Exchange").click()
    one.page.get_by_text("The exchange with the remote: done").wait_for()
    assert git(tmp_path / "hub.git", "rev-parse", "main") == git(fleet, "rev-parse", "main")


@pytest.mark.skipif(shutil.which("ssh-keygen") is None, reason="ssh-keygen is not installed")
def test_a_locked_key_asks_nobody_and_says_what_to_do(
    tab: Open, fleet: Path, tmp_path: Path, nobodys_git: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("SSH_AUTH_SOCK", raising=False)
    key = tmp_path / "key"
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "secret", "-f", str(key)], check=True)
    settings = ("user.signingkey", f"{key}.pub"), ("gpg.format", "ssh"), ("commit.gpgsign", "true")
    for name, value in settings:
        subprocess.run(["git", "config", "--file", str(nobodys_git), name, value], check=True)
    one = opened(tab)
    said = decide(one, "Approve", "Why, for", "measured again")
    assert "unlock the key in a terminal (ssh-add)" in said
    assert fx(fleet) == USED
    subprocess.run(["ssh-keygen", "-q", "-p", "-P", "secret", "-N", "", "-f", str(key)], check=True)
    assert "done. " in decide(one, "Approve", "Why, for", "measured again")
    assert "BEGIN SSH SIGNATURE" in git(fleet, "cat-file", "commit", "HEAD")


@pytest.mark.parametrize("page", ["/review", f"/review/one?key={CAMERA.replace('+', '%2B')}@proposed"])
def test_pages_are_quiet_small_and_readable(tab: Open, page: str) -> None:
    one = tab()
    answer = one.page.goto(one.home + page)
    assert answer is not None
    assert len(answer.body()) < 300_000
    assert one.complaints == []
    assert faults(one.page) == []
    one.page.set_viewport_size({"width": PHONE[0], "height": PHONE[1]})
    assert one.page.evaluate("document.documentElement.scrollWidth") == PHONE[0]
    sentences = (
        "[...document.querySelectorAll('.prose')].filter(c => c.getBoundingClientRect().right > innerWidth)"
    )
    assert one.page.evaluate(f"{sentences}.length") == 0


def test_no_program_gets_what_is_only_proposed(tab: Open) -> None:
    assert "feature_extractor" not in opened(tab).page.locator("main").inner_text()


def test_no_program_gets_what_is_not_in_use(tab: Open, fleet: Path) -> None:
    calibrary.open_registry(fleet).propose_retirement([CAMERA], "sold").write()
    one = tab()
    one.page.goto(f"{one.home}/cameras/{CAMERA}.html")
    said = one.page.locator("main").inner_text()
    assert "no program gets it from the registry" in said
    assert "feature_extractor" not in said
