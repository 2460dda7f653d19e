"""``registry status``: what waits, for whom, and since when."""

from __future__ import annotations

import shutil
from datetime import date, timedelta
from pathlib import Path
from typing import Any

import pytest

import calibrary
from calibrary.calibration import Grade
from calibrary.cli.main import main
from calibrary.errors import RegistryError, UsageError
from calibrary.jobs.audit.age import age_finding, due_again
from calibrary.jobs.status.run import Kind
from calibrary.records import replace
from calibrary.registry.configuration import Repeat
from calibrary.registry.entry import Status, Validity
from calibrary.registry.entry_yaml import entry_yaml
from tests.cli.registry.direct import put, put_bytes
from tests.cli.registry.fleets import P4R, add, looked_at, printed, run, xml
from tests.cli.registry.test_registry_approvals import TWO, asks, by
from tests.jobs.extract.fleet import picture
from tests.registry.approval.attacked import keys_in, rules_yaml
from tests.registry.entries import FILE, an_entry
from tests.registry.git.repositories import git
from tests.registry.published.publications import published

TODAY = date.today()


def queue(capsys: pytest.CaptureFixture[str], *arguments: str | Path) -> list[Any]:
    """The matters that are printed, each as kind, KEY and whether it is the asker's."""
    document = printed(capsys, "registry-status-1", "status", *arguments)
    return [(one["kind"], one["what"], one["yours"]) for one in document["matters"]]


def test_nothing_waits_in_a_registry_that_is_in_order(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, an_entry())
    code, out, _ = run(capsys, "status")
    assert (code, out) == (0, "nothing waits for Ada Keeper; 1 entry\n")


