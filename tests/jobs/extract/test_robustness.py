"""What a hostile or merely unlucky folder does to ``calibrary extract``: it is reported, and nothing falls over."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibrary.atomic import write_files
from calibrary.cli.main import main
from calibrary.jobs.images import reading
from calibrary.jobs.images.accumulator import Accumulator
from calibrary.jobs.images.folders import find_files
from calibrary.jobs.images.reading import Unit
from calibrary.schemas import require
from tests.imagery import (
    ExifTags,
    GpsPosition,
    Namespace,
    XmpDescription,
    XmpPacket,
    attributes,
    write_jpeg,
    write_tiff,
)

P4P = (5472, 3648)
DJI = Namespace("drone-dji", "http://www.dji.com/drone-dji/1.0/")
CAMERA = Namespace("Camera", "http://pix4d.com/camera/1.0/")
SEQUOIA = {"ModelType": "fisheye", "FisheyeAffineMatrix": "1657.9,0,0,1657.9", "PrincipalPoint": "2.4,1.8"}

Extract = Callable[..., tuple[int, dict[str, Any], str]]


def packet(namespace: Namespace, **properties: str) -> XmpPacket:
    return XmpPacket(descriptions=(XmpDescription(items=attributes(namespace, **properties)),))


def picture(path: Path, size: tuple[int, int] = P4P, xmp: XmpPacket | None = None, **tags: Any) -> Path:
    known: dict[str, Any] = {
        "make": "DJI",
        "model": "FC6310",
        "focal_mm": (88, 10),
        "focal_35mm": 24,
        "pixel_size": size,
    }
    printed = {name: value for name, value in (known | tags).items() if value is not None}
    return write_jpeg(path, size, exif=ExifTags(**printed), xmp=xmp)


def dewarp(fx: str, *, rest: str = "-0.268,0.112,0.0008,-0.0001,-0.034") -> str:
    return f"2024-01-01;{fx},{fx},-4.5,22.75,{rest}"


def k_of(camera: dict[str, Any]) -> Any:
    return camera["calibration"].get("K")


@pytest.fixture
def extract(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfdbinary: Any) -> Extract:
    """Run ``calibrary extract --json`` on ``im``; returns the exit code, the checked report and stderr."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "im").mkdir()

    def run(*flags: str) -> tuple[int, dict[str, Any], str]:
        code = main(["extract", "--image-dir", "im", "--json", *flags])
        out, err = capfdbinary.readouterr()
        report = json.loads(out) if out else {}
        if report:
            require(report, "report-1", source="report")
        return code, report, err.decode()

    return run


class TestNames:
    def test_one_that_is_no_utf8_stays_itself_in_the_json(self, tmp_path: Path, extract: Extract) -> None:
        name = b"caf\xe9.jpg"
        data = picture(tmp_path / "a.jpg").read_bytes()
        try:
            (tmp_path / "im" / os.fsdecode(name)).write_bytes(data)
        except OSError:
            pytest.skip("this file system has UTF-8 names only")
        code, report, _ = extract()
        assert code == 0
        assert os.fsencode(report["cameras"][0]["images"][0]) == name
        written = (tmp_path / "K_matrix.json").read_bytes()
        assert json.loads(written.decode()) == report

    def test_control_characters_in_one_never_reach_the_terminal(
        self, tmp_path: Path, extract: Extract
    ) -> None:
        (tmp_path / "im" / "a\x1b[31m\nb.jpg").write_bytes(b"no image")
        code, _, err = extract("--strict-validation")
        assert code == 1
        assert err.startswith("calibrary: a\\x1b[31m\\x0ab.jpg: ")
        assert "\x1b" not in err

    def test_a_line_break_in_one_is_refused_where_it_would_make_two_of_it(
        self, tmp_path: Path, extract: Extract
    ) -> None:
        picture(tmp_path / "im" / "a\nb.jpg")
        assert extract()[0] == 0
        code, report, _ = extract("--to", "colmap")
        assert (code, report["exit_code"]) == (1, 1)
        assert "line break" in report["warnings"][-1]
        assert (tmp_path / "K_matrix.npy").exists()
        assert not (tmp_path / "colmap.sh").exists()

    @pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
    def test_json_is_utf8_whatever_the_terminal_speaks(self, tmp_path: Path, encoding: str) -> None:
        picture(tmp_path / "im" / "é.jpg", model="Ünknown")
        ran = subprocess.run(
            [sys.executable, "-m", "calibrary", "extract", "--image-dir", "im", "--json"],
            cwd=tmp_path,
            env={**os.environ, "PYTHONIOENCODING": encoding},
            capture_output=True,
            check=False,
        )
        assert ran.returncode == 1
        assert json.loads(ran.stdout.decode("utf-8"))["cameras"][0]["images"] == ["é.jpg"]


