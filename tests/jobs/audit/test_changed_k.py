"""The year's question, did anything change? An audit hears files among the images and proposals on any branch."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from calibrary.cli.main import main
from calibrary.jobs.fleet import open_registry
from calibrary.registry.registry import Registry
from tests.cli.registry.audits import OWN, TODAY, phantom
from tests.cli.registry.fleets import P4R, add, xml
from tests.imagery import write_jpeg
from tests.registry.git.repositories import git, seclude
from tests.thorough import every


@pytest.fixture(scope="module")
def furnished_desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A registry whose only entry is the K that the images of a flight state; to copy."""
    folder = tmp_path_factory.mktemp("furnished")
    with pytest.MonkeyPatch.context() as patch:
        sit_down(patch, folder)
        assert main(["registry", "init", "fleet"]) == 0
        add(xml(folder / "used.xml"), "--approve", "--date", TODAY)
    phantom(folder / "flight" / "a.jpg")
    return folder


@pytest.fixture
def desk(furnished_desk: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """One to work at."""
    shutil.copytree(furnished_desk, tmp_path / "desk")
    sit_down(monkeypatch, tmp_path / "desk")
    return tmp_path / "desk"


def sit_down(patch: pytest.MonkeyPatch, folder: Path) -> None:
    seclude(patch, folder)
    patch.chdir(folder)
    patch.setenv("CALIBRARY_REGISTRY", str(folder / "fleet"))


class Heard(NamedTuple):
    """What an audit says of the K in use: rules with severities, what was not compared, and its verdict."""

    findings: list[tuple[str, str]]
    not_compared: list[str]
    verdict: str
    code: int
    document: Any


def heard(capsys: pytest.CaptureFixture[str]) -> Heard:
    capsys.readouterr()
    code = main(["registry", "audit", "flight", "--json"])
    document = json.loads(capsys.readouterr().out)
    return Heard(
        [(one["rule"], one["severity"]) for one in document["findings"]],
        [one["what"] for one in document["not_compared"]],
        document["verdict"],
        code,
        document,
    )


def nothing(_: Path) -> None:
    """Only the images and the entry."""


def beside(f: float, name: str = "flight/camera.xml") -> Callable[[Path], None]:
    def lay_out(desk: Path) -> None:
        (desk / name).parent.mkdir(exist_ok=True)
        xml(desk / name, f)

    return lay_out


def of_another_model(desk: Path) -> None:
    camera = {"projection_type": "perspective", "width": 5472, "height": 3648}
    key = "v2 ricoh gr 5472 3648 perspective 0.7"
    (desk / "flight/cameras.json").write_text(
        json.dumps({key: camera | {"focal": 0.7, "k1": 0.0, "k2": 0.0}})
    )


def torn(desk: Path) -> None:
    (desk / "flight/camera.xml").write_text("<calibration><projection>frame")


def notes(desk: Path) -> None:
    (desk / "flight/notes.txt").write_text("windy\n")


def proposed(f: float, *flags: str) -> Callable[[Path], None]:
    return lambda desk: add(xml(desk / "other.xml", f), "--date", TODAY, *flags)


def on_a_branch(f: float, *flags: str) -> Callable[[Path], None]:
    return lambda desk: add(xml(desk / "other.xml", f), "--date", TODAY, "--branch", "lab", *flags)


def approved_since(desk: Path) -> None:
    """A branch that is behind, with the K that was used before."""
    git(desk / "fleet", "branch", "old")
    add(
        xml(desk / "used.xml", 3660.5),
        "--approve",
        "--date",
        TODAY,
        "--note",
        "seen",
        "--reason",
        "looked at",
    )


def of_the_unit(desk: Path) -> None:
    """A flight's draft for the unit that flew, while the entry in use is that of its model."""
    for path in (desk / "flight").iterdir():
        path.unlink()
    phantom(desk / "flight" / "a.jpg", body_serial="AB12")
    add(xml(desk / "other.xml", 3660.5 * 1.036), "--serial", "AB12", "--date", TODAY)


def of_a_camera_without_an_entry(desk: Path) -> None:
    phantom(desk / "flight" / "b.jpg", model="FC6310S")
    other = ("--make", "DJI", "--model", "FC6310S")
    add(xml(desk / "other.xml"), "--date", TODAY, "--branch", "lab", camera=other)


def images(f: float, **tags: Any) -> Callable[[Path], None]:
    """Images that state another K than their entry, of which the unit is not known."""

    def lay_out(desk: Path) -> None:
        phantom(desk / "flight" / "a.jpg", dewarp=OWN.replace("3660.5,3660.5", f"{f},{f}"), **tags)

    return lay_out


def silent(desk: Path) -> None:
    """Images that state a camera whose lens the catalogue knows, and nothing of its K."""
    write_jpeg(desk / "flight/a.jpg", (5472, 3648), exif=None)
    phantom(desk / "flight" / "a.jpg", dewarp=None, focal_mm=None)


def damaged(desk: Path) -> None:
    (desk / "flight/b.jpg").write_bytes(b"\xff\xd8\xff\xe0")


def unreadable_proposal(desk: Path) -> None:
    proposed(3661.0)(desk)
    [file] = (desk / "fleet/cameras").rglob("*.yaml")
    file.write_text("nonsense")
    git(desk / "fleet", "commit", "-qam", "by hand")


class Case(NamedTuple):
    """What lies there, and what must be heard."""

    lay_out: Callable[[Path], object]
    findings: list[tuple[str, str]]
    not_compared: list[str]
    verdict: str


FILE, WAITING = "a file states another K", "another K proposed"
CASES = {
    "nothing": Case(nothing, [], [], "clean"),
    "images off by 0.01 %": Case(images(3660.9), [], [], "clean"),
    "images off by 0.2 %, of which unit is unknown": Case(
        images(3668.0), [("units differ", "note")], [], "clean"
    ),
    "images off by 3.6 %": Case(images(3792.3), [("K drifted", "error")], [], "findings"),
    "right file": Case(beside(3660.5), [], [], "clean"),
    "file off by 0.01 %": Case(beside(3660.9), [], [], "clean"),
    "file off by 0.2 %": Case(beside(3668.0), [(FILE, "warning")], [], "findings"),
    "file off by 3.6 %": Case(beside(3792.3), [(FILE, "warning")], [], "findings"),
    "file in a folder below": Case(beside(3792.3, "flight/lab/c.xml"), [(FILE, "warning")], [], "findings"),
    "file of another model": Case(of_another_model, [], [], "clean"),
    "torn file": Case(torn, [], ["camera.xml"], "incomplete"),
    "no calibration": Case(notes, [], [], "clean"),
    "proposal of the same K": Case(proposed(3660.5, "--note", "again"), [], [], "clean"),
    "proposal off by 0.01 %": Case(proposed(3660.9), [(WAITING, "note")], [], "clean"),
    "proposal off by 0.2 %": Case(proposed(3668.0), [(WAITING, "warning")], [], "findings"),
    "proposal on a branch": Case(on_a_branch(3668.0), [(WAITING, "warning")], [], "findings"),
    "approved on a branch": Case(
        on_a_branch(3668.0, "--approve", "--reason", "measured anew"), [(WAITING, "warning")], [], "findings"
    ),
    "branch that is behind": Case(approved_since, [], [], "clean"),
    "flight's draft of the unit": Case(of_the_unit, [(WAITING, "warning")], [], "findings"),
    "silent images, by the catalogue": Case(silent, [], [], "clean"),
    "damaged image": Case(damaged, [], [], "incomplete"),
    "unreadable proposal": Case(unreadable_proposal, [], [f"{P4R}@proposed"], "incomplete"),
}


@pytest.mark.parametrize("name", CASES)
def test_an_audit_hears_what_states_another_k(
    name: str, desk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    case = CASES[name]
    case.lay_out(desk)
    found = heard(capsys)
    assert found.findings == case.findings, found.document["findings"]
    assert (found.not_compared, found.verdict) == (case.not_compared, case.verdict), found.document
    assert found.code == (0 if case.verdict == "clean" else 1)
    main(["registry", "audit", "flight"])
    assert ("nothing to do" in capsys.readouterr().out) == (case.verdict == "clean")


@pytest.mark.parametrize(
    "name", every(2, [name for name, case in CASES.items() if case.verdict == "findings"])
)
def test_the_remedy_can_be_done_now(name: str, desk: Path, capsys: pytest.CaptureFixture[str]) -> None:
    CASES[name].lay_out(desk)
    [finding] = heard(capsys).document["findings"]
    command = finding["remedy"].partition(", then")[0].split()
    assert command[:2] == ["calibrary", "diff"]
    assert main([*command[1:]]) == 1
    assert "needs attention" in capsys.readouterr().out


def test_a_proposal_for_a_camera_without_an_entry_is_mentioned(
    desk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    of_a_camera_without_an_entry(desk)
    found = heard(capsys)
    assert found.findings == [("no entry", "error"), (WAITING, "note")]
    command = found.document["findings"][1]["remedy"].partition(", then")[0].split()
    assert main([*command[1:]]) == 0


def test_a_flights_draft_is_mentioned_with_its_difference(
    desk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    of_the_unit(desk)
    [finding] = heard(capsys).document["findings"]
    assert (
        "another K, adjusted, is proposed and not used before it is approved: fx +3.6%" in finding["message"]
    )


def test_a_file_that_does_not_say_whose_it_is_agrees_with_one_of_its_cameras_or_is_not_compared(
    desk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    phantom(desk / "flight" / "b.jpg", model="FC6310S")
    shutil.copy(desk / "used.xml", desk / "s.xml")
    add(
        xml(desk / "s.xml", 3670.5),
        "--approve",
        "--date",
        TODAY,
        camera=("--make", "DJI", "--model", "FC6310S"),
    )
    beside(3670.5)(desk)
    assert heard(capsys).not_compared == []
    beside(3690.5)(desk)
    found = heard(capsys)
    assert (found.not_compared, found.verdict) == (["camera.xml"], "incomplete")


def test_a_branch_without_a_common_commit_is_compared_only_if_it_is_a_registry(
    desk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("pages", "cameras"):
        git(desk / "fleet", "checkout", "-q", "--orphan", name)
        git(desk / "fleet", "rm", "-rfq", ".")
        file = desk / "fleet" / name / "index.yaml"
        file.parent.mkdir()
        file.write_text("pages\n")
        git(desk / "fleet", "add", ".")
        git(desk / "fleet", "commit", "-qm", name)
        git(desk / "fleet", "checkout", "-q", "main")
        assert heard(capsys).verdict == ("clean" if name == "pages" else "incomplete")
    assert Registry.open(desk / "fleet").commit() == open_registry(desk / "fleet").commit


def test_the_entries_of_one_body_are_told_apart_by_lens(
    desk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Three lenses on a body without a serial number are one name, and three findings."""
    for lens, focal in (("24 mm F2.8", 24), ("35 mm F2.8", 35), ("55 mm F1.8", 55)):
        body = {
            "make": "SONY",
            "model": "ILCE-7RM2",
            "lens_model": lens,
            "focal_mm": (focal, 1),
            "software": None,
        }
        phantom(desk / f"flight/{focal}.jpg", (7952, 5304), dewarp=None, **body)
        key = ("--make", "SONY", "--model", "ILCE-7RM2", "--lens", lens)
        fx = focal * 7952 / 35.9
        add(xml(desk / "lens.xml", fx, (7952, 5304)), "--approve", "--date", "2019-01-01", camera=key)
    main(["registry", "audit", "flight", "--explain"])
    said = " ".join(capsys.readouterr().out.split())
    for place in ("24_mm_f2.8", "35_mm_f2.8", "55_mm_f1.8"):
        assert f"{place}: it was calibrated on 2019-01-01" in said


def test_the_remedy_of_a_validity_that_is_over_can_be_done(
    desk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    flags = ("--valid-from", "2020-01-01", "--valid-until", "2021-01-01", "--reason", "only that year")
    assert main(["registry", "retire", P4R, "--reason", "not for ever"]) == 0
    add(desk / "used.xml", "--approve", "--date", TODAY, *flags)
    [finding] = heard(capsys).document["findings"]
    assert (finding["rule"], finding["severity"]) == ("expired in use", "error")
    asked = finding["remedy"].partition("the same: calibrary ")[2].replace("YYYY-MM-DD", "2099-12-31")
    change, approve = (one.split() for one in asked.split(", then calibrary "))
    assert main([*change, "--yes"]) == 0
    assert main([*approve, "--reason", "K is the same", "--yes"]) == 0
    assert heard(capsys).verdict == "clean"


def test_a_remedy_names_the_registry_that_was_named(
    desk: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.delenv("CALIBRARY_REGISTRY")
    proposed(3668.0, "--registry", "fleet")(desk)
    capsys.readouterr()
    assert main(["registry", "audit", "flight", "--registry", "fleet"]) == 1
    said = " ".join(capsys.readouterr().out.split())
    place = "--registry fleet"
    assert (
        f"→ calibrary diff {place} {P4R} {P4R}@proposed, then calibrary registry approve {place} {P4R}"
        in said
    )
    command = said.partition("→ calibrary ")[2].partition(", then")[0].split()
    assert main(command) == 1


def test_a_file_that_is_right_can_be_added_as_the_remedy_says(
    desk: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    beside(3668.0)(desk)
    [finding] = heard(capsys).document["findings"]
    command = finding["remedy"].partition("if it is right calibrary ")[2].split()
    assert main([*command, "--approve", "--reason", "measured anew", "--date", TODAY, "--yes"]) == 0
    # The images still state the K that they did before.
    assert heard(capsys).findings == [("units differ", "note")]
