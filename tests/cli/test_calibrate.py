"""``calibrary calibrate FRAMES``: what it finds, and what it writes for which verdict."""

from __future__ import annotations

import datetime as dt
import hashlib
import json
import re
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any, get_args

import cv2
import numpy as np
import pytest

from calibrary import parsers
from calibrary.arguments import LensModel
from calibrary.calib.corners_file import read_corners, write_corners
from calibrary.calib.lens_models import Solvable
from calibrary.cli.main import main
from calibrary.records import replace
from calibrary.registry.entry import VERDICT_BLOCK, Status
from calibrary.registry.paths import slug
from calibrary.registry.registry import Registry
from calibrary.schemas import require
from tests.calib.photographs import CAMERA, SIZE
from tests.calib.solving import camera
from tests.cli.calibrating import BOARD, Run, calibrated, fleet, the_entry
from tests.cli.desk import printed
from tests.imagery import write_jpeg
from tests.jobs.calibrate.boards import (
    FIRMWARE,
    MAKE,
    MODEL,
    PROVISIONAL,
    REFUSED,
    corners,
    exif,
    frames,
)
from tests.registry.git.repositories import nobodys_git

__all__ = ["calibrated", "fleet", "nobodys_git"]

COUNT = 9


@pytest.fixture(scope="session")
def photographed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Frames of 1280×960 px under a camera whose truth lies beside them, as ``synth`` writes them."""
    out = tmp_path_factory.mktemp("board") / "frames"
    flags = ("--frames", str(COUNT), "--seed", "4", "--camera", "RedEdge-M")
    assert main(["calibrate", "synth", str(out), *BOARD, *flags]) == 0
    return out


@pytest.fixture(scope="module")
def told(photographed: Path) -> str:
    """What the command prints of those frames with --json."""
    return printed(shlex.join(["calibrate", str(photographed), *BOARD, "--json"])).out


def truth_of(folder: Path) -> Mapping[str, Any]:
    document: Mapping[str, Any] = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    return document


def test_frames_lead_to_the_camera_that_took_them(calibrated: Run, photographed: Path) -> None:
    code, out, err = calibrated(photographed, *BOARD, "--json")
    document = json.loads(out)
    require(document, "calibration-result-3")
    K, true = document["calibration"]["intrinsics"], truth_of(photographed)["calibration"]["intrinsics"]
    assert abs(K["fx"] / true["fx"] - 1) < 6e-4
    quality = document["calibration"]["quality"]
    assert abs(K["cx"] - true["cx"]) < min(1.2, 3 * quality["std"]["cx"] * max(1.0, quality["kappa2"]) ** 0.5)
    assert abs(K["cy"] - true["cy"]) < 0.8
    assert document["calibration"]["camera"]["model"] == "RedEdge-M"
    # Nine views are too few to keep K fixed, whatever they show.
    assert code == 1
    assert document["verdict"] == "start"
    assert "few-views" in [finding["rule"] for finding in document["findings"]]
    assert err == ""


def test_a_person_sees_verdict_parameters_and_the_views_that_fit_worst(
    calibrated: Run, photographed: Path
) -> None:
    code, out, err = calibrated(photographed, *BOARD, "--correlations")
    assert code == 1
    assert err == ""
    assert out.splitlines()[-1].startswith("START")
    for name in (
        "few-views",
        "fx",
        "k1",
        "σ",
        "correlations",
        "variance factor",
        "board warp",
        "coverage",
        "criterion",
    ):
        assert name in out
    assert re.search(r"largest errors +board_00\d\d\.jpg 0\.\d", out)


@pytest.mark.thorough
def test_the_board_is_found_by_trying_where_nobody_names_it(
    calibrated: Run, photographed: Path, told: str
) -> None:
    by_name = json.loads(told)
    _, out, _ = calibrated(f"{photographed}/*.jpg", "--square-mm", "40", "--json")
    tried = json.loads(out)
    assert tried["calibration"]["provenance"]["sha256"] == by_name["calibration"]["provenance"]["sha256"]


@pytest.mark.parametrize(
    ("flags", "date", "origin"),
    [
        ((), "2019-05-18", "from the images' EXIF, the last day of 2019-05-17 to 2019-05-18"),
        (("--date", "2019-06-01"), "2019-06-01", "as stated"),
    ],
)
def test_the_date_is_that_of_the_frames_or_the_stated_one(
    calibrated: Run, tmp_path: Path, flags: tuple[str, ...], date: str, origin: str
) -> None:
    frames(tmp_path / "set", 3, exif(date_time="2019:05:17 23:59:59"))
    frames(tmp_path / "set", 3, exif(date_time="2019:05:18 00:10:00"), first=3)
    _, out, _ = calibrated("set", *BOARD, *flags, "--json", "--operator", "Ada")
    document = json.loads(out)
    made = document["calibration"]["provenance"]
    assert (made["date"], made["operator"], document["date_origin"]) == (date, "Ada", origin)
    assert made["tool"].startswith("calibrary ")


def test_saved_corners_keep_the_date_of_their_frames(calibrated: Run, tmp_path: Path) -> None:
    kept = corners(tmp_path / "c.json")
    day = dt.date(2019, 5, 17)
    write_corners(replace(read_corners(kept), taken=(day, day)), kept)
    made = json.loads(calibrated("--from", kept, "--json")[1])["calibration"]["provenance"]
    assert (made["date"], made["operator"]) == ("2019-05-17", None)


def test_a_model_names_the_camera_and_a_lens_model_its_distortion(calibrated: Run, tmp_path: Path) -> None:
    kept = corners(tmp_path / "c.json")
    _, out, _ = calibrated("--from", kept, "--model", "brown", "--lens-model", "k1k2", "--json")
    document = json.loads(out)
    assert (document["calibration"]["camera"]["model"], document["model"]) == ("brown", "k1k2")


@pytest.mark.thorough
def test_corners_that_were_kept_give_the_same_numbers_again(calibrated: Run, photographed: Path) -> None:
    threads = cv2.getNumThreads()
    try:
        # OpenCV's own start depends on how its threads share the sums: 1e-11 of the focal length.
        cv2.setNumThreads(1)
        _, first, _ = calibrated(photographed, *BOARD, "--corners", "corners.json", "--json")
        _, second, _ = calibrated("--from", "corners.json", "--json")
        assert first == second
    finally:
        cv2.setNumThreads(threads)
    _, third, _ = calibrated("--from", "corners.json", "--json")
    K, again = (json.loads(text)["calibration"]["intrinsics"] for text in (first, third))
    assert [again[name] for name in ("fx", "fy", "cx", "cy")] == pytest.approx(
        [K[name] for name in ("fx", "fy", "cx", "cy")], rel=1e-9
    )


def test_the_page_holds_everything_and_fetches_nothing(
    calibrated: Run, photographed: Path, tmp_path: Path
) -> None:
    calibrated(photographed, *BOARD, "--html", "camera.html")
    page = (tmp_path / "camera.html").read_text(encoding="utf-8")
    assert len(page) < 2_000_000
    assert not re.search(r'(?:src|href)="(?!#|data:)', page)
    for heading in (
        "Verdict",
        "Parameters",
        "How the board was held",
        "How far to trust it",
        "Corners on frames",
    ):
        assert f">{heading}" in page
    # Bars, two of residuals, correlations, coverage, poses, uncertainty, halves, lens twice, two frames.
    assert page.count("<figure") == 13
    assert "start from it" in page
    assert "Where K is proven" in page


def test_a_refused_calibration_writes_its_report_and_its_corners_and_nothing_else(
    calibrated: Run, tmp_path: Path, fleet: Registry
) -> None:
    kept = corners(tmp_path / "kept.json", how=REFUSED)
    outputs = ("--html", "r.html", "--out", "k.yml", "--to", "opencv_storage", "--corners", "again.json")
    code, out, _ = calibrated("--from", kept, *outputs, "--registry", "fleet", "--approve", "--yes")
    assert code == 1
    assert out.splitlines()[-1].startswith("NONE")
    assert "low-tilt: board normals spread" in out
    assert "→ tilt the board\n" in out
    assert not re.search(r"^ +fx ", out, re.MULTILINE)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["again.json", "fleet", "kept.json", "r.html"]
    assert (tmp_path / "again.json").read_bytes() == kept.read_bytes()
    assert [*fleet.snapshot().entries(), *fleet.snapshot().proposals()] == []
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "The numbers that were refused" in page
    assert "no K was written" in page


def test_one_that_passes_exits_with_0_and_writes_what_was_asked_for(calibrated: Run, tmp_path: Path) -> None:
    kept = corners(tmp_path / "kept.json")
    code, out, err = calibrated("--from", kept, "--out", "k.yml", "--to", "opencv_storage", "--json")
    assert code == 0
    assert err == ""
    K = json.loads(out)["calibration"]["intrinsics"]
    [written] = parsers.read(tmp_path / "k.yml")
    assert written.intrinsics.fx == pytest.approx(K["fx"], rel=1e-12)
    assert written.intrinsics.cx == pytest.approx(K["cx"], rel=1e-12)
    assert written.intrinsics.fx == pytest.approx(camera().intrinsics.fx, rel=3e-4)


def test_one_that_passes_can_be_approved_at_once(calibrated: Run, tmp_path: Path, fleet: Registry) -> None:
    kept = corners(tmp_path / "kept.json")
    flags = ("--registry", "fleet", "--approve", "--reason", "new lens", "--operator", "Ada", "--yes")
    assert calibrated("--from", kept, *flags)[0] == 0
    entry = the_entry(fleet)
    assert (entry.status, entry.reason) == (Status.APPROVED, "new lens")
    assert entry.calibration.provenance.operator == "Ada"
    assert entry.extensions[VERDICT_BLOCK]["verdict"] == "fixed"


def test_a_draft_is_what_approve_takes(calibrated: Run, tmp_path: Path, fleet: Registry) -> None:
    kept = corners(tmp_path / "kept.json")
    code, err, _ = calibrated("--from", kept, "--registry", "fleet", "--yes")
    assert code == 0
    [held] = fleet.snapshot().proposals()
    assert held.entry.status is Status.DRAFT
    assert f"calibrary registry approve {held.id}" in err
    words = ["approve", held.id, "--digest", str(held.oid), "--registry", str(tmp_path / "fleet")]
    assert main(["registry", *words, "--reason", "good"]) == 0
    assert the_entry(fleet).status is Status.APPROVED


def test_a_start_may_be_approved_and_stays_a_start(
    calibrated: Run, tmp_path: Path, fleet: Registry, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = corners(tmp_path / "kept.json", how=PROVISIONAL)
    code, out, _ = calibrated(
        "--from", kept, "--registry", "fleet", "--approve", "--reason", "best we have", "--yes"
    )
    assert code == 1
    assert "it is used as a start: no solver keeps it fixed" in out
    entry = the_entry(fleet)
    assert entry.status is Status.APPROVED
    assert any(note.startswith("start: ") for note in entry.notes)
    capsys.readouterr()
    [held] = fleet.snapshot().entries()
    assert main(["registry", "show", held.id, "--registry", str(tmp_path / "fleet"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["use"] == "start"


@pytest.mark.parametrize(("use", "code"), [("fixed", 1), ("start", 0), ("metrology", 1)])
def test_the_exit_code_is_about_the_use_that_was_asked_for(
    calibrated: Run, tmp_path: Path, use: str, code: int
) -> None:
    kept = corners(tmp_path / "kept.json", how=PROVISIONAL)
    found, out, _ = calibrated("--from", kept, "--use", use)
    assert found == code
    assert re.search(r"keep it fixed +no +.* px within \d+ px of the middle", out)
    assert re.search("start from it +yes", out)
    assert bool(re.search("measure with it +no", out)) is (use == "metrology")


def test_an_entry_holds_what_it_takes_to_solve_it_again(
    calibrated: Run, tmp_path: Path, fleet: Registry
) -> None:
    shots = frames(tmp_path / "shots", 10)
    flags = ("--corners", "corners.json", "--registry", "fleet", "--yes", "--flat")
    calibrated(*shots, *BOARD, *flags)
    entry = the_entry(fleet)
    key, made, quality = entry.calibration.camera, entry.calibration.provenance, entry.calibration.quality
    assert (key.make, key.model, key.focal_mm, key.image_size) == (MAKE, MODEL, 4.8, SIZE)
    assert key.serial is not None
    assert (made.kind, made.firmware, made.focus) == ("board", FIRMWARE, "1.5 m")
    assert made.sha256 == hashlib.sha256((tmp_path / "corners.json").read_bytes()).hexdigest()
    assert {file.name: file.sha256 for file in made.sources} == {
        path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in shots
    }
    assert made.date is not None
    # Nobody stated who calibrated; who recorded it is the commit's author.
    assert made.operator is None
    assert "OpenCV" in (made.tool or "")
    assert quality is not None
    assert quality.covariance is not None
    assert None not in (quality.kappa2, quality.rms_px, quality.points, quality.views, quality.coverage)
    block: Any = entry.extensions[VERDICT_BLOCK]
    assert block["asked"] == {"model": "auto", "warp": False, "guess_fx": None, "use": "fixed"}
    assert block["board"] == {"pattern": "checkerboard", "columns": 9, "rows": 6, "square_mm": 40.0}
    assert block["programs"]["opencv"] == cv2.__version__

    _, out, _ = calibrated("--from", "corners.json", "--flat", "--json")
    again = json.loads(out)["calibration"]["intrinsics"]
    assert again["fx"] == pytest.approx(entry.calibration.intrinsics.fx, rel=1e-9)
    assert abs(again["fx"] / CAMERA.intrinsics.fx - 1) < 2e-3


@pytest.mark.thorough
def test_an_entry_of_another_name_is_met_by_its_key(calibrated: Run, tmp_path: Path, fleet: Registry) -> None:
    kept = corners(tmp_path / "kept.json")
    other = corners(tmp_path / "other.json", seed=3)
    nameless = read_corners(other)
    write_corners(replace(nameless, camera=replace(nameless.camera, make=None, model=None)), other)
    calibrated("--from", kept, "--registry", "fleet", "--yes")
    before = the_entry(fleet)
    code, err, _ = calibrated("--from", other, "--registry", "fleet", "--as", "acme/a1", "--yes")
    assert code == 0
    after = the_entry(fleet)
    assert after.id == before.id == f"{slug('Acme')}/{slug('A1')}/1920x1440"
    assert after.calibration.intrinsics.fx != before.calibration.intrinsics.fx
    assert "intrinsics.fx" in err


def test_a_camera_without_a_name_is_asked_for_before_the_work(
    calibrated: Run, tmp_path: Path, fleet: Registry
) -> None:
    shots = frames(tmp_path / "shots", 3, exif(make="", model="", firmware=None))
    code, _, err = calibrated(*shots, *BOARD, "--registry", "fleet", "--yes")
    assert code == 3
    assert "--make NAME --model NAME" in err
    assert [*fleet.snapshot().entries(), *fleet.snapshot().proposals()] == []


@pytest.mark.thorough
def test_without_the_side_of_a_square_k_is_the_same_and_lengths_are_in_squares(
    calibrated: Run, photographed: Path, told: str
) -> None:
    metric = json.loads(told)
    flags = ("--board", "checkerboard:9x6", "--corners", "bare.json")
    bare = json.loads(calibrated(photographed, *flags, "--json")[1])
    assert bare["calibration"]["K"] == pytest.approx(np.array(metric["calibration"]["K"]), rel=1e-6)
    assert (metric["length_unit"], bare["length_unit"]) == ("mm", "squares")
    assert 40 * bare["geometry"]["distance"] == pytest.approx(metric["geometry"]["distance"], rel=1e-6)
    assert "wrong-square" not in [finding["rule"] for finding in bare["findings"]]
    _, out, _ = calibrated("--from", "bare.json", "--html", "page.html")
    assert "scale" in out
    assert "unknown" in out
    assert "scale unknown" in Path("page.html").read_text(encoding="utf-8")


def test_a_stray_frame_of_another_size_is_left_out_on_request_and_named(
    calibrated: Run, tmp_path: Path
) -> None:
    folder = tmp_path / "shots"
    frames(folder, 8)
    write_jpeg(folder / "stray.jpg", (320, 240), exif=exif())
    code, _, err = calibrated(folder, *BOARD)
    assert code == 3
    assert "--skip-other-sizes" in err
    code, out, err = calibrated(folder, *BOARD, "--skip-other-sizes")
    assert code == 1
    assert "1 of 9 frames are of another size than 640×480 px" in out
    assert re.search(r"stray\.jpg +other-size", out)


def test_a_key_that_nobody_has_is_told_of(calibrated: Run, tmp_path: Path, fleet: Registry) -> None:
    assert [*fleet.snapshot().entries(), *fleet.snapshot().proposals()] == []
    kept = corners(tmp_path / "kept.json")
    code, _, err = calibrated("--from", kept, "--registry", "fleet", "--as", "dji/fc6310", "--yes")
    assert code == 4
    assert "no such camera" in err
    assert "--model" in err


@pytest.mark.thorough
def test_a_wrong_square_moves_the_poses_and_not_k(calibrated: Run, tmp_path: Path) -> None:
    shots = frames(tmp_path / "shots", 8)
    right = json.loads(calibrated(*shots, *BOARD, "--json")[1])
    _, out, _ = calibrated(*shots, *BOARD[:2], "--square-mm", "0.04", "--json")
    wrong = json.loads(out)
    assert wrong["calibration"]["intrinsics"]["fx"] == pytest.approx(
        right["calibration"]["intrinsics"]["fx"], rel=1e-6
    )
    assert "wrong-square" in [finding["rule"] for finding in wrong["findings"]]
    assert "wrong-square" not in [finding["rule"] for finding in right["findings"]]


def test_the_lens_models_are_those_that_are_solved_for() -> None:
    assert set(get_args(LensModel)) == {"auto", *Solvable}
