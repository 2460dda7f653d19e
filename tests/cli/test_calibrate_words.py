"""``calibrary calibrate board`` and ``synth``: files that others read, and nothing written over."""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from calibrary import parsers
from calibrary.cli.main import main
from calibrary.parsers.images import image_evidence

BOARD = ["--board", "checkerboard:9x6", "--square-mm", "40"]


SMALL = ["--camera", "Mavic 3 Thermal and Matrice 3TD, thermal"]
"""640×512 px."""


def synth(out: Path, *flags: str) -> int:
    return main(["calibrate", "synth", str(out), *BOARD, "--frames", "2", *flags])


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("synth") / "frames"
    assert synth(out, "--seed", "3", "--camera", "RedEdge-M") == 0
    return out


def test_frames_and_truth_are_written(frames: Path) -> None:
    truth = json.loads((frames / "truth.json").read_text(encoding="utf-8"))
    names = sorted(path.name for path in frames.iterdir())
    assert names == ["board_0001.jpg", "board_0002.jpg", "truth.json"]
    for frame in truth["frames"]:
        assert hashlib.sha256((frames / frame["name"]).read_bytes()).hexdigest() == frame["sha256"]
    assert truth["board"] == {
        "name": "checkerboard:9x6",
        "square_mm": 40.0,
        "dictionary": None,
        "marker_mm": None,
    }
    assert truth["seed"] == 3


def test_the_truth_is_that_of_the_pixels(frames: Path) -> None:
    """OpenCV projects the truth's poses with its K and finds the corners where the frames show them."""
    truth = json.loads((frames / "truth.json").read_text(encoding="utf-8"))
    K, d = np.array(truth["calibration"]["K"]), truth["calibration"]["distortion"]
    K[:2, 2] -= 0.5
    coefficients = np.array([d[name] for name in ("k1", "k2", "p1", "p2", "k3")])
    board = np.array([[40.0 * x, 40.0 * y, 0.0] for y in range(6) for x in range(9)])
    for frame in truth["frames"]:
        pose = frame["pose"]
        expected, _ = cv2.projectPoints(
            board, np.array(pose["rotation"]), np.array(pose["translation_mm"]), K, coefficients
        )
        expected = expected.reshape(-1, 2)
        np.testing.assert_allclose(np.array(frame["corners"]) - 0.5, expected, atol=1e-6)
        picture = cv2.imread(str(frames / frame["name"]), cv2.IMREAD_GRAYSCALE)
        assert picture is not None
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
        start = expected.astype(np.float32).reshape(-1, 1, 2)
        found = cv2.cornerSubPix(picture, start, (6, 6), (-1, -1), criteria).reshape(-1, 2)
        assert (found - expected).std() < 0.05


def test_our_own_reader_and_catalogue_know_the_camera(frames: Path) -> None:
    truth = json.loads((frames / "truth.json").read_text(encoding="utf-8"))
    evidence = image_evidence(frames / "board_0001.jpg")
    [calibration] = parsers.read(frames / "board_0001.jpg")
    assert calibration.camera.model == "RedEdge-M"
    assert calibration.intrinsics.image_size == (1280, 960)
    assert calibration.intrinsics.fx == pytest.approx(truth["calibration"]["intrinsics"]["fx"], rel=0.02)
    assert evidence is not None


def test_pillow_reads_the_same_tags(frames: Path) -> None:
    with Image.open(frames / "board_0002.jpg") as picture:
        exif = picture.getexif()
        inner = exif.get_ifd(0x8769)
        assert picture.size == (1280, 960)
    assert (exif[0x010F], exif[0x0110]) == ("MicaSense", "RedEdge-M")
    assert float(inner[0x920A]) == pytest.approx(5.5, abs=0.1)
    assert inner[0x9003] == "2024:05:17 09:30:16"
    assert (inner[0xA002], inner[0xA003]) == (1280, 960)


def test_exiftool_finds_nothing_wrong_with_a_frame(frames: Path) -> None:
    if shutil.which("exiftool") is None:
        pytest.skip("exiftool is not installed; Pillow reads the same tags above")
    done = subprocess.run(
        ["exiftool", "-validate", "-warning", "-a", "-j", "-Model", str(frames / "board_0001.jpg")],
        check=True,
        capture_output=True,
    )
    [said] = json.loads(done.stdout)
    assert said["Model"] == "RedEdge-M"
    assert said["Validate"] == "OK"


def test_the_same_seed_writes_the_same_bytes(tmp_path: Path) -> None:
    for name, seed in (("a", "5"), ("b", "5"), ("c", "6")):
        assert synth(tmp_path / name, "--frames", "1", "--seed", seed, *SMALL) == 0
    a, b, c = ((tmp_path / name / "board_0001.jpg").read_bytes() for name in "abc")
    assert a == b
    assert a != c


