"""What a run leaves behind: names, matrices, seeds, the report, and nothing half-written."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibrary.atomic import write_files
from calibrary.calibration import CameraKey
from calibrary.errors import InputError
from calibrary.jobs.extract import Program
from calibrary.jobs.extract.extraction import slugs
from calibrary.jobs.extract.report import ExtractReport, Outputs
from calibrary.schemas import require
from tests.jobs.extract.fleet import DEWARP, NOBODY, P4R, PLANE, gate, matrix, picture, plan


def planned(
    folder: Path, outcome: ExtractReport, name: str = "K_matrix.npy", solver: Program | None = None
) -> Outputs:
    return plan(outcome, folder / name, solver).outputs


def names(outputs: Outputs) -> list[str]:
    return sorted(path.name for path in outputs.files)


def loaded(outputs: Outputs, name: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    [content] = [content for path, content in outputs.files.items() if path.name == name]
    header = content.index(b"\n") + 1
    assert content.startswith(b"\x93NUMPY")
    return np.frombuffer(content[header:], dtype=np.float64).reshape(3, 3)


@pytest.fixture
def mixed(tmp_path: Path) -> ExtractReport:
    """Valid, unproven, rejected with numbers, rejected without, a stand-in, and a corrupt file."""
    flight = tmp_path / "flight"
    picture(flight / "valid.jpg", **P4R, dewarp=DEWARP, focal_35mm=24, body_serial="SECRET-4711")
    picture(flight / "unproven.jpg", **NOBODY)
    picture(
        flight / "implausible.jpg", make="Example", model="Far", focal_mm=(600, 10), focal_35mm=24, **PLANE
    )
    picture(flight / "stripped.jpg")
    picture(flight / "stand-in.jpg", (4000, 3000), make="DJI", model="FC330", focal_mm=(0, 0), focal_35mm=20)
    (flight / "corrupt.jpg").write_bytes(b"\xff\xd8\xff")
    given = matrix(tmp_path / "fc330.npy", 2290.0, 2000.0, 1500.0)
    return gate(flight, fallback_k=given)


class TestTheNames:
    def test_one_camera_has_the_name_that_was_given(self, tmp_path: Path) -> None:
        picture(tmp_path / "flight/a.jpg", **P4R)
        outcome = gate(tmp_path / "flight")
        assert names(planned(tmp_path, outcome)) == ["K_matrix.json", "K_matrix.npy"]
        assert names(planned(tmp_path, outcome, "unit.7.npy")) == ["unit.7.json", "unit.7.npy"]

    def test_several_cameras_have_their_own_in_it(self, tmp_path: Path, mixed: ExtractReport) -> None:
        assert names(planned(tmp_path, mixed)) == [
            "K_matrix.dji-fc330-4000x3000.npy",
            "K_matrix.dji-fc6310r-5472x3648.npy",
            "K_matrix.json",
            "K_matrix_seed.example-far-5472x3648.npy",
            "K_matrix_seed.unknown-camera-5472x3648.npy",
            "K_matrix_unproven.example-one-5472x3648.npy",
        ]

    def test_they_lie_where_the_matrix_lies(self, tmp_path: Path, mixed: ExtractReport) -> None:
        (tmp_path / "day 3").mkdir()
        outputs = planned(tmp_path, mixed, "day 3/K.npy")
        assert {path.parent for path in outputs.files} == {tmp_path / "day 3"}

    def test_a_name_that_is_no_npy_is_refused(self, tmp_path: Path, mixed: ExtractReport) -> None:
        with pytest.raises(InputError, match=r"\.npy"):
            planned(tmp_path, mixed, "K_matrix.json")

    def test_an_earlier_runs_matrix_that_is_not_replaced_is_told(
        self, tmp_path: Path, mixed: ExtractReport
    ) -> None:
        matrix(tmp_path / "K_matrix.npy", 1.0)
        matrix(tmp_path / "K_matrix.unknown-camera-5472x3648.npy", 1.0)
        outputs = planned(tmp_path, mixed)
        names = ("K_matrix.npy", "K_matrix.unknown-camera-5472x3648.npy")
        assert {path.name for path in outputs.stale} == {*names}
        told = json.loads(outputs.files[tmp_path / "K_matrix.json"])["warnings"]
        assert told[-1] == f"{', '.join(names)} are left from an earlier run; remove them"


class TestTheSlugs:
    @pytest.mark.parametrize(
        "model", ["../../etc/passwd", "a/b\\c", "CON:", "x" * 300, "Müller №5", "..", "$(reboot)", "a\nb"]
    )
    def test_any_model_is_a_safe_file_name(self, model: str) -> None:
        [slug] = slugs([CameraKey(make="Example", model=model, image_size=(640, 512))]).values()
        assert len(slug) <= 100
        assert set(slug) <= set("abcdefghijklmnopqrstuvwxyz0123456789.-")
        assert not slug.startswith((".", "-"))

    def test_only_what_tells_two_cameras_apart_is_in_it(self) -> None:
        short = CameraKey(make="DJI", model="M30T", lens="tele", focal_mm=21.4, serial="0123456789abcdef")
        assert list(slugs([short]).values()) == ["dji-m30t"]
        longer = CameraKey(make="DJI", model="M30T", lens="tele", focal_mm=40.0, serial="0123456789abcdef")
        assert list(slugs([short, longer]).values()) == ["dji-m30t-tele-21.4mm", "dji-m30t-tele-40mm"]

    def test_two_units_are_told_by_the_start_of_their_serials_hashes(self) -> None:
        keys = [CameraKey(make="DJI", model="FC6310R", serial=f"{n}" * 16) for n in (1, 2)]
        assert list(slugs(keys).values()) == ["dji-fc6310r-sn-111111", "dji-fc6310r-sn-222222"]

    def test_names_that_fold_into_one_are_numbered(self) -> None:
        keys = [CameraKey(make="Example", model=model) for model in ("A+", "A-", "a")]
        assert list(slugs(keys).values()) == ["example-a", "example-a-2", "example-a-3"]


class TestTheMatrices:
    def test_they_are_what_the_report_says(self, tmp_path: Path, mixed: ExtractReport) -> None:
        outputs = planned(tmp_path, mixed)
        report = json.loads(outputs.files[tmp_path / "K_matrix.json"])
        written = [c for c in report["cameras"] if c["output"] is not None]
        assert len(written) == 3
        for camera in written:
            assert loaded(outputs, camera["output"]).tolist() == camera["calibration"]["K"]

    def test_distortion_never_gets_into_them(self, tmp_path: Path, mixed: ExtractReport) -> None:
        K = loaded(planned(tmp_path, mixed), "K_matrix.dji-fc6310r-5472x3648.npy")
        assert K.tolist() == [[3660.5, 0.0, 2731.5], [0.0, 3655.25, 1846.75], [0.0, 0.0, 1.0]]

    def test_a_seed_is_never_in_one(self, tmp_path: Path, mixed: ExtractReport) -> None:
        outputs = planned(tmp_path, mixed)
        seeds = {
            # What the 35 mm equivalent gives, over a diagonal of 43.27 mm; 0.8 W of a camera of which nothing is known.
            "K_matrix_seed.example-far-5472x3648.npy": 24 / 36 * 5472,
            "K_matrix_seed.unknown-camera-5472x3648.npy": 0.8 * 5472,
        }
        fx = {name: float(loaded(outputs, name)[0, 0]) for name in names(outputs) if name.endswith(".npy")}
        assert {name: fx[name] for name in fx if "seed" in name} == pytest.approx(seeds)
        assert not {round(fx[name]) for name in fx if "seed" not in name} & set(map(round, seeds.values()))

    def test_one_camera_without_a_k_leaves_a_seed_and_no_k(self, tmp_path: Path) -> None:
        picture(tmp_path / "flight/a.jpg")
        outputs = planned(tmp_path, gate(tmp_path / "flight"))
        assert names(outputs) == ["K_matrix.json", "K_matrix_seed.npy"]


class TestTheReport:
    @pytest.fixture
    def report(self, tmp_path: Path, mixed: ExtractReport) -> dict[str, Any]:
        text = planned(tmp_path, mixed).files[tmp_path / "K_matrix.json"].decode()
        document: dict[str, Any] = json.loads(text)
        return document

    @pytest.fixture
    def cameras(self, report: dict[str, Any]) -> dict[str, Any]:
        return {camera["images"][0].removesuffix(".jpg"): camera for camera in report["cameras"]}

    def test_it_holds_to_its_schema(self, report: dict[str, Any]) -> None:
        require(report, "report-1")

    def test_every_verdict_is_in_it(self, cameras: dict[str, Any]) -> None:
        assert {name: camera["verdict"] for name, camera in cameras.items()} == {
            "valid": "valid",
            "unproven": "unproven",
            "implausible": "rejected",
            "stripped": "rejected",
            "stand-in": "valid",
        }

    def test_a_rejected_camera_has_no_k_anywhere(self, cameras: dict[str, Any]) -> None:
        for name in ("implausible", "stripped"):
            assert list(cameras[name]["calibration"]) == ["camera"]
            assert cameras[name]["output"] is None
            assert '"K"' not in json.dumps(cameras[name])

    def test_the_numbers_that_failed_are_kept_apart(self, cameras: dict[str, Any]) -> None:
        candidate = cameras["implausible"]["rejected_candidate"]
        assert candidate["intrinsics"]["fx"] == pytest.approx(60 * 300)
        assert cameras["stripped"]["rejected_candidate"] is None
        assert cameras["valid"]["rejected_candidate"] is None

    def test_every_camera_that_is_not_valid_says_why_and_what_to_do(self, cameras: dict[str, Any]) -> None:
        for camera in cameras.values():
            assert (camera["what_to_do"] is None) is (camera["verdict"] == "valid")
            assert (camera["why"] is not None) is (camera["verdict"] != "valid" or camera["fallback"] != [])

    def test_a_seed_carries_its_mark_and_its_command(self, cameras: dict[str, Any]) -> None:
        seed = cameras["stripped"]["seed"]
        assert seed["grade"] == "seed"
        assert "no K" in seed["note"]
        assert "4377.6,4377.6,2736.0,1824.0" in seed["colmap"]
        assert cameras["valid"]["seed"] is None

    def test_exactly_one_source_is_the_chosen_one(self, cameras: dict[str, Any]) -> None:
        estimates, tag = cameras["valid"]["sources"], cameras["valid"]["calibration"]["provenance"]["tag"]
        assert [w["source"] for w in estimates if w["tag"] == tag] == ["dji-dewarp"]
        assert {w["grade"] for w in estimates} == {"calibrated", "derived", "prior"}

    def test_images_are_counted_with_those_set_aside(self, report: dict[str, Any]) -> None:
        assert report["images"] == 6
        assert [row["file"] for row in report["rejected"]] == ["corrupt.jpg"]
        assert (report["policy"], report["exit_code"], report["uncalibrated"]) == ("fleet", 1, True)

    def test_no_serial_number_is_in_it(self, report: dict[str, Any], cameras: dict[str, Any]) -> None:
        assert "4711" not in json.dumps(report)
        assert len(cameras["valid"]["calibration"]["camera"]["serial"]) == 16


class TestWriting:
    def test_everything_is_written_whole(self, tmp_path: Path) -> None:
        (tmp_path / "b").write_bytes(b"old")
        write_files({tmp_path / "a": b"new a", tmp_path / "b": b"new b"})
        assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {"a": b"new a", "b": b"new b"}

    def test_a_new_file_has_the_rights_of_any_other(self, tmp_path: Path) -> None:
        (tmp_path / "plain").write_bytes(b"")
        write_files({tmp_path / "a": b""})
        assert (tmp_path / "a").stat().st_mode == (tmp_path / "plain").stat().st_mode

    @pytest.mark.parametrize("where", ["folder", "file/b", "file/missing/b"])
    def test_one_place_that_cannot_be_written_changes_nothing(self, tmp_path: Path, where: str) -> None:
        (tmp_path / "a").write_bytes(b"old")
        (tmp_path / "folder").mkdir()
        (tmp_path / "file").touch()
        before = sorted(p.name for p in tmp_path.rglob("*"))
        with pytest.raises(InputError, match="nothing was written"):
            write_files({tmp_path / "a": b"new", tmp_path / where: b"new"})
        assert (tmp_path / "a").read_bytes() == b"old"
        assert sorted(p.name for p in tmp_path.rglob("*")) == before

    def test_a_full_disk_changes_nothing(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        (tmp_path / "a").write_bytes(b"old")
        synced: list[int] = []

        def fsync(handle: int) -> None:
            synced.append(handle)
            if len(synced) == 2:
                raise OSError(28, "No space left on device")

        monkeypatch.setattr(os, "fsync", fsync)
        with pytest.raises(InputError, match="No space left"):
            write_files({tmp_path / "a": b"new", tmp_path / "b": b"new"})
        assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {"a": b"old"}


def test_units_of_one_model_have_names_of_their_own(tmp_path: Path) -> None:
    for serial in ("0V2LG3H0", "0V2LG3H1"):
        picture(tmp_path / f"{serial}.jpg", **P4R, dewarp=DEWARP, body_serial=serial)
    names = [one.name for one in gate(tmp_path).judged]
    assert len(set(names)) == 2
    assert all(name.startswith("DJI FC6310R 8.8 mm 5472×3648, unit ") for name in names)
