"""``registry add`` of a folder of calibrations, or of the catalogue: in one commit, and only once."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrary.calibration import CameraKey, Grade
from calibrary.catalogue import load_catalogue
from calibrary.jobs.layers.catalogue_entries import catalogue_entries
from calibrary.known_camera import KnownCamera, Projection
from calibrary.policy import FLEET
from calibrary.records import replace
from calibrary.registry.entry import Status
from calibrary.registry.entry_checks import check
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.registry import Registry
from calibrary.registry.resolution import RegistryIndex
from calibrary.validation import Severity
from tests.cli.registry.direct import put
from tests.cli.registry.fleets import CAMERA, P4R, commit_of, held, printed, run, xml
from tests.jobs.extract.fleet import picture
from tests.registry.entries import an_entry
from tests.registry.git.repositories import git


class TestCatalogue:
    @pytest.mark.thorough
    def test_every_camera_whose_k_can_be_derived_becomes_a_draft(
        self, fleet: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        before = commit_of(fleet)
        code, out, _ = run(capsys, "add", "catalogue", "--yes")
        entries = [*Registry.open(fleet).snapshot().proposals()]
        assert code == 0
        assert len(entries) > 60
        assert {one.entry.status for one in entries} == {Status.DRAFT}
        assert {one.entry.calibration.grade for one in entries} == {Grade.DERIVED}
        assert git(fleet, "rev-list", "--count", f"{before}..HEAD") == "1"
        assert f"proposed {len(entries)} entries" in out
        assert f"{len(entries)} new" in out
        assert run(capsys, "check")[0] == 0

    @pytest.mark.thorough
    def test_a_second_time_changes_nothing(self, fleet: Path, capsys: pytest.CaptureFixture[str]) -> None:
        run(capsys, "add", "catalogue", "--yes")
        commit = commit_of(fleet)
        document = printed(capsys, "registry-change-1", "add", "catalogue", "--yes")
        assert (document["entries"], document["commit"]) == ([], None)
        assert commit_of(fleet) == commit

    def test_a_camera_that_somebody_calibrated_is_left_alone(
        self, fleet: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        put(fleet, an_entry(focal_mm=None))
        _, out, _ = run(capsys, "add", "catalogue", "--yes")
        assert held(fleet).entry.calibration.intrinsics.fx == 3661.25
        assert f"{P4R}: there is already an entry of grade calibrated, calibration-file" in out

    @pytest.mark.thorough
    def test_a_draft_of_an_older_catalogue_follows_and_an_approved_one_does_not(
        self, fleet: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        entries = {entry.id: entry for entry in catalogue_entries()[0]}
        first, second = entries[P4R], entries["dji/fc330/4000x3000"]
        older = [replace(entry, tolerance=0.5) for entry in (first, replace(second, status=Status.APPROVED))]
        put(fleet, *older)
        run(capsys, "add", "catalogue", "--yes")
        assert held(fleet, first.id).entry.tolerance == first.tolerance
        assert held(fleet, second.id).entry == older[1]

    def test_its_entries_may_be_approved_as_they_are(self) -> None:
        entries = [replace(entry, status=Status.APPROVED) for entry in catalogue_entries()[0]]
        findings = check({entry.path: entry for entry in entries}, FLEET)
        assert [finding for finding in findings if finding.severity is Severity.ERROR] == []

    def test_each_answers_for_its_camera_under_all_its_names(self) -> None:
        entries, left = catalogue_entries()
        files = {entry.path: (replace(entry, status=Status.APPROVED),) for entry in entries}
        index = RegistryIndex(files, files.__getitem__)
        out = {camera.title for camera in left}
        for camera in load_catalogue():
            if f"{camera.make} {camera.title}" in out:
                continue
            for make in (camera.make, *camera.other_makes):
                for model in camera.models:
                    for sub_camera in camera.bands or (camera.sub_camera,):
                        key = CameraKey(
                            make=make,
                            model=model,
                            sub_camera=sub_camera,
                            lens=camera.lens,
                            focal_mm=camera.focal_mm,
                            image_size=camera.native_size,
                        )
                        found = index.resolve(key)
                        assert found is not None, key
                        assert found.calibration.provenance.tag is not None
                        assert camera.title in found.calibration.provenance.tag, key

    def test_a_k_is_focal_length_over_pitch_where_no_better_is_stated(self) -> None:
        bare = KnownCamera(
            make="M", models=("X",), title="X", native_size=(4000, 3000), pitch_um=1.5, focal_mm=4.5
        )
        stated = replace(bare, models=("Y",), fx_over_w=0.7)
        fisheye = replace(bare, models=("Z",), title="Z", projection=Projection.FISHEYE)
        (one, two), [left] = catalogue_entries([bare, stated, fisheye])
        assert one.calibration.intrinsics.fx == pytest.approx(4.5 / 0.0015, rel=1e-15)
        assert two.calibration.intrinsics.fx == pytest.approx(0.7 * 4000, rel=1e-15)
        assert (one.calibration.intrinsics.cx, one.calibration.intrinsics.cy) == (2000.0, 1500.0)
        assert one.calibration.distortion is None
        assert (left.title, "fisheye" in left.reason) == ("M Z", True)

    @pytest.mark.usefixtures("fleet")
    @pytest.mark.parametrize(
        "arguments",
        [
            ["--approve"],
            [*CAMERA],
            ["--date", "2026-05-01"],
            ["--label", "A"],
            ["--valid-from", "2026-05-01"],
            ["--valid-until", "2026-05-01"],
            ["--force", "--reason", "so"],
        ],
    )
    def test_what_it_does_not_take_is_a_misuse(
        self, capsys: pytest.CaptureFixture[str], arguments: list[str]
    ) -> None:
        assert run(capsys, "add", "catalogue", "--yes", *arguments)[0] == 2


class TestFolder:
    def test_every_file_below_it_in_one_commit(
        self, fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        (tmp_path / "lab/deep/.git").mkdir(parents=True)
        xml(tmp_path / "lab/a.xml")
        xml(tmp_path / "lab/deep/b.xml", 3601.5, size=(4864, 3648))
        (tmp_path / "lab/deep/c.yaml").write_bytes(entry_yaml(an_entry(model="Other")))
        (tmp_path / "lab/deep/.git/config.xml").write_text("<not ours>")
        picture(tmp_path / "lab/photo.jpg")
        before = commit_of(fleet)
        document = printed(
            capsys,
            "registry-change-1",
            "add",
            tmp_path / "lab",
            *CAMERA[:2],
            "--model",
            "FC6310R",
            "--yes",
        )
        assert [(item["source"], item["fate"]) for item in document["sources"]] == [
            ("a.xml", "new"),
            ("deep/b.xml", "new"),
            ("deep/c.yaml", "new"),
        ]
        assert git(fleet, "rev-list", "--count", f"{before}..HEAD") == "1"
        assert held(fleet).entry.status is Status.DRAFT

    def test_a_k_that_contradicts_the_catalogue_takes_force_and_a_reason(
        self, fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        """Ten times the focal length of that camera: a slip that one word had let into use."""
        (tmp_path / "lab").mkdir()
        xml(tmp_path / "lab/a.xml", 36605.0)
        command = ["add", str(tmp_path / "lab"), *CAMERA, "--approve", "--yes"]
        commit = commit_of(fleet)
        code, out, _ = run(capsys, *command)
        assert (code, commit_of(fleet)) == (3, commit)
        assert "failed  a.xml" in out
        assert run(capsys, *command, "--force")[0] == 2
        assert run(capsys, *command, "--force", "--reason", "a lens of ten times the length")[0] == 0
        assert held(fleet).entry.calibration.intrinsics.fx == 36605.0
        assert "a lens of ten times the length" in run(capsys, "check")[1]

    def test_the_same_files_again_change_nothing(
        self, fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        (tmp_path / "lab").mkdir()
        xml(tmp_path / "lab/a.xml")
        command = ["add", str(tmp_path / "lab"), *CAMERA, "--yes"]
        run(capsys, *command)
        commit = commit_of(fleet)
        code, out, _ = run(capsys, *command)
        assert (code, "1 same" in out, "nothing is new" in out) == (0, True, True)
        assert commit_of(fleet) == commit

    def test_what_cannot_be_taken_is_told_and_holds_up_no_other(
        self, fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        (tmp_path / "lab").mkdir()
        xml(tmp_path / "lab/a.xml")
        xml(tmp_path / "lab/b.xml", 3999.0)
        xml(tmp_path / "lab/same.xml")
        (tmp_path / "lab/notes.txt").write_text("remember the milk")
        (tmp_path / "lab/broken.xml").write_text("<calibration><width>")
        code, out, _ = run(capsys, "add", tmp_path / "lab", *CAMERA, "--yes")
        assert code == 0
        assert f"new     a.xml → {P4R}" in out
        assert "a.xml has other numbers for the same camera" in out
        assert "same    same.xml" in out
        assert "the same numbers as in a.xml" in out
        assert "failed  broken.xml" in out
        assert "failed  notes.txt" in out
        assert held(fleet).entry.calibration.intrinsics.fx == 3660.5

    def test_nothing_taken_of_something_is_exit_code_3(
        self, fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        (tmp_path / "lab").mkdir()
        xml(tmp_path / "lab/a.xml")
        before = commit_of(fleet)
        code, out, _ = run(capsys, "add", tmp_path / "lab", "--yes")
        assert (code, "state it with --make NAME --model NAME" in out) == (3, True)
        assert commit_of(fleet) == before
        (tmp_path / "empty").mkdir()
        assert run(capsys, "add", tmp_path / "empty", "--yes")[0] == 0
        assert run(capsys, "add", tmp_path / "nowhere", "--yes")[0] == 3

    def test_an_entry_that_the_check_is_against_is_left_and_the_others_are_written(
        self, fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        (tmp_path / "lab").mkdir()
        xml(tmp_path / "lab/a.xml")
        xml(tmp_path / "lab/b.xml", size=(4864, 3648), cx=2000.0)
        code, out, _ = run(capsys, "add", tmp_path / "lab", *CAMERA, "--approve", "--yes")
        assert code == 0
        assert "failed  b.xml" in out
        assert [one.id for one in Registry.open(fleet).snapshot().entries()] == [P4R]
        assert held(fleet).entry.status is Status.APPROVED

    @pytest.mark.usefixtures("fleet")
    def test_without_anybody_to_ask_it_writes_nothing(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr("sys.stdin", None)
        (tmp_path / "lab").mkdir()
        xml(tmp_path / "lab/a.xml")
        with pytest.raises(SystemExit, match="2"):
            run(capsys, "add", tmp_path / "lab", *CAMERA)