def test_a_sub_camera_is_told_by_its_tag(tmp_path: Path) -> None:
    assert synth(tmp_path / "out", "--frames", "1", *SMALL) == 0
    [calibration] = parsers.read(tmp_path / "out" / "board_0001.jpg")
    assert calibration.camera.sub_camera == "thermal"
    assert calibration.intrinsics.image_size == (640, 512)


def test_a_calibration_file_gives_the_camera(tmp_path: Path) -> None:
    yaml = tmp_path / "camera.yml"
    storage = cv2.FileStorage(str(yaml), cv2.FILE_STORAGE_WRITE)
    for name, value in (("image_width", 640), ("image_height", 480)):
        storage.write(name, value)
    storage.write("camera_matrix", np.array([[500.0, 0, 320], [0, 501, 240], [0, 0, 1]]))
    storage.write("distortion_coefficients", np.array([[-0.1, 0.02, 0.0, 0.0, 0.0]]))
    storage.release()
    assert synth(tmp_path / "out", "--frames", "1", "--calibration", str(yaml)) == 0
    truth = json.loads((tmp_path / "out" / "truth.json").read_text(encoding="utf-8"))
    assert truth["calibration"]["intrinsics"]["fx"] == 500.0
    assert truth["calibration"]["intrinsics"]["cx"] == 320.5


def test_a_folder_with_anything_in_it_is_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "precious.txt").write_text("mine")
    assert synth(tmp_path) == 3
    assert "is not empty" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["precious.txt"]


def test_the_folder_one_stands_in_can_be_filled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert synth(Path(), "--frames", "1", *SMALL) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["board_0001.jpg", "truth.json"]


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert synth(tmp_path / "file" / "out", "--frames", "1", *SMALL) == 3
    assert "cannot be" in capsys.readouterr().err


def test_an_empty_folder_is_filled_and_a_failure_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    out.mkdir()

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("calibrary.calib.synthesis.files._document", interrupt)
    assert synth(out, "--frames", "1", *SMALL) == 130
    assert list(tmp_path.iterdir()) == [out]
    assert list(out.iterdir()) == []
    out.rmdir()
    assert synth(out, "--frames", "1", *SMALL) == 130
    assert list(tmp_path.iterdir()) == []
    monkeypatch.undo()
    assert synth(out, "--frames", "1", *SMALL) == 0
    assert len(list(out.iterdir())) == 2


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (["--camera", "no such thing"], "none like it"),
        (["--camera", "M3T"], "Mavic 3 Enterprise and Mavic 3 Thermal, tele; Mavic 3 Thermal, wide"),
        (["--calibration", "nowhere.yml"], "nowhere.yml"),
        (["--board", "checkerboard:1x9"], "2 to 200"),
        (["--board", "chess"], "PATTERN:COLUMNSxROWS"),
    ],
)
def test_what_cannot_be_done_is_said_and_nothing_is_written(
    flags: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert synth(tmp_path / "out", *flags) == 3
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "argv",
    [
        ["calibrate", "synth"],
        ["calibrate", "synth", "out", *BOARD, "--frames", "0"],
        ["calibrate", "synth", "out", *BOARD, "--square-mm", "nan"],
        ["calibrate", "synth", "out", *BOARD, "--camera", "FC6310", "--calibration", "x.yml"],
        ["calibrate", "board", "checkerboard:9x6", "--out", "x.pdf"],
    ],
)
def test_usage_errors_exit_with_2(argv: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(argv)
    assert ended.value.code == 2


@pytest.mark.parametrize("word", ["board", "synth"])
def test_each_word_has_help_of_its_own_with_examples_that_are_understood(
    word: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["calibrate", word, "--help"])
    assert ended.value.code == 0
    text = capsys.readouterr().out
    assert f"usage: calibrary calibrate {word}" in text
    assert f"calibrary calibrate {word} " in text.partition("examples:")[2]


@pytest.mark.parametrize("name", ["board.pdf", "board.SVG"])
def test_a_board_is_written_whole(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / name
    assert main(["calibrate", "board", "checkerboard:11x8", "--square-mm", "40", "--out", str(out)]) == 0
    assert out.read_bytes().startswith(b"%PDF-" if name.endswith("pdf") else b"<?xml")
    assert "594×420 mm" in capsys.readouterr().out


def test_a_board_goes_into_no_other_kind_of_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "board.png"
    assert main(["calibrate", "board", "checkerboard:11x8", "--square-mm", "40", "--out", str(out)]) == 3
    assert ".pdf or .svg" in capsys.readouterr().err
    assert not out.exists()
