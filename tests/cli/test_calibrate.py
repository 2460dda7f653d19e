"""``calibrary calibrate FRAMES``: what it finds, what it writes for which verdict, and what it says of bad input."""

from __future__ import annotations

import datetime as dt
import hashlib
import json
import re
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from calibrary import parsers
from calibrary.calib.corners_file import read_corners, write_corners
from calibrary.calib.lens_models import Solvable
from calibrary.cli.calibrate.flags import LENS_MODELS
from calibrary.cli.main import main
from calibrary.records import replace
from calibrary.registry.checks.rules import BOARD_BLOCK
from calibrary.registry.entry import Entry, Status
from calibrary.registry.init import init
from calibrary.registry.paths import slug
from calibrary.registry.registry import Registry
from calibrary.schemas import require
from tests.calib.photographs import CAMERA, SIZE, encoded, photograph
from tests.calib.solving import Session, camera
from tests.imagery import write_jpeg
from tests.jobs.calibrate_board.boards import (
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

__all__ = ["nobodys_git"]

BOARD = ("--board", "checkerboard:9x6", "--square-mm", "40")
COUNT = 11
Run = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="session")
def photographed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Frames of 1280×960 px under a camera whose truth lies beside them, as ``synth`` writes them."""
    out = tmp_path_factory.mktemp("board") / "frames"
    flags = ("--frames", str(COUNT), "--seed", "4", "--camera", "RedEdge-M")
    assert main(["calibrate", "synth", str(out), *BOARD, *flags]) == 0
    return out


@pytest.fixture
def calibrated(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Run:
    """Runs the command in a folder of its own; (exit code, standard output, standard error)."""
    monkeypatch.chdir(tmp_path)

    def run(*argv: str | Path) -> tuple[int, str, str]:
        capsys.readouterr()
        code = main(["calibrate", *map(str, argv)])
        said = capsys.readouterr()
        return code, said.out, said.err

    return run


@pytest.fixture
def fleet(tmp_path: Path) -> Registry:
    """A registry in git."""
    return init(tmp_path / "fleet").registry


def truth_of(folder: Path) -> Mapping[str, Any]:
    document: Mapping[str, Any] = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    return document


def the_entry(fleet: Registry) -> Entry:
    [stored] = (*fleet.snapshot().entries(), *fleet.snapshot().proposals())
    return stored.entry


def test_frames_lead_to_the_camera_that_took_them(calibrated: Run, photographed: Path) -> None:
    code, out, err = calibrated(photographed, *BOARD, "--json")
    document = json.loads(out)
    require(document, "calibration-result-1")
    K, true = document["calibration"]["intrinsics"], truth_of(photographed)["calibration"]["intrinsics"]
    assert abs(K["fx"] / true["fx"] - 1) < 6e-4
    quality = document["calibration"]["quality"]
    assert abs(K["cx"] - true["cx"]) < min(1.2, 3 * quality["std"]["cx"] * max(1.0, quality["kappa2"]) ** 0.5)
    assert abs(K["cy"] - true["cy"]) < 0.8
    assert document["calibration"]["camera"]["model"] == "RedEdge-M"
    # Eleven views are too few to pass, whatever they show.
    assert code == 1
    assert document["verdict"] == "provisional"
    assert "few-views" in [finding["rule"] for finding in document["findings"]]
    assert err == ""


def test_a_person_sees_verdict_parameters_and_every_view(calibrated: Run, photographed: Path) -> None:
    code, out, err = calibrated(photographed, *BOARD, "--correlations")
    assert code == 1
    assert err == ""
    assert out.splitlines()[-1].startswith("PROVISIONAL")
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
    assert len(re.findall(r"board_00\d\d\.jpg +0\.\d", out)) == COUNT


def test_the_board_is_found_by_trying_where_nobody_names_it(calibrated: Run, photographed: Path) -> None:
    by_name = json.loads(calibrated(photographed, *BOARD, "--json")[1])
    _, out, _ = calibrated(f"{photographed}/*.jpg", "--square-mm", "40", "--json")
    tried = json.loads(out)
    assert tried["calibration"]["provenance"]["sha256"] == by_name["calibration"]["provenance"]["sha256"]


@pytest.mark.parametrize(
    ("flags", "date", "origin"),
    [
        ((), "2019-05-18", "from the frames' EXIF, the last day of 2019-05-17 to 2019-05-18"),
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
    calibrated(photographed, *BOARD, "--report", "camera.html")
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
    assert page.count("<figure") == 12
    # The two frames, and the maps, which are pictures too.
    assert page.count("data:image/png;base64,") >= 4
    assert "provisional" in page


def test_a_refused_calibration_writes_its_report_and_its_corners_and_nothing_else(
    calibrated: Run, tmp_path: Path, fleet: Registry
) -> None:
    kept = corners(tmp_path / "kept.json", how=REFUSED)
    outputs = ("--report", "r.html", "--out", "k.yml", "--to", "opencv_storage", "--corners", "again.json")
    code, out, _ = calibrated("--from", kept, *outputs, "--registry", "fleet", "--approve", "--yes")
    assert code == 1
    assert out.splitlines()[-1].startswith("REFUSE")
    assert "low-tilt: board normals spread" in out
    assert "; tilt the board\n" in out
    assert not re.search(r"^ +fx ", out, re.MULTILINE)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["again.json", "fleet", "kept.json", "r.html"]
    assert (tmp_path / "again.json").read_bytes() == kept.read_bytes()
    assert [*fleet.snapshot().entries(), *fleet.snapshot().proposals()] == []
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert "The numbers that were refused" in page
    assert "No K was written" in page


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
    assert entry.extensions[BOARD_BLOCK]["verdict"] == "pass"


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


def test_a_provisional_one_becomes_a_draft_whatever_was_asked_for(
    calibrated: Run, tmp_path: Path, fleet: Registry
) -> None:
    kept = corners(tmp_path / "kept.json", how=PROVISIONAL)
    code, err, _ = calibrated("--from", kept, "--registry", "fleet", "--approve", "--yes")
    assert code == 1
    assert "only a calibration that passes is approved" in err
    entry = the_entry(fleet)
    assert entry.status is Status.DRAFT
    assert any("provisional" in note for note in entry.notes)


def test_an_entry_holds_what_it_takes_to_solve_it_again(
    calibrated: Run, tmp_path: Path, fleet: Registry
) -> None:
    shots = frames(tmp_path / "shots", 10)
    flags = ("--corners", "corners.json", "--registry", "fleet", "--yes", "--no-warp")
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
    block: Any = entry.extensions[BOARD_BLOCK]
    assert block["asked"] == {"model": "auto", "warp": False, "guess_fx": None}
    assert block["board"] == {"pattern": "checkerboard", "columns": 9, "rows": 6, "square_mm": 40.0}
    assert block["programs"]["opencv"] == cv2.__version__

    _, out, _ = calibrated("--from", "corners.json", "--no-warp", "--json")
    again = json.loads(out)["calibration"]["intrinsics"]
    assert again["fx"] == pytest.approx(entry.calibration.intrinsics.fx, rel=1e-9)
    assert abs(again["fx"] / CAMERA.intrinsics.fx - 1) < 2e-3


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


def test_corners_without_frames_become_an_entry_that_names_their_file(
    calibrated: Run, tmp_path: Path, fleet: Registry
) -> None:
    kept = corners(tmp_path / "kept.json", hashed=False)
    code, _, err = calibrated("--from", kept, "--registry", "fleet", "--approve", "--yes")
    assert (code, err) == (0, "")
    [source] = the_entry(fleet).calibration.provenance.sources
    assert (source.name, source.sha256) == ("kept.json", hashlib.sha256(kept.read_bytes()).hexdigest())
    assert the_entry(fleet).status is Status.APPROVED


def vnl_of(kept: Path, path: Path) -> Path:
    """The same corners as mrcal writes them: counted from the middle of the first pixel, the level behind."""
    seen = read_corners(kept)
    lines = ["## produced by a test", "# filename x y level"]
    for view in seen.views:
        assert len(view.ids) == len(seen.board.points)
        lines += [f"{view.name} {x - 0.5!r} {y - 0.5!r} 0" for x, y in view.image_points.tolist()]
    path.write_text("\n".join([*lines, "nothing.jpg - - -", ""]), encoding="utf-8")
    return path


def test_corners_of_mrcal_are_solved_approved_and_kept(
    calibrated: Run, tmp_path: Path, fleet: Registry
) -> None:
    kept = corners(tmp_path / "kept.json", how=Session(views=18), hashed=False)
    table = vnl_of(kept, tmp_path / "corners.vnl")
    own = json.loads(calibrated("--from", kept, "--json")[1])
    size = "{}x{}".format(*read_corners(kept).image_size)
    flags = ("--board", str(read_corners(kept).board), "--image-size", size, "--corners", "again.json")
    named = ("--make", "Example", "--model", "Solved")
    code, out, err = calibrated(
        "--from", table, *flags, *named, "--registry", "fleet", "--approve", "--yes", "--json"
    )
    assert code == 0, err
    theirs = json.loads(out)
    assert theirs["calibration"]["K"] == pytest.approx(np.array(own["calibration"]["K"]), rel=1e-7)
    # The table does not state the side of a square, and K does not need it.
    assert theirs["length_unit"] == "squares"
    provenance = the_entry(fleet).calibration.provenance
    [source] = provenance.sources
    assert source.sha256 == hashlib.sha256(table.read_bytes()).hexdigest()
    again = json.loads(calibrated("--from", "again.json", "--json")[1])
    assert again["calibration"]["provenance"]["sources"] == [{"name": source.name, "sha256": source.sha256}]
    assert again["calibration"]["K"] == theirs["calibration"]["K"]


def test_what_a_table_of_corners_does_not_say_is_asked_for(calibrated: Run, tmp_path: Path) -> None:
    kept = corners(tmp_path / "kept.json", how=Session(views=4))
    table = vnl_of(kept, tmp_path / "corners.vnl")
    board = ("--board", str(read_corners(kept).board))
    assert "--board" in calibrated("--from", table)[2]
    assert "--image-size" in calibrated("--from", table, *board)[2]
    code, _, err = calibrated("--from", table, "--board", "checkerboard:7x5", "--image-size", "640x480")
    assert code == 3
    assert "checkerboard:7x5" in err


def test_frames_beside_a_table_of_corners_say_what_they_say_of_their_camera(
    calibrated: Run, tmp_path: Path, fleet: Registry
) -> None:
    shots = frames(tmp_path / "shots", 8)
    calibrated(*shots, *BOARD, "--corners", "kept.json")
    seen = read_corners(tmp_path / "kept.json")
    lines = ["image,id,x,y"]
    for view in seen.views:
        lines += [
            f"{view.name},{at},{x - 0.5!r},{y - 0.5!r}"
            for at, (x, y) in zip(view.ids, view.image_points.tolist(), strict=True)
        ]
    table = tmp_path / "shots" / "found.csv"
    table.write_text("\n".join(lines), encoding="utf-8")
    code, _, err = calibrated("--from", table, *BOARD, "--registry", "fleet", "--yes")
    assert (code, err) == (1, "")
    made = the_entry(fleet).calibration
    assert (made.camera.make, made.camera.model, made.provenance.firmware) == (MAKE, MODEL, FIRMWARE)
    assert {source.name for source in made.provenance.sources} == {
        "found.csv",
        *(shot.name for shot in shots),
    }


def test_without_the_side_of_a_square_k_is_the_same_and_lengths_are_in_squares(
    calibrated: Run, photographed: Path
) -> None:
    metric = json.loads(calibrated(photographed, *BOARD, "--json")[1])
    flags = ("--board", "checkerboard:9x6")
    bare = json.loads(calibrated(photographed, *flags, "--json")[1])
    assert bare["calibration"]["K"] == pytest.approx(np.array(metric["calibration"]["K"]), rel=1e-6)
    assert (metric["length_unit"], bare["length_unit"]) == ("mm", "squares")
    assert 40 * bare["geometry"]["distance"] == pytest.approx(metric["geometry"]["distance"], rel=1e-6)
    assert "wrong-square" not in [finding["rule"] for finding in bare["findings"]]
    _, out, _ = calibrated(photographed, *flags, "--report", "page.html")
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
    assert "1 of 9 frames are of another size than 640×480 px" in err
    assert re.search(r"stray\.jpg +– +other-size", out)


def test_a_key_that_nobody_has_is_told_of(calibrated: Run, tmp_path: Path, fleet: Registry) -> None:
    assert [*fleet.snapshot().entries(), *fleet.snapshot().proposals()] == []
    kept = corners(tmp_path / "kept.json")
    code, _, err = calibrated("--from", kept, "--registry", "fleet", "--as", "dji/fc6310", "--yes")
    assert code == 4
    assert "no such camera" in err
    assert "--model" in err


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


def test_a_seed_starts_the_search_and_decides_nothing(calibrated: Run, tmp_path: Path) -> None:
    kept = corners(tmp_path / "kept.json")
    np.save(tmp_path / "K_seed.npy", np.array([[1000.0, 0, 960], [0, 1000.0, 720], [0, 0, 1]]))
    plain, seeded = (
        json.loads(calibrated("--from", kept, "--json", *flags)[1])["calibration"]["intrinsics"]
        for flags in ((), ("--seed-k", tmp_path / "K_seed.npy"))
    )
    assert seeded["fx"] == pytest.approx(plain["fx"], rel=1e-7)


def test_a_seed_of_another_frame_is_refused(calibrated: Run, tmp_path: Path) -> None:
    kept = corners(tmp_path / "kept.json")
    (tmp_path / "k.yml").write_bytes(
        parsers.encode([camera((1000, 1000), distortion=None)], "opencv_storage", name="k.yml")[0]
    )
    code, _, err = calibrated("--from", kept, "--seed-k", "k.yml")
    assert code == 3
    assert "not a K to start from" in err


def test_control_points_need_no_board(calibrated: Run, tmp_path: Path) -> None:
    truth = camera((640, 480), fx=500.0, fy=500.0, distortion=None)
    random = np.random.default_rng(1)
    points = random.uniform((-3, -2, 8), (3, 2, 14), (40, 3))
    rows = ["X,Y,Z,u,v,image"]
    for name, shift in (("a", 0.0), ("b", 1.0)):
        pixels = truth.project(points - [shift, 0, 0]) - 0.5
        rows += [f"{x},{y},{z},{u},{v},{name}" for (x, y, z), (u, v) in zip(points, pixels, strict=True)]
    (tmp_path / "gcp.csv").write_text("\n".join(rows))
    flags = ("--image-size", "640x480", "--pixel-origin", "centre", "--lens-model", "k1k2", "--json")
    _, out, _ = calibrated("--points", "gcp.csv", *flags)
    K = json.loads(out)["calibration"]["intrinsics"]
    assert K["fx"] == pytest.approx(500.0, abs=0.01)
    assert K["cx"] == pytest.approx(truth.intrinsics.cx, abs=0.01)


def test_the_lens_models_are_those_that_are_solved_for() -> None:
    assert set(LENS_MODELS) == {"auto", *Solvable}


def mosaic(folder: Path) -> None:
    pixels = np.random.default_rng(0).integers(90, 110, (480, 640)).astype(np.uint8)
    pixels[::2, ::2] //= 2
    for number in range(3):
        (folder / f"{number}.tif").write_bytes(encoded(pixels, "TIFF"))


def printers_ink(folder: Path) -> None:
    frame = Image.fromarray(photograph()[0]).convert("CMYK")
    for number in range(3):
        frame.save(folder / f"{number}.jpg")


def cut_short(folder: Path) -> None:
    for path in frames(folder, 3):
        path.write_bytes(path.read_bytes()[:-4000])


def empty_walls(folder: Path) -> None:
    for number in range(3):
        (folder / f"{number}.png").write_bytes(encoded(np.full((480, 640), 120 + number, np.uint8), "PNG"))


def two_sizes(folder: Path) -> None:
    (folder / "a.png").write_bytes(encoded(photograph()[0], "PNG"))
    (folder / "b.png").write_bytes(encoded(photograph()[0][:, :600], "PNG"))


def two_cameras(folder: Path) -> None:
    frames(folder, 2)
    frames(folder, 1, exif(model="Board Two"), first=2)


def two_focuses(folder: Path) -> None:
    frames(folder, 2)
    frames(folder, 1, exif(focus_m=(3, 1)), first=2)


def two_views(folder: Path) -> None:
    frames(folder, 2)


def nothing(folder: Path) -> None:
    shutil.rmtree(folder)
    folder.mkdir()


@pytest.mark.parametrize(
    ("fill", "board", "code", "said"),
    [
        (nothing, "checkerboard:9x6", 3, "a folder without images"),
        (empty_walls, "checkerboard:9x6", 1, "no checkerboard:9x6 found in any of 3 frames"),
        (two_views, "checkerboard:8x5", 1, "but one of 9×6 inner corners; give checkerboard:9x6"),
        (two_sizes, "checkerboard:9x6", 3, "of 2 sizes"),
        (two_cameras, "checkerboard:9x6", 3, "of 2 cameras"),
        (two_focuses, "checkerboard:9x6", 3, "of 2 focus settings: 2 of 1.5 m"),
        (mosaic, "checkerboard:9x6", 1, "raw colour mosaic"),
        (printers_ink, "checkerboard:9x6", 3, "CMYK"),
        (cut_short, "checkerboard:9x6", 1, "cut short"),
        (two_views, "chessboard", 3, "expected PATTERN:COLUMNSxROWS"),
    ],
)
def test_bad_frames_get_one_line_and_leave_nothing(
    calibrated: Run, tmp_path: Path, fill: Callable[[Path], None], board: str, code: int, said: str
) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    fill(folder)
    outputs = ("--report", "r.html", "--corners", "c.json", "--out", "k.xml", "--to", "agisoft_xml")
    found, out, err = calibrated(folder, "--board", board, "--square-mm", "40", *outputs)
    assert found == code
    assert said in err
    assert err.count("\n") == 1
    assert out == ""
    assert [path.name for path in tmp_path.iterdir()] == ["frames"]


def test_corners_that_determine_no_camera_are_kept(calibrated: Run, tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    two_views(folder)
    outputs = ("--report", "r.html", "--corners", "c.json", "--out", "k.xml", "--to", "agisoft_xml")
    found, out, err = calibrated(folder, "--board", "checkerboard:9x6", "--square-mm", "40", *outputs)
    assert (found, out) == (1, "")
    assert "2 of 2 views show enough of the board" in err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["c.json", "frames"]


@pytest.mark.parametrize(
    ("flags", "said"),
    [
        (("--report", "page.txt"), "ends in .html"),
        (("--corners", "/dev/null/c.json"), "is a file; expected a folder"),
        (("--out", "k.xml"), "say which with --to"),
        (("--out", "k.xml", "--to", "nonsense"), "not a format that is written"),
        (("--report", "a.html", "--out", "a.html", "--to", "agisoft_xml"), "one name"),
    ],
)
def test_a_place_that_cannot_be_written_is_named_before_the_work(
    calibrated: Run, tmp_path: Path, flags: tuple[str, ...], said: str
) -> None:
    code, _, err = calibrated("frames-that-are-not-there", *BOARD, *flags)
    assert code == 3
    assert said in err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "argv",
    [
        (),
        ("frames", "--board", "charuco:8x5", "--marker-mm", "30"),
        ("frames", "--square-mm", "40", "--from", "c.json"),
        ("--from", "c.json", "--board", "checkerboard:9x6"),
        ("--points", "p.csv"),
        ("--from", "c.json", "--to", "agisoft_xml"),
        ("--from", "c.json", "--approve"),
        ("--from", "c.json", "--registry", "fleet"),
        ("--from", "c.json", "--lens-model", "splined"),
    ],
)
def test_what_makes_no_sense_exits_with_2(calibrated: Run, argv: tuple[str, ...]) -> None:
    with pytest.raises(SystemExit) as caught:
        calibrated(*argv)
    assert caught.value.code == 2


def test_a_set_of_sights_too_few_to_compute_says_so(calibrated: Run, tmp_path: Path) -> None:
    kept = corners(tmp_path / "kept.json", how=Session(views=2))
    code, _, err = calibrated("--from", kept, "--report", "r.html", "--corners", "again.json")
    assert code == 1
    assert "expected at least 3" in err
    # What was seen is measured, whether a camera comes of it or not.
    assert "kept in again.json" in err
    assert len(read_corners(tmp_path / "again.json").views) == 2
    assert not (tmp_path / "r.html").exists()
