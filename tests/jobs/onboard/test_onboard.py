"""``calibrary onboard``: what came with a payload, sorted, heard, and proposed."""

from __future__ import annotations

import io
import json
import re
import shlex
import shutil
from pathlib import Path
from typing import Any

import pytest

from calibrary.calibration import Grade
from calibrary.cli.main import main
from calibrary.errors import InputError, UsageError
from calibrary.evidence.metadata import ImageMetadata
from calibrary.jobs.convert import convert
from calibrary.jobs.onboard import onboard as job
from calibrary.jobs.onboard.payload import Payload, with_frames
from calibrary.jobs.onboard.report import Agreement, Decision, OnboardReport
from calibrary.jobs.onboard.told import ROLES
from calibrary.parsers.files import sha256_of
from calibrary.registry.entry import Entry, Status
from calibrary.registry.registry import Registry
from tests.calib.photographs import saved
from tests.cli.registry.fleets import add, commit_of, held, looked_at, run, xml
from tests.jobs.extract.fleet import picture
from tests.jobs.onboard.payloads import PHANTOM, document, onboard, phantom, survey
from tests.registry.git.repositories import git

BRANCH = "onboard/example-survey_one"
UNIT = ("--for", "unit")
ENTRY = "example/survey_one"


def drafted(fleet: Path, branch: str = BRANCH) -> list[Entry]:
    """The entries on a branch."""
    return [one.entry for one in Registry.open(fleet).snapshot(branch).proposals()]


def branches(fleet: Path) -> list[str]:
    return git(fleet, "branch", "--format=%(refname:short)").split()


@pytest.fixture
def payload(tmp_path: Path) -> Path:
    return survey(tmp_path / "payload")


