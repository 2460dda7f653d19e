"""``registry export``: everything for another program, with what it cannot hold reported instead of bent."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pycolmap
import pytest
import yaml

from calibrary import parsers
from calibrary.distortion import KannalaBrandt, NoDistortion, ThinPrism
from calibrary.registry.entry import Status
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.snapshot import Snapshot
from tests.cli.registry.direct import put
from tests.cli.registry.fleets import printed, run
from tests.registry.entries import an_entry

FIRST = an_entry(distortion=NoDistortion())
SECOND = an_entry(model="Other, with a comma", fx=2000.5, size=(4000, 3000))
DRAFT = an_entry(model="Draft", status=Status.DRAFT)
FISHEYE = an_entry(model="Round", distortion=KannalaBrandt(k1=0.01, k2=-0.002, k3=0.0005, k4=0.0))


def test_colmap_reads_the_same_cameras(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, FIRST, SECOND, DRAFT)
    done = printed(capsys, "registry-export-1", "export", "--to", "colmap", "--out", tmp_path / "cameras.txt")
    assert [one["entry"] for one in done["written"]] == sorted([FIRST.id, SECOND.id])
    assert {one["verdict"] for one in done["written"]} == {"exact"}
    for name in ("images.txt", "points3D.txt"):
        (tmp_path / name).touch()
    cameras = pycolmap.Reconstruction(tmp_path).cameras
    read = {camera.width: camera.calibration_matrix() for camera in cameras.values()}
    for entry in (FIRST, SECOND):
        K = entry.calibration.intrinsics
        assert np.array_equal(read[K.image_size[0]], K.matrix)


def test_odm_and_opensfm_get_one_file_under_their_own_names(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, FIRST, SECOND)
    for form in ("odm", "opensfm"):
        out = tmp_path / f"{form}.json"
        code, printed, _ = run(capsys, "export", "--to", form, "--out", out)
        assert code == 0
        assert "2 entries" in printed
        read = sorted({round(one.intrinsics.fx, 9) for one in parsers.read(out)})
        assert read == pytest.approx([2000.5, 3661.25], rel=1e-12)


def test_odm_finds_a_camera_of_the_registry_under_the_focal_length_that_its_exif_has(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, FIRST, SECOND)
    assert run(capsys, "export", "--to", "odm", "--out", tmp_path / "cameras.json")[0] == 0
    names = set(json.loads((tmp_path / "cameras.json").read_text()))
    # FocalLengthIn35mmFilm over 36: the catalogue knows the first camera's 24; the other's is 18.0 by its K.
    assert "dji fc6310r 5472 3648 brown 0.6666" in names
    assert {name.split()[-1] for name in names if name.startswith("dji fc6310r")} == {"0.6666", "0.85"}
    others = {name.split()[-1] for name in names if not name.startswith("dji fc6310r")}
    assert {str(mm / 36)[:6] for mm in (17, 18)} <= others
    assert len(others) <= 6


def test_of_two_that_a_program_calls_alike_only_the_plainer_is_written(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    unit = an_entry(fx=3655.5, serial="a1b2c3d4e5f60718")
    put(fleet, FIRST, unit)
    done = printed(capsys, "registry-export-1", "export", "--to", "odm", "--out", tmp_path / "cameras.json")
    assert [one["entry"] for one in done["written"]] == [FIRST.id]
    [left] = done["left_out"]
    assert left["entry"] == unit.id
    assert FIRST.id in left["reason"]


def test_what_a_format_cannot_hold_is_left_out_with_the_reason(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    prism = an_entry(
        model="Prism",
        distortion=ThinPrism(
            k1=0.1, k2=0.0, p1=0.01, p2=0.02, k3=0.0, k4=0.3, k5=0.0, k6=0.0, s1=0.3, s2=0.1, s3=0.2, s4=0.1
        ),
    )
    put(fleet, FIRST, prism)
    code, printed, _ = run(capsys, "export", "--to", "opensfm", "--out", tmp_path / "over.json")
    assert code == 0
    assert f"\n{prism.id}  the thin-prism model has no exact counterpart" in printed
    assert "max" in printed
    assert [item.camera.model for item in parsers.read(tmp_path / "over.json")] != []


def test_a_format_of_one_camera_becomes_a_folder(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, FIRST, SECOND, FISHEYE)
    out = tmp_path / "agisoft"
    done = printed(capsys, "registry-export-1", "export", "--to", "agisoft_xml", "--out", out)
    files = {one["entry"]: one["file"] for one in done["written"]}
    assert sorted(files.values()) == sorted(file.name for file in out.iterdir())
    for entry in (FIRST, SECOND):
        [read] = parsers.read(out / files[entry.id])
        assert read.intrinsics == entry.calibration.intrinsics


def test_ros_finds_each_camera_by_the_name_that_its_file_has(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    unit = an_entry(serial="a1b2c3d4e5f60718", label="P4R-03", fx=3655.5)
    put(fleet, FIRST, unit, SECOND)
    out = tmp_path / "camera_info"
    done = printed(capsys, "registry-export-1", "export", "--to", "ros_camera_info", "--out", out)
    files = {one["entry"]: out / one["file"] for one in done["written"]}
    assert files[unit.id].name == "P4R_03.yaml"
    assert files[FIRST.id].name == "dji_fc6310r_5472x3648_f8_8.yaml"
    for path in files.values():
        document = yaml.safe_load(path.read_text())
        # camera_info_manager: file://.../${NAME}.yaml, NAME of letters, digits and _, and the same in the file.
        assert document["camera_name"] == path.stem
        assert path.stem.replace("_", "").isalnum()
    assert yaml.safe_load(files[unit.id].read_text())["camera_matrix"]["data"][0] == 3655.5


def test_the_table_holds_every_digit(fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    put(fleet, FIRST, an_entry(model="=cmd|'/c calc'!A1", fx=1000.0 / 3, size=(400, 300)))
    assert run(capsys, "export", "--to", "csv", "--out", tmp_path / "fleet.csv")[0] == 0
    rows = [*csv.DictReader((tmp_path / "fleet.csv").read_text().splitlines())]
    assert {float(row["fx"]) for row in rows} == {3661.25, 1000.0 / 3}
    assert {row["pixel_origin"] for row in rows} == {"corner"}
    assert not any(row["model"].startswith("=") for row in rows)


def test_one_yaml_is_the_entries_own_files(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, FIRST, SECOND)
    assert run(capsys, "export", "--to", "yaml", "--out", tmp_path / "fleet.yaml")[0] == 0
    text = (tmp_path / "fleet.yaml").read_text()
    assert len([*yaml.safe_load_all(text)]) == 2
    read = [parse_entry(part.encode(), "part") for part in text.split("---\n")[1:]]
    assert sorted(entry.id for entry in read) == sorted([FIRST.id, SECOND.id])


def test_status_and_revision_choose(fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first = put(fleet, FIRST)
    put(fleet, an_entry(fx=3700.0, distortion=NoDistortion()), DRAFT)
    out = tmp_path / "fleet.csv"
    run(capsys, "export", "--to", "csv", "--out", out, "--at", first)
    assert "3661.25" in out.read_text()
    run(capsys, "export", "--to", "csv", "--out", out, "--status", "draft")
    assert [row["status"] for row in csv.DictReader(out.read_text().splitlines())] == ["draft"]


@pytest.mark.parametrize(
    ("form", "out", "expected"),
    [
        ("no_such_format", "x.txt", "no_such_format"),
        ("csv", "taken/x.csv", "taken"),
        ("csv", ".", "is a folder"),
        ("colmap_database", "x.db", "read but not written"),
    ],
)
def test_what_cannot_be_done_is_one_line(
    fleet: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    form: str,
    out: str,
    expected: str,
) -> None:
    put(fleet, FIRST)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken").write_text("a file, where a folder would have to be")
    code, _, said = run(capsys, "export", "--to", form, "--out", out)
    assert (code, said.count("\n")) == (3, 1)
    assert expected in said


def test_a_registry_with_nothing_to_use_says_so(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, DRAFT)
    code, _, err = run(capsys, "export", "--to", "csv", "--out", tmp_path / "x.csv")
    assert (code, "no entry to export" in err) == (3, True)


@pytest.mark.parametrize(
    ("words", "printed"),
    [
        (("--to", "nothing", "--out", "x.json"), "no format 'nothing'"),
        (("--to", "kalibr_results", "--out", "x.txt"), "read but not written"),
        (("--to", "csv", "--out", "."), "is a folder"),
        (("--to", "agisoft_xml", "--out", "file.txt"), "is a file"),
        (("--to", "agisoft_xml", "--out", "file.txt/agisoft"), "is a file"),
        (("--to", "csv", "--out", "file.txt/fleet.csv"), "is a file"),
    ],
)
def test_what_cannot_be_written_is_refused_before_an_entry_is_read(
    fleet: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    words: tuple[str, ...],
    printed: str,
) -> None:
    put(fleet, FIRST)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file.txt").write_text("")
    monkeypatch.setattr(Snapshot, "entries", lambda *_: pytest.fail("an entry was read"))
    code, _, errors = run(capsys, "export", *words)
    assert code != 0
    assert printed in errors


@pytest.mark.usefixtures("fleet")
@pytest.mark.parametrize(
    "words",
    [
        ("--to", "odm", "--max-error-px", "-1"),
        ("fc6310r",),
    ],
)
def test_arguments_that_do_not_go_together_are_a_usage_error(
    words: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        run(capsys, "export", "--out", "x.json", *words)
    assert ended.value.code == 2