def test_a_proposal_waits_for_those_who_have_not_approved_it(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert asks(fleet, TWO, capsys)[0] == 0
    add(xml(tmp_path / "a.xml"))
    key = f"{P4R}@proposed"
    by(monkeypatch, "Bob")
    assert queue(capsys) == [("proposal", key, True)]
    code, out, _ = run(capsys, "status")
    assert code == 1
    assert f"proposal {key} you today" in " ".join(out.split())
    assert "proposed by Ada Keeper: 0 of 2 approvals" in " ".join(out.split())
    assert f"→ calibrary registry approve {P4R}" in " ".join(out.split())
    run(capsys, "approve", *looked_at(fleet, P4R))
    assert queue(capsys) == [("proposal", key, False)]
    [matter] = printed(capsys, "registry-status-1", "status")["matters"]
    assert "1 of 2 approvals" in matter["text"]
    assert matter["waits_for"] == ["Ada Keeper", "Cy"]
    by(monkeypatch, "Cy")
    run(capsys, "approve", *looked_at(fleet, P4R))
    assert queue(capsys) == []


def test_many_proposals_for_the_same_people_are_one(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drafts = [an_entry(model=f"M{number}", status=Status.DRAFT) for number in range(6)]
    put_bytes(fleet, {one.path: entry_yaml(one) for one in drafts})
    assert len(queue(capsys)) == 6
    _, out, _ = run(capsys, "status")
    assert out.splitlines()[1].split() == ["proposal", "6", "×", "you", "today"]
    assert "dji/m2/5472x3648+f8.8@proposed and 3 more" in " ".join(out.split())
    assert out.splitlines()[-1].startswith("6 for Ada Keeper")


def test_proposals_on_other_branches_are_seen_and_those_that_contradict_k_in_use_told(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, an_entry(focal_mm=None))
    git(fleet, "switch", "--quiet", "-c", "payload")
    add(xml(tmp_path / "a.xml", f=3690.0))
    git(fleet, "switch", "--quiet", "-")
    found = printed(capsys, "registry-status-1", "status")["matters"]
    assert [one["kind"] for one in found] == ["proposal", "proposal contradicts K in use"]
    assert found[0]["next"] == f"calibrary registry approve {P4R} --from payload"


def test_a_branch_is_approved_with_all_that_it_proposes(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    git(fleet, "switch", "--quiet", "-c", "payload")
    add(xml(tmp_path / "a.xml"))
    add(xml(tmp_path / "b.xml"), camera=("--make", "DJI", "--model", "FC9990"))
    git(fleet, "switch", "--quiet", "-")
    with pytest.raises(SystemExit, match="2"):
        run(capsys, "approve", "--from", "payload")
    err = capsys.readouterr().err
    assert "approve dji/fc6310r/5472x3648 dji/fc9990/5472x3648 --from payload --digest" in err
    told = err[err.index("approve dji") :].partition(";")[0].split()
    assert run(capsys, *told)[0] == 0
    assert queue(capsys) == []
    git(fleet, "branch", "idle")
    with pytest.raises(RegistryError, match="idle proposes nothing"):
        calibrary.open_registry(str(fleet)).propose_approval(source="idle")
    with pytest.raises(UsageError, match="KEY, or --from BRANCH"):
        calibrary.open_registry(str(fleet)).propose_approval()


def test_a_statement_without_effect_comes_first(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    put(fleet, an_entry(validity=Validity(last=TODAY)))
    false = fleet / "events/dji/fc6310r" / ("0" * 32)
    false.parent.mkdir(parents=True, exist_ok=True)
    false.write_text("{}\n")
    git(fleet, "add", "--all")
    git(fleet, "commit", "--quiet", "-m", "Damage")
    assert [kind for kind, _, _ in queue(capsys)] == ["statement without effect", "validity ends"]


def test_what_ends_soon_is_told(fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
    soon, later = TODAY + timedelta(days=20), TODAY + timedelta(days=40)
    put(
        fleet,
        an_entry(model="SOON", validity=Validity(last=soon)),
        an_entry(model="LATER", validity=Validity(last=later)),
    )
    assert [what.partition("/5")[0] for _, what, _ in queue(capsys)] == ["dji/soon"]
    [_, (_, what, _)] = queue(capsys, "--within-days", "60")
    assert what.partition("/5")[0] == "dji/later"


def test_what_is_old_by_its_firmware_is_to_be_made_again_today_whenever_its_age_would_say_so(
    fleet: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    said = replace(FILE, date=f"{TODAY}", firmware="01.01")
    put(fleet, an_entry(provenance=said))
    file = fleet / "registry.yaml"
    file.write_text(f'{file.read_text()}repeat: [{{of: "dji", months: 1, firmware: "01.02"}}]\n')
    git(fleet, "commit", "-qam", "rules")
    [matter] = printed(capsys, "registry-status-1", "status", "--within-days", "60")["matters"]
    assert "under firmware 01.01, expected 01.02" in matter["text"]
    assert (matter["yours"], matter.get("due")) == (True, None)


def test_a_published_copy_that_is_behind_or_gone_is_told(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, an_entry())
    published(fleet, tmp_path / "out")
    where = ("--published", tmp_path / "out")
    assert queue(capsys, *where) == []
    put(fleet, an_entry(model="NEW"))
    [matter] = printed(capsys, "registry-status-1", "status", *where)["matters"]
    assert (matter["kind"], "behind in commits" in matter["text"]) == (
        "published copy",
        True,
    )
    [matter] = printed(capsys, "registry-status-1", "status", "--published", tmp_path / "none")["matters"]
    assert "no published registry here" in matter["text"]


@pytest.mark.usefixtures("fleet")
def test_flights_add_what_an_audit_finds_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture(tmp_path / "flight/a.jpg", make="DJI", model="FC6310R")
    [matter] = printed(capsys, "registry-status-1", "status", tmp_path / "flight")["matters"]
    assert (matter["kind"], matter["text"].partition(":")[0]) == ("flights", "no entry")


def test_an_old_calibration_is_told_once_with_flights_too(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, an_entry(provenance=replace(FILE, date="2020-05-02")))
    picture(tmp_path / "flight/a.jpg", make="DJI", model="FC6310R")
    found = printed(capsys, "registry-status-1", "status", tmp_path / "flight")["matters"]
    assert [one["kind"] for one in found if "2020-05-02" in one["text"]] == ["calibrate again"]


@pytest.mark.parametrize("months", [1, 12, 24])
@pytest.mark.parametrize("made", ["2024-01-31", "2024-02-29", "2025-12-01", "2023-11-30"])
def test_the_day_from_which_a_calibration_is_old_is_the_first_on_which_it_is_called_so(
    made: str, months: int
) -> None:
    entry = an_entry()
    calibration = entry.calibration
    measured = replace(
        calibration, grade=Grade.CALIBRATED, provenance=replace(calibration.provenance, date=made)
    )
    entry = replace(entry, calibration=measured)
    due = due_again(entry, months)
    assert due is not None
    rule = Repeat(of="dji", months=months)
    assert age_finding(entry, due, rule, has_flown=True) is not None
    assert age_finding(entry, due - timedelta(days=1), rule, has_flown=True) is None


def test_python_has_the_same_answer(fleet: Path) -> None:
    put(fleet, an_entry(validity=Validity(last=TODAY)))
    [matter] = calibrary.open_registry(fleet).status().matters
    assert (matter.kind, matter.due) == (Kind.ENDS, TODAY)


def ruled(fleet: Path, keys: Path) -> list[str]:
    """Ask for the approval of another of three people with keys, in registry.yaml; the command that approves that."""
    keys_in(keys)
    file = fleet / "registry.yaml"
    file.write_text(f"{file.read_text().rstrip()}\n{rules_yaml(keys, 'approvals: {by: [ada, cy]}')}\n")
    git(fleet, "commit", "-qam", "rules")
    return ["approve", "registry.yaml", "--digest", git(fleet, "rev-parse", "HEAD:registry.yaml")]


@pytest.mark.skipif(shutil.which("ssh-keygen") is None, reason="ssh-keygen is not installed")
def test_a_proposal_of_a_branch_comes_with_who_proposed_it_and_people_go_by_their_keys(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Git names one person throughout, as on a machine that several share; the keys are two."""
    assert run(capsys, *ruled(fleet, tmp_path))[0] == 0
    git(fleet, "switch", "--quiet", "-c", "payload")
    git(fleet, "config", "user.signingkey", str(tmp_path / "bob"))
    add(xml(tmp_path / "a.xml"))
    git(fleet, "switch", "--quiet", "-")
    [waiting] = printed(capsys, "registry-status-1", "status")["matters"]
    assert (waiting["yours"], waiting["waits_for"]) == (False, ["ada", "cy"])
    proposed = git(fleet, "rev-parse", f"payload:cameras/{P4R}.yaml")
    assert (
        "not among those who approve" in run(capsys, "approve", "--from", "payload", "--digest", proposed)[2]
    )
    git(fleet, "config", "user.signingkey", str(tmp_path / "ada"))
    assert [yours for _, _, yours in queue(capsys)] == [True]
    assert run(capsys, "approve", "--from", "payload", "--digest", proposed)[0] == 0
    assert queue(capsys) == []
    assert calibrary.open_registry(str(fleet)).show(P4R).status == "approved"


@pytest.mark.skipif(shutil.which("ssh-keygen") is None, reason="ssh-keygen is not installed")
def test_a_registry_made_anew_in_the_place_of_another_is_not_measured_by_it(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, an_entry())
    assert run(capsys, "resolve", P4R)[0] == 0
    shutil.rmtree(fleet)
    assert main(["registry", "init", str(fleet)]) == 0
    # The very first question is one about the statements.
    assert run(capsys, *ruled(fleet, tmp_path))[0] == 0