def test_a_folder_is_sorted_whatever_lies_where(
    fleet: Path, payload: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = document(capsys, payload, *UNIT)["sorted"]
    assert (found["images"], found["board_frames"], found["calibration_files"]) == (2, 0, 1)
    assert [one["file"] for one in found["skipped"]] == ["papers/invoice.txt"]
    assert fleet.exists()


def test_a_file_of_the_whole_frame_is_not_of_images_that_may_be_a_part(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture(tmp_path / "payload/DJI_0001.JPG", (2736, 1824), **PHANTOM, pixel_size=(5472, 3648))
    xml(tmp_path / "payload/camera.xml")
    [camera] = document(capsys, tmp_path / "payload", *UNIT)["cameras"]
    assert camera["decision"] == "refused"
    assert "resized, or cropped" in camera["reason"]
    assert fleet.exists()


def test_images_too_few_for_frames_of_a_board_need_no_opencv(
    fleet: Path, payload: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("calibrary.jobs.onboard.payload.CALIBRATE", "calibrary.extras.CALIBRATE"):
        monkeypatch.setattr(name, ("a_library_that_nobody_has",))
    assert document(capsys, payload, *UNIT)["cameras"][0]["decision"] == "draft proposed"
    assert fleet.exists()


def test_the_best_grade_is_proposed_and_everybody_is_shown_beside_it(
    fleet: Path, payload: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    [camera] = document(capsys, payload, *UNIT)["cameras"]
    printed = {one["name"]: (one["kind"], one["chosen"], one["agrees"]) for one in camera["estimates"]}
    assert printed == {
        "papers/camera.xml": ("file", True, None),
        "EXIF FocalLength × FocalPlaneResolution": ("tags", False, True),
        "EXIF FocalLengthIn35mmFilm": ("tags", False, True),
    }
    assert camera["decision"] == "draft proposed"
    assert camera["entry"]["calibration"]["grade"] == "adjusted"
    assert camera["reason"].startswith("its K is that of papers/camera.xml, grade adjusted; ")
    assert fleet.exists()


@pytest.mark.usefixtures("fleet")
def test_the_profile_of_a_kind_of_lens_is_shown_and_is_no_witness(
    payload: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (payload / "papers" / "lens.xml").write_text(
        "<lensdatabase><lens><model>10 mm</model><cropfactor>2.618</cropfactor><aspect-ratio>4:3</aspect-ratio>"
        '<calibration><distortion model="poly3" focal="10" k1="-0.01"/></calibration></lens></lensdatabase>'
    )
    [camera] = document(capsys, payload, *UNIT)["cameras"]
    [profile] = (one for one in camera["estimates"] if one["name"] == "papers/lens.xml")
    assert (profile["grade"], profile["agrees"], profile["agreement"]) == ("prior", None, None)


def test_the_draft_waits_on_a_branch_and_the_main_one_is_left_alone(
    fleet: Path, payload: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = commit_of(fleet)
    code, out, _ = onboard(capsys, payload, *UNIT, "--yes")
    assert (code, commit_of(fleet)) == (0, before)
    [entry] = drafted(fleet)
    assert (entry.status, entry.calibration.intrinsics.fx) == (Status.DRAFT, 968.0)
    assert list(Registry.open(fleet).snapshot().entries()) == []
    assert git(fleet, "status", "--porcelain") == ""
    assert f"calibrary registry approve --from {BRANCH}" in out


def test_approving_from_the_branch_puts_it_to_use(
    fleet: Path, payload: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    onboard(capsys, payload, *UNIT, "--yes")
    [entry] = drafted(fleet)
    shown = looked_at(fleet, entry.id, rev=BRANCH)
    code, _, _ = run(capsys, "approve", *shown, "--from", BRANCH, "--reason", "looked at")
    assert code == 0
    found = held(fleet, entry.id).entry
    assert (found.status, found.reason) == (Status.APPROVED, "looked at")
    assert found.calibration.intrinsics == entry.calibration.intrinsics
    before = commit_of(fleet)
    code, out, _ = run(capsys, "approve", entry.id, "--from", BRANCH)
    assert (code, commit_of(fleet), "is there already" in out) == (0, before, True)


def test_a_digest_of_less_than_eight_digits_or_of_other_files_writes_nothing(
    fleet: Path, payload: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    [digest] = re.findall("--digest ([0-9a-f]+) writes this", onboard(capsys, payload, *UNIT, "--dry-run")[1])
    for wrong, code in (("", 2), (digest[:7], 2), ("0" * 12, 1)):
        assert (onboard(capsys, payload, *UNIT, "--digest", wrong)[0], branches(fleet)) == (code, ["main"])
    code, _, err = onboard(capsys, payload, *UNIT, "--digest", digest.upper(), "--dry-run")
    assert (code, "not those that were looked at" in err, branches(fleet)) == (0, False, ["main"])
    seen = onboard(capsys, payload, *UNIT, "--digest", digest, "--operator", "somebody else")
    assert (seen[0], branches(fleet)) == (1, ["main"])
    assert onboard(capsys, payload, *UNIT, "--digest", digest.upper())[0] == 0
    assert branches(fleet) == ["main", BRANCH]


def test_running_it_twice_changes_nothing(
    fleet: Path, payload: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    onboard(capsys, payload, *UNIT, "--yes")
    tip = git(fleet, "rev-parse", BRANCH)
    found = document(capsys, payload, *UNIT)
    assert (found["cameras"][0]["decision"], found["branches"]) == ("nothing new", {})
    assert git(fleet, "rev-parse", BRANCH) == tip
    [entry] = drafted(fleet)
    run(capsys, "approve", *looked_at(fleet, entry.id, rev=BRANCH), "--from", BRANCH)
    [camera] = document(capsys, payload, *UNIT)["cameras"]
    assert (camera["decision"], camera["entry"]["status"]) == ("nothing new", "approved")
    assert git(fleet, "rev-parse", BRANCH) == tip


def test_a_unit_without_a_serial_number_is_not_the_whole_model(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    payload = survey(tmp_path / "payload", body_serial=None)
    code, out, _ = onboard(capsys, payload, *UNIT, "--yes")
    assert (code, branches(fleet)) == (1, ["main"])
    assert "--serial NUMBER" in out
    assert onboard(capsys, payload, *UNIT, "--serial", "0V2LG3H0", "--yes")[0] == 0
    [entry] = drafted(fleet)
    assert entry.path.startswith(f"cameras/{ENTRY}/sn-")


def test_units_of_one_model_are_told_apart(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for serial in ("0V2LG3H0", "0V2LG3H1"):
        phantom(tmp_path / "payload" / serial, body_serial=serial)
    _, out, _ = onboard(capsys, tmp_path / "payload", *UNIT, "--yes")
    named = re.findall(r"(?m)^(.*)  (?:ready, not written|refused)$", out)
    assert len(set(named)) == len(named) == 2, out
    assert all(", unit " in one for one in named)
    assert fleet.exists()


def test_the_label_is_the_units_and_stays(
    fleet: Path, payload: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    onboard(capsys, payload, *UNIT, "--label", "M3M-02", "--yes")
    [entry] = drafted(fleet)
    assert (entry.unit is not None, entry.label) == (True, "M3M-02")
    run(capsys, "approve", *looked_at(fleet, entry.id, rev=BRANCH), "--from", BRANCH)
    # The next calibration of the unit is called as the unit is.
    xml(payload / "papers" / "camera.xml", 969.5, (1280, 960), 4.5)
    assert onboard(capsys, payload, *UNIT, "--yes")[0] == 0
    [again] = drafted(fleet)
    assert (again.calibration.intrinsics.fx, again.label) == (969.5, "M3M-02")


def test_a_whole_model_has_no_label(fleet: Path, payload: Path, capsys: pytest.CaptureFixture[str]) -> None:
    onboard(capsys, payload, "--for", "model", "--label", "M3M-02", "--yes")
    assert [(entry.unit, entry.label) for entry in drafted(fleet)] == [(None, None)]


def test_another_source_is_another_draft(
    fleet: Path, payload: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    onboard(capsys, payload, *UNIT, "--yes")
    xml(payload / "papers" / "camera.xml", 969.5, (1280, 960), 4.5)
    assert onboard(capsys, payload, *UNIT, "--yes")[0] == 0
    assert git(fleet, "rev-list", "--count", f"main..{BRANCH}") == "2"
    assert drafted(fleet)[0].calibration.intrinsics.fx == 969.5


def test_the_hash_of_every_source_is_in_the_entry_and_in_the_commit(
    fleet: Path, payload: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    [camera] = document(capsys, payload, *UNIT)["cameras"]
    [entry] = drafted(fleet)
    block = entry.extensions["x-onboarding"]
    assert isinstance(block, dict)
    assert block["sources"] == camera["sources"]
    printed = git(fleet, "log", "-1", "--format=%B", BRANCH)
    assert all(source["sha256"] in printed for source in camera["sources"])
    assert str(entry.calibration.provenance.sha256) in printed


@pytest.mark.usefixtures("fleet")
def test_the_hash_of_a_k_is_that_of_the_image_that_states_it(tmp_path: Path) -> None:
    folder = phantom(tmp_path / "payload")
    for without_dewarp in ("DJI_0000.JPG", "DJI_0002.JPG"):
        picture(folder / without_dewarp, **PHANTOM)
    [camera] = job(folder, serves="unit", html=tmp_path / "page.html").cameras
    assert camera.entry is not None
    made = camera.entry.calibration.provenance
    assert (made.source, made.sha256) == ("DJI_0001.JPG", sha256_of(folder / "DJI_0001.JPG"))


@pytest.mark.usefixtures("fleet")
def test_the_hash_of_a_k_is_that_of_its_image_where_two_folders_have_the_same_names(tmp_path: Path) -> None:
    folder = phantom(tmp_path / "payload" / "second").parent
    (folder / "first").mkdir()
    picture(folder / "first" / "DJI_0001.JPG", **PHANTOM)
    [camera] = job(folder, serves="unit", html=tmp_path / "page.html").cameras
    assert camera.entry is not None
    assert camera.entry.calibration.provenance.sha256 == sha256_of(folder / "second" / "DJI_0001.JPG")


@pytest.mark.parametrize("model", ["Survey Two.", "Übersicht 2", "Survey..2", ".lock"])
def test_any_name_of_a_model_makes_a_branch(fleet: Path, tmp_path: Path, model: str) -> None:
    folder = survey(tmp_path / "payload", model=model)
    [written] = job(folder, serves="unit", html=tmp_path / "page.html", write=True).branches
    assert written in branches(fleet)


@pytest.mark.usefixtures("fleet")
def test_all_that_is_missing_is_asked_in_one_message_with_the_whole_command(
    payload: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("calibrary.jobs.onboard.payload._has_board", lambda *_: True)
    flight = payload / "flight/100_0001"
    shutil.copy(flight / "IMG_0000.jpg", flight / "IMG_0002.jpg")
    monkeypatch.setattr("calibrary.jobs.onboard.run.observe", lambda *_, **__: pytest.fail("computed"))
    code, _, err = onboard(capsys, payload, "--label", "P4R 03", "--yes")
    assert code == 2
    assert "3 images show a calibration board: the side of its squares in mm?" in err
    assert re.search(r"say it: calibrary onboard .* --label 'P4R 03' --yes --square-mm MM --for unit\n$", err)


@pytest.mark.usefixtures("fleet")
def test_a_name_of_no_camera_is_told_before_images_are_searched_for_a_board(
    payload: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("calibrary.jobs.onboard.run.with_frames", lambda *_, **__: pytest.fail("searched"))
    with pytest.raises(InputError, match="no camera in it is called 'M3T'"):
        job(payload, only="M3T")


@pytest.mark.usefixtures("fleet")
def test_what_is_proposed_is_approved_by_the_line_that_was_printed(
    payload: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, out, _ = onboard(capsys, payload, "--yes", "--for", "unit")
    [line] = [line for line in out.splitlines() if line.startswith("then: ")]
    assert main(shlex.split(line.removeprefix("then: calibrary "))) == 0


def test_of_a_set_of_which_half_shows_a_board_every_frame_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "calibrary.jobs.onboard.payload._has_board", lambda path, _: path.name in {"1.jpg", "3.jpg", "5.jpg"}
    )
    names = tuple(f"{number}.jpg" for number in range(6))
    states = {ImageMetadata(size=(640, 480)): names}
    found = Payload(folder=tmp_path, states=states, frames=frozenset(), files=(), others=())
    assert with_frames(found).frames == {*names}


def test_sources_that_disagree_with_nothing_to_decide_are_refused(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, page = survey(tmp_path / "payload", 1300.0), tmp_path / "page.html"
    code, out, _ = onboard(capsys, folder, *UNIT, "--yes", page=page)
    assert (code, branches(fleet)) == (1, ["main"])
    assert "nothing confirms it" in out
    assert "--trust file or --trust tags" in out
    assert "refused" in page.read_text()


def test_a_person_may_say_whom_to_believe_and_it_is_kept(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = survey(tmp_path / "payload", 1300.0)
    assert onboard(capsys, folder, *UNIT, "--yes", "--trust", "file")[0] == 0
    [entry] = drafted(fleet)
    assert entry.calibration.intrinsics.fx == 1300.0
    assert any("is not used" in note for note in entry.notes)


def test_a_sensor_that_nobody_stated_gives_no_k(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "flight").mkdir()
    picture(tmp_path / "flight" / "a.jpg", make="Example", model="Two", focal_mm=(132, 10))
    code, out, _ = onboard(capsys, tmp_path / "flight", "--yes")
    assert (code, branches(fleet)) == (1, ["main"])
    assert "Its sensor size is not stated" in out


def test_a_k_that_breaks_the_policy_is_refused(
    fleet: Path, payload: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    xml(payload / "papers" / "camera.xml", 968.0, (1280, 960), 120.0)
    code, out, _ = onboard(capsys, payload, *UNIT, "--yes")
    assert (code, branches(fleet)) == (1, ["main"])
    assert "principal point" in out


def test_every_camera_of_a_payload_is_taken_on_one_branch(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    M3T: dict[str, Any] = {"make": "DJI", "model": "M3T", "body_serial": "1581F5EXAMPLE"}
    (tmp_path / "flight").mkdir()
    wide = {**M3T, "focal_mm": (44, 10), "drone_dji:ImageSource": "WideCamera"}
    thermal = {**M3T, "focal_mm": (91, 10), "drone_dji:ImageSource": "InfraredCamera"}
    picture(tmp_path / "flight" / "W.jpg", (8000, 6000), **wide)
    picture(tmp_path / "flight" / "T.jpg", (640, 512), **thermal)
    assert onboard(capsys, tmp_path / "flight", "--yes")[0] == 0
    cameras = {one.calibration.camera.sub_camera: one for one in drafted(fleet, "onboard/dji-m3t")}
    assert cameras.keys() == {"wide", "thermal"}
    assert git(fleet, "rev-list", "--count", "main..onboard/dji-m3t") == "1"
    # Focal length over pitch is every unit's, so nobody is asked whose it is.
    assert {one.calibration.camera.serial for one in cameras.values()} == {None}


def test_only_the_cameras_that_are_meant_are_taken(
    fleet: Path, payload: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    phantom(payload / "other")
    found = document(capsys, payload, *UNIT, "--only", "survey")
    assert [one["camera"]["model"] for one in found["cameras"]] == ["Survey One"]
    code, _, err = onboard(capsys, payload, *UNIT, "--yes", "--only", "nothing")
    assert (code, "DJI FC6310R" in err) == (3, True)
    assert fleet.exists()


def test_one_refused_camera_keeps_all_from_being_written(
    fleet: Path, payload: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    phantom(payload / "other", dewarp=None, focal_mm=(44, 10))
    code, out, err = onboard(capsys, payload, *UNIT, "--yes")
    assert (code, branches(fleet)) == (1, ["main"])
    assert "ready, not written" in out + err
    assert "draft proposed" not in out + err


@pytest.mark.usefixtures("fleet")
def test_machines_are_told_the_flag_of_what_only_a_person_knows(
    payload: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, err = onboard(capsys, payload, "--yes")
    assert (code, "--for unit" in err) == (2, True)
    (tmp_path / "boards").mkdir()
    saved(tmp_path / "boards" / "frames", 3)
    named = ["--make", "Example", "--model", "Survey One"]
    code, _, err = onboard(capsys, tmp_path / "boards", "--yes", *named)
    assert (code, "--square-mm" in err) == (2, True)


@pytest.mark.usefixtures("fleet")
def test_a_camera_that_nothing_names_is_a_question_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "papers").mkdir()
    xml(tmp_path / "papers" / "camera.xml", 968.0, (1280, 960))
    monkeypatch.chdir(tmp_path)
    code, _, err = onboard(capsys, Path("papers"), "--yes")
    assert (code, "--make NAME --model NAME" in err) == (2, True)
    found = document(capsys, tmp_path / "papers", "--make", "Example", "--model", "Survey One")
    assert found["cameras"][0]["decision"] == "draft proposed"


def test_a_person_is_asked_on_a_terminal(
    fleet: Path, payload: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setattr("sys.stdin", Terminal("unit\nyes\n"))
    code, _, err = onboard(capsys, payload)
    assert (code, "[unit/model]" in err) == (0, True)
    assert drafted(fleet)[0].calibration.camera.serial is not None
    monkeypatch.setattr("sys.stdin", Terminal("model\nno\n"))
    code, err, _ = onboard(capsys, payload)
    assert (code, "nothing was written into the registry" in err) == (0, True)


def test_a_program_says_what_only_a_person_knows_and_whether_to_write(
    fleet: Path, payload: Path, tmp_path: Path
) -> None:
    page = tmp_path / "page.html"
    seen: list[OnboardReport] = []

    def refused(report: OnboardReport) -> bool:
        seen.append(report)
        return False

    with pytest.raises(UsageError, match=r"--for unit: .*or every one's of its model"):
        job(payload, html=page)
    done = job(payload, ask=lambda *_: "Unit", write=refused, html=page)
    assert (done.is_good, done.branches, branches(fleet)) == (True, {}, ["main"])
    assert seen == [done]
    assert (done.cameras[0].decision, done.cameras[0].next) == (Decision.READY, None)
    assert "draft proposed" not in page.read_text()
    with pytest.raises(UsageError, match="expected unit or model"):
        job(payload, ask=lambda *_: "mine", html=page)
    done = job(payload, serves="unit", write=True, reason="a new lens", html=page)
    assert done.branches == {BRANCH: git(fleet, "rev-parse", BRANCH)}
    assert (done.cameras[0].branch, done.page) == (BRANCH, "page.html")
    assert done.cameras[0].decision is Decision.PROPOSED
    assert f" --from {BRANCH} --digest " in (done.cameras[0].next or "")
    assert "draft proposed" in page.read_text()
    assert "a new lens" in git(fleet, "log", "-1", "--format=%B", BRANCH)


def test_entries_of_the_same_model_are_held_beside_it(
    fleet: Path, payload: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = ("--make", "Example", "--model", "Survey One")
    add(xml(tmp_path / "old.xml", 960.0, (1280, 960), 4.5), "--approve", camera=own)
    [camera] = document(capsys, payload, *UNIT)["cameras"]
    [relative] = camera["relatives"]
    assert (relative["id"], relative["own"]) == (f"{ENTRY}/1280x960", False)
    assert relative["focal_change"] == pytest.approx(968 / 960 - 1)
    registry = [one for one in camera["estimates"] if one["kind"] == "registry"]
    # 0.8 % is within what two cameras of one model keep, and 80 cm of height from 100 m: that is no agreement.
    assert [(one["agrees"], one["agreement"]) for one in registry] == [(False, "differs")]
    assert camera["decision"] == "draft proposed"
    assert "differs by -0.83%, which matters on a map" in camera["reason"]
    assert fleet.exists()


def test_a_file_with_the_numbers_of_a_tag_is_proposed_as_what_the_tag_states(
    fleet: Path, payload: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    image = payload / "flight/100_0001/IMG_0000.jpg"
    convert(image, payload / "papers/camera.xml", to="agisoft_xml", force=True)
    [camera] = document(capsys, payload, *UNIT)["cameras"]
    [chosen] = [one for one in camera["estimates"] if one["chosen"]]
    assert (chosen["kind"], chosen["grade"]) == ("tags", "derived")
    assert "papers/camera.xml has its numbers; EXIF FocalLengthIn35mmFilm agrees" in camera["reason"]
    assert [one.calibration.grade for one in drafted(fleet)] == [Grade.DERIVED]


def test_what_a_file_calls_its_cameras_is_no_sub_camera(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    thermal: dict[str, Any] = {"focal_mm": (91, 10), "drone_dji:ImageSource": "InfraredCamera"}
    picture(tmp_path / "flight/T.jpg", (640, 512), make="DJI", model="M3T", **thermal)
    lens = dict.fromkeys(("c_x", "c_y", "p1", "p2", "k2", "k3"), 0.001) | {
        "focal_x": 1.18,
        "focal_y": 1.18,
        "k1": -0.3,
    }
    cameras = {
        f"v2 dji {model} {width} {height} brown 1.1": {
            "projection_type": "brown", "width": width, "height": height, **lens
        }
        for model, width, height in (("m3t", 640, 512), ("fc6310r", 5472, 3648))
    }  # fmt: skip
    (tmp_path / "flight/cameras.json").write_text(json.dumps(cameras))
    [camera] = document(capsys, tmp_path / "flight", "--for", "model")["cameras"]
    assert [one["name"] for one in camera["estimates"] if one["chosen"]] == ["cameras.json, camera 1"]
    assert fleet.exists()


def test_the_chart_names_an_agreement_as_the_table_does() -> None:
    assert {agreement: role.value[2] for agreement, role in ROLES.items()} == {
        one: one.value for one in Agreement
    }


def test_nothing_private_is_repeated(
    fleet: Path, payload: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "page.html"
    _, out, err = onboard(capsys, payload, *UNIT, "--yes", "--json", page=page)
    whole = out + err + page.read_text() + git(fleet, "log", "-p", "--all")
    assert "EX-0042-77" not in whole


@pytest.mark.usefixtures("fleet")
def test_an_empty_folder_and_a_missing_registry_have_their_codes(
    payload: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "empty").mkdir()
    assert onboard(capsys, tmp_path / "empty", "--yes")[0] == 3
    assert onboard(capsys, payload, "--yes", "--registry", str(tmp_path / "nowhere"))[0] == 4


@pytest.mark.thorough
@pytest.mark.usefixtures("drawn")
def test_the_page_lies_beside_under_the_cameras_name(
    fleet: Path, payload: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["onboard", str(payload), *UNIT, "--yes"]) == 0
    page = (tmp_path / "onboard-example-survey_one.html").read_text()
    assert "fx of every estimate" in page
    assert fleet.exists()