class TestFolders:
    def test_files_come_in_one_order_and_deeper_than_python_calls(self, tmp_path: Path) -> None:
        (tmp_path / "b.jpg").touch()
        (tmp_path / "a").mkdir()
        (tmp_path / "a" / "z.jpg").touch()
        (tmp_path / ".hidden").touch()
        descriptor = os.open(tmp_path / "a", os.O_RDONLY)
        for _ in range(1100):
            os.mkdir("d", dir_fd=descriptor)
            below = os.open("d", os.O_RDONLY, dir_fd=descriptor)
            os.close(descriptor)
            descriptor = below
        os.close(descriptor)
        try:
            found = [path.relative_to(tmp_path).as_posix() for path in find_files(tmp_path, recursive=True)]
        finally:
            subprocess.run(["rm", "-rf", str(tmp_path / "a")], check=True)
        assert found == ["a/z.jpg", "b.jpg"]

    def test_pipes_loops_devices_and_empty_files_are_rows(self, tmp_path: Path, extract: Extract) -> None:
        images = tmp_path / "im"
        picture(images / "good.jpg")
        os.mkfifo(images / "pipe.jpg")
        os.mkfifo(images / "pipe.yml")
        (images / "loop.jpg").symlink_to("loop.jpg")
        (images / "zero.jpg").symlink_to("/dev/zero")
        (images / "folder.jpg").mkdir()
        (images / "empty.jpg").touch()
        (images / "itself").symlink_to(".")
        code, report, _ = extract("--recursive")
        assert code == 1
        assert [camera["verdict"] for camera in report["cameras"]] == ["valid"]
        assert report["cameras"][0]["images"] == ["good.jpg"]
        # A folder is a folder whatever it is called; the others are said to be what they are.
        assert {row["file"] for row in report["rejected"]} == {
            "empty.jpg",
            "loop.jpg",
            "pipe.jpg",
            "zero.jpg",
        }

    def test_several_workers_find_what_one_finds(self, tmp_path: Path, extract: Extract) -> None:
        data = picture(tmp_path / "im" / "0.jpg").read_bytes()[:4096]
        for i in range(150):
            (tmp_path / "im" / f"{i}.jpg").write_bytes(data if i % 50 else b"broken")
        assert extract("--workers", "2") == extract("--workers", "1")

    def test_images_whose_reader_is_killed_twice_are_rows_and_the_rest_is_judged(
        self, tmp_path: Path, extract: Extract, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        for number in range(150):
            picture(tmp_path / "im" / f"{number:03}.jpg", (64, 48))

        def one_is_killed(
            read: reading.Read, units: Iterator[Unit], _workers: int
        ) -> Iterator[tuple[Unit, Accumulator | None]]:
            return ((unit, None if unit.images[0].name == "064.jpg" else read(unit)) for unit in units)

        monkeypatch.setattr(reading, "_mapped", one_is_killed)
        code, report, _ = extract()
        assert (code, report["exit_code"], report["images"]) == (3, 3, 150)
        assert [row["file"] for row in report["rejected"]] == [
            f"{number:03}.jpg" for number in range(64, 128)
        ]
        assert "was killed" in report["rejected"][0]["reason"]
        assert len(report["cameras"][0]["images"]) == 150 - 64
        assert json.loads((tmp_path / "K_matrix.json").read_bytes()) == report

    def test_workers_end_with_the_command_that_started_them(self) -> None:
        """They hold its standard error open, so whoever reads that would wait for as long as they live."""
        work = "list(mapped_on(time.sleep, [60, 60], 2, preload=[]))"
        program = f"import time; from calibrary.workers import mapped_on; {work}"
        command = subprocess.Popen([sys.executable, "-c", program], stderr=subprocess.PIPE)
        time.sleep(1.5)
        assert command.poll() is None
        command.send_signal(signal.SIGKILL)
        command.communicate(timeout=10)


class TestNumbers:
    @pytest.mark.parametrize(
        "properties",
        [
            {"DewarpData": dewarp("1e308")},
            {"DewarpData": dewarp("1e-308")},
            {"DewarpData": dewarp("5e-324")},
            {"DewarpData": dewarp("3660", rest="1e308,-1e308,1e308,1e308,1e308")},
            {"CalibratedFocalLength": "1e308"},
            {
                "CalibratedFocalLength": "3666",
                "CalibratedOpticalCenterX": "1e308",
                "CalibratedOpticalCenterY": "1",
            },
        ],
        ids=str,
    )
    @pytest.mark.parametrize("policy", ["fleet", "source"])
    def test_absurd_ones_in_djis_tags_reach_no_result(
        self, tmp_path: Path, extract: Extract, properties: dict[str, str], policy: str
    ) -> None:
        picture(tmp_path / "im" / "a.jpg", model="Unheard-of", xmp=packet(DJI, **properties))
        code, report, err = extract("--policy", policy)
        assert (code, err) == (1, "")
        assert report["cameras"][0]["verdict"] != "valid"

    def test_an_absurd_fisheye_is_no_error_of_ours(self, tmp_path: Path, extract: Extract) -> None:
        xmp = packet(CAMERA, FisheyeAffineMatrix="1.7e308,0,0,1.7e308")
        picture(tmp_path / "im" / "a.jpg", xmp=xmp)
        code, report, _ = extract()
        assert code == 1
        assert report["cameras"][0]["dropped"][0]["source"] == "camera-fisheye"

    def test_absurd_exif_as_text_is_a_fault_of_its_tag(self, tmp_path: Path, extract: Extract) -> None:
        items = (("EXIF_FocalLength", "(1e308)"), ("EXIF_FocalLengthIn35mmFilm", "1e308"))
        write_tiff(tmp_path / "im" / "a.tif", (640, 480), gdal_metadata=items)
        code, report, _ = extract()
        assert code == 1
        assert report["cameras"][0]["why"].startswith("EXIF FocalLength is 1e+308")


class TestVerdicts:
    def test_a_35_mm_equivalent_of_one_confirms_nothing(self, tmp_path: Path, extract: Extract) -> None:
        """It rounds to ±100 %; some action cameras write it."""
        picture(tmp_path / "im" / "a.jpg", (4000, 3000), make="X", model="Y", focal_mm=(24, 1), focal_35mm=1)
        code, report, _ = extract("--sensor-width-mm", "6.17", "--sensor-height-mm", "4.63")
        assert code == 1
        assert report["cameras"][0]["verdict"] == "unproven"

    def test_an_assumed_sensor_is_no_source_beside_a_real_one(self, tmp_path: Path, extract: Extract) -> None:
        xmp = packet(DJI, DewarpData=dewarp("5000"))
        picture(tmp_path / "im" / "a.jpg", model="Unheard-of", focal_35mm=None, xmp=xmp)
        code, report, _ = extract()
        [camera] = report["cameras"]
        assert [estimate["source"] for estimate in camera["sources"]] == ["dji-dewarp"]
        assert (code, camera["verdict"]) == (1, "unproven")
        assert "drone-dji:DewarpData alone" in camera["why"]

    def test_a_bare_k_is_no_k_of_a_fisheye(self, tmp_path: Path, extract: Extract) -> None:
        xmp = packet(CAMERA, BandName="Green", **SEQUOIA)
        tags: dict[str, Any] = {"make": "Parrot", "model": "Sequoia", "focal_mm": (398, 100)}
        picture(tmp_path / "im" / "a.jpg", (1280, 960), xmp=xmp, focal_35mm=None, **tags)
        np.save(tmp_path / "k.npy", np.array([[1055.0, 0, 640], [0, 1055, 480], [0, 0, 1]]))
        code, report, _ = extract("--fallback-k", "k.npy")
        [camera] = report["cameras"]
        assert (code, camera["verdict"], k_of(camera)) == (1, "rejected", None)
        assert camera["fallback"][0]["outcome"] == "refused"

    def test_a_leaked_equivalent_is_what_the_pilot_reads_first(
        self, tmp_path: Path, extract: Extract
    ) -> None:
        picture(tmp_path / "im" / "a.jpg", focal_mm=(24, 1))
        _, report, _ = extract()
        assert "35 mm equivalent" in report["cameras"][0]["why"]

    def test_k_follows_an_image_that_is_turned_by_90_degrees(self, tmp_path: Path, extract: Extract) -> None:
        picture(tmp_path / "im" / "a.jpg", (3648, 5472))
        code, report, _ = extract()
        [camera] = report["cameras"]
        assert (code, camera["verdict"]) == (0, "valid")
        K = camera["calibration"]["intrinsics"]
        assert K["image_size"] == [3648, 5472]
        assert K["fx"] == pytest.approx(8.8 / 0.0024)

    def test_a_wide_crop_of_an_unknown_camera_is_the_cause_that_is_named(
        self, tmp_path: Path, extract: Extract
    ) -> None:
        tags: dict[str, Any] = {"model": "Unheard-of", "focal_mm": (361, 100), "focal_35mm": 20}
        picture(tmp_path / "im" / "a.jpg", (4000, 2250), **tags)
        _, report, _ = extract("--sensor-width-mm", "6.17")
        findings = report["cameras"][0]["findings"]
        assert any("cropped" in one["message"] for one in findings if one["rule"] == "contradicted")

    def test_a_stripped_file_does_not_make_the_given_sensor_useless(
        self, tmp_path: Path, extract: Extract
    ) -> None:
        picture(tmp_path / "im" / "a.jpg", model="Unheard-of", focal_mm=(12, 1), focal_35mm=None)
        write_jpeg(tmp_path / "im" / "b.jpg", (640, 480))
        _, report, _ = extract("--sensor-width-mm", "13.2", "--sensor-height-mm", "8.8")
        assert report["warnings"] == []
        assert k_of(report["cameras"][0])[0][0] == pytest.approx(12 / 13.2 * 5472)


class TestFallbacks:
    def test_a_hand_off_of_an_earlier_run_is_no_calibration(self, tmp_path: Path, extract: Extract) -> None:
        picture(tmp_path / "im" / "a.jpg")
        assert extract("--to", "opencv", "--output-matrix", "im/K_matrix.npy")[0] == 0
        write_jpeg(tmp_path / "im" / "a.jpg", P4P)
        code, report, _ = extract()
        [camera] = report["cameras"]
        assert (code, k_of(camera)) == (1, None)
        step = camera["fallback"][1]
        assert (step["step"], step["outcome"]) == ("calibration-file", "refused")

    def test_a_step_is_taken_only_when_its_k_is_used(self, tmp_path: Path, extract: Extract) -> None:
        """An unproven K does not yield to one that is no better."""
        picture(tmp_path / "im" / "a.jpg", model="Unheard-of", focal_mm=(15, 1), focal_35mm=None)
        np.save(tmp_path / "k.npy", np.array([[5000.0, 0, 2736], [0, 4800, 1824], [0, 0, 1]]))
        code, report, _ = extract("--fallback-k", "k.npy")
        [camera] = report["cameras"]
        assert (code, camera["verdict"]) == (1, "unproven")
        assert [step["outcome"] for step in camera["fallback"] if step["outcome"] == "taken"] == []


class TestOutputs:
    def test_what_an_earlier_run_left_for_the_solver_is_pointed_out(
        self, tmp_path: Path, extract: Extract
    ) -> None:
        picture(tmp_path / "im" / "a.jpg")
        code, report, _ = extract("--to", "colmap")
        assert (code, report["warnings"]) == (0, [])
        picture(tmp_path / "im" / "a.jpg", focal_mm=(24, 1))
        code, report, _ = extract("--to", "colmap")
        assert code == 1
        assert report["warnings"] == ["K_matrix.npy, colmap.sh are left from an earlier run; remove them"]
        assert report["hand_off"]["cameras"][0]["into"] is None

    def test_a_place_that_is_none_is_told_before_anything_is_read(
        self, tmp_path: Path, extract: Extract
    ) -> None:
        picture(tmp_path / "im" / "a.jpg")
        code, _, err = extract("--output-matrix", "/dev/null/K.npy")
        assert code == 3
        assert "is a file; expected a folder" in err
        assert extract("--output-matrix", "K.txt")[0] == 3

    def test_the_report_never_takes_the_place_of_a_solvers_file(
        self, tmp_path: Path, extract: Extract
    ) -> None:
        picture(tmp_path / "im" / "a.jpg")
        code, _, err = extract("--to", "odm", "--output-matrix", "cameras.npy")
        assert code == 3
        assert "cameras.json" in err
        assert not (tmp_path / "cameras.npy").exists()

    def test_a_folder_in_the_place_of_one_file_keeps_all_from_being_written(
        self, tmp_path: Path, extract: Extract
    ) -> None:
        picture(tmp_path / "im" / "a.jpg")
        (tmp_path / "K_matrix.json").mkdir()
        assert extract()[0] == 3
        assert sorted(path.name for path in tmp_path.iterdir()) == ["K_matrix.json", "im"]

    def test_an_interruption_leaves_nothing_behind(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def interrupted(_: int) -> None:
            if len(list(tmp_path.iterdir())) == 2:
                raise KeyboardInterrupt

        monkeypatch.setattr(os, "fsync", interrupted)
        with pytest.raises(KeyboardInterrupt):
            write_files({tmp_path / "a": b"1", tmp_path / "b": b"2"})
        assert list(tmp_path.iterdir()) == []

    def test_nothing_private_is_in_any_of_them(self, tmp_path: Path, extract: Extract) -> None:
        private = {
            "NTRIPHost": "caster.example",
            "CameraSerialNumber": "CAM-11223",
            "GpsLatitude": "47.12345",
        }
        picture(
            tmp_path / "im" / "a.jpg",
            model="FC6310R",
            body_serial="BODY-99887",
            position=GpsPosition(latitude_deg=47.12345, longitude_deg=8.54321, altitude_m=512.0),
            xmp=packet(DJI, DewarpData=dewarp("3660"), **private),
        )
        for solver in ("colmap", "opensfm", "odm", "opencv"):
            code, report, err = extract("--to", solver)
            files = "".join(path.read_text(errors="replace") for path in tmp_path.iterdir() if path.is_file())
            printed = files + json.dumps(report) + err
            assert code == 0
            for secret in ("caster", "11223", "99887", "47.12", "8.54"):
                assert secret not in printed
