"""``calibrary calibrate flight``: from images to the entry that an extraction uses; COLMAP's part is simulated here."""

from __future__ import annotations

import hashlib
import json
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calibrary.cli.main import main
from calibrary.errors import CalibrationError
from calibrary.jobs.calibrate import flight_images as job
from calibrary.records import replace
from calibrary.sfm.engine import MatchedFlight
from calibrary.sfm.mapping import positions_of
from calibrary.synthetic import write_image
from tests.registry.git.repositories import seclude
from tests.sfm.flights import CAMERA, LATITUDE, PLANS, SIZE, Plan, fly, poses
from tests.sfm.reconstructions import write_colmap, write_opensfm
from tests.sfm.rendered import head_of
from tests.sfm.surveyed import survey, write_gcp_list

SMALL = Plan(relief=0.05, heights=(1.0, 1.4), cross=True, rows=2, columns=4, points=250, outliers=0.0)
GOOD, FLAT = PLANS["two heights, flat, RTK"], PLANS["flat, one height"]
SEED = 3


def flight(folder: Path, plan: Plan) -> Path:
    """Images with the heads that the plan's camera writes, and nothing in them."""
    random = np.random.default_rng(SEED)
    empty = np.full((SIZE[1], SIZE[0], 3), 90, dtype=np.uint8)
    for number, centre in enumerate(poses(plan, SEED)[1]):
        head = head_of(CAMERA, plan, centre, number, random)
        write_image(folder / f"IMG_{number:04}.JPG", empty, head)
    return folder


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flight(tmp_path_factory.mktemp("good") / "flight", GOOD)


@pytest.fixture(scope="module")
def flat(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return flight(tmp_path_factory.mktemp("flat") / "flight", FLAT)


@pytest.fixture
def simulated(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Callable[[Plan], None]:
    """Let COLMAP find what the plan's images would show."""
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))

    def of(plan: Plan) -> None:
        def found(matched: MatchedFlight, **_: object) -> object:
            tracks, scene = fly(plan, SEED)
            assert [image.name for image in matched.images] == list(tracks.names)
            return replace(tracks, positions=positions_of(matched.images)), scene

        monkeypatch.setattr(
            job, "match", lambda images, *, folder, **_: MatchedFlight(folder=folder, images=tuple(images))
        )
        monkeypatch.setattr(job, "reconstruct", found)

    return of


def test_a_good_flight_becomes_the_k_of_its_images(
    good: Path,
    simulated: Callable[[Plan], None],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    seclude(monkeypatch, tmp_path)
    monkeypatch.chdir(tmp_path)
    simulated(GOOD)
    assert main(["registry", "init", "fleet"]) == 0
    flags = ["--html", "flight.html", "--out", "camera.xml", "--to", "agisoft_xml"]
    keep = ["--registry", "fleet", "--yes", "--approve", "--reason", "flown for it"]
    capsys.readouterr()
    assert main(["calibrate", "flight", str(good), *flags, *keep]) == 0
    said = capsys.readouterr()
    *lines, kept = said.out.splitlines()
    assert any(line.startswith("FIXED") for line in lines)
    assert kept.startswith("approved 1 entry in commit")
    assert "30 of 30, by position" in said.out
    page = Path("flight.html").read_text(encoding="utf-8")
    assert "How the flight was flown" in page
    assert "board" not in page.split("<main", 1)[-1].split("How far to trust")[0].lower()
    # Where the images were taken is used, and written nowhere.
    written = page + said.out + said.err + Path("camera.xml").read_text(encoding="utf-8")
    entry = next(Path("fleet/cameras").rglob("*.yaml")).read_text(encoding="utf-8")
    assert f"{LATITUDE:.3f}" not in written + entry
    assert 'kind: "flight"' in entry
    assert 'grade: "adjusted"' in entry
    assert main(["extract", str(good), "--registry", "fleet", "--output-matrix", "K_matrix.npy"]) == 0
    K = np.load("K_matrix.npy")
    assert abs(K[0, 0] - CAMERA.intrinsics.fx) < 4
    assert list(Path("temporary").iterdir()) == []


def test_json_holds_what_the_verdict_is_based_on(
    good: Path, simulated: Callable[[Plan], None], capsys: pytest.CaptureFixture[str]
) -> None:
    simulated(GOOD)
    assert main(["calibrate", "flight", str(good), "--start", "1000", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["verdict"] == "fixed"
    assert document["calibration"]["grade"] == "adjusted"
    assert document["flown"]["geometry"]["height_ratio"] > 1.4
    assert len(document["calibration"]["provenance"]["sources"]) == 30
    assert "pycolmap" in document["calibration"]["provenance"]["tool"]


def test_an_image_that_is_there_twice_counts_once(
    tmp_path: Path, simulated: Callable[[Plan], None], capsys: pytest.CaptureFixture[str]
) -> None:
    simulated(SMALL)
    images = sorted(flight(tmp_path / "flight", SMALL).iterdir())
    for image in images:
        shutil.copy(image, image.with_stem(f"{image.stem}_copy"))
    assert main(["calibrate", "flight", str(tmp_path / "flight")]) == 1
    said = capsys.readouterr()
    assert "16 of 32 images are copies of others, byte for byte, and were left out" in said.out + said.err
    assert "16 of 16, by position" in said.out
    for image in images[1:]:
        shutil.copy(images[0], image)
    assert main(["calibrate", "flight", *map(str, images)]) == 3
    assert "1 different image can be read; expected a flight" in capsys.readouterr().err


def test_images_of_which_none_can_be_read_are_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("a.jpg", "b.jpg", "c.jpg"):
        (tmp_path / name).touch()
    assert main(["calibrate", "flight", str(tmp_path)]) == 3
    assert "none of 3 images can be read; expected a flight" in capsys.readouterr().err


@pytest.mark.thorough
def test_a_flat_flight_is_refused_with_what_to_fly(
    flat: Path, simulated: Callable[[Plan], None], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    simulated(FLAT)
    out, report = tmp_path / "camera.xml", tmp_path / "r.html"
    flags = ["--out", str(out), "--to", "agisoft_xml", "--html", str(report)]
    assert main(["calibrate", "flight", str(flat), *flags]) == 1
    said = capsys.readouterr().out
    assert "focal length and flying height cannot be told apart" in said
    assert "oblique images of 30°" in said
    assert "all of that included" in said
    assert "NONE" in said.splitlines()[-1]
    assert not out.exists()
    assert "what to fly instead" in report.read_text(encoding="utf-8")


@pytest.mark.thorough
def test_another_programs_reconstruction_is_judged_as_our_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    seclude(monkeypatch, tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "pycolmap", None)
    images = flight(tmp_path / "flight", SMALL)
    write_colmap(tmp_path / "project/sparse/0", *fly(SMALL, SEED))
    assert main(["registry", "init", "fleet"]) == 0
    capsys.readouterr()
    keep = ["--registry", "fleet", "--yes", "--html", "r.html", "--json"]
    assert main(["calibrate", "flight", str(images), "--from", "project", *keep]) == 1
    said = capsys.readouterr()
    document = json.loads(said.out)
    made, findings = document["calibration"]["provenance"], {one["rule"]: one for one in document["findings"]}
    assert document["verdict"] == "start"
    assert document["calibration"]["grade"] == "adjusted"
    assert document["calibration"]["camera"]["model"] == "Flight One"
    assert document["flown"]["geometry"]["metres"]
    assert "16 of 16 of this camera in the result of COLMAP" in document["flown"]["chosen"]
    assert made["tool"].endswith("observations by COLMAP")
    # What holds observations, and the images; not the cameras, which two flights may have in common.
    assert [one["name"] for one in made["sources"]][:2] == ["images.txt", "points3D.txt"]
    assert len(made["sources"]) == 2 + 16
    assert "COLMAP states fx = 1130.0 px" in findings["other-program"]["message"]
    assert "no-positions" not in findings
    entry = next(Path("fleet/proposals").rglob("*.yaml")).read_text(encoding="utf-8")
    assert 'kind: "flight"' in entry
    assert f"{LATITUDE:.3f}" not in entry + said.out + Path("r.html").read_text(encoding="utf-8")


def test_a_reconstruction_needs_no_images(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_opensfm(tmp_path / "odm/opensfm", *fly(replace(SMALL, rows=1), SEED))
    camera = ["--make", "Example", "--model", "One", "--lens-model", "k1k2"]
    assert main(["calibrate", "flight", "--from", "odm", *camera, "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["calibration"]["camera"]["model"] == "One"
    assert document["flown"]["geometry"]["metres"]
    made = document["calibration"]["provenance"]
    assert (made["date"], document["date_origin"]) == (None, "the images state none; --date gives it")
    path = tmp_path / "odm/opensfm/reconstruction.json"
    found = json.loads(path.read_text())
    found[1]["cameras"]["v2 wide"] = found[1]["cameras"]["v2 example"]
    path.write_text(json.dumps(found))
    assert main(["calibrate", "flight", "--from", "odm"]) == 3
    assert "holds 2 cameras, choose one with --camera N" in capsys.readouterr().err
    assert main(["calibrate", "flight", "--from", "odm", "--camera", "2"]) == 1
    assert "0 images of this camera" in capsys.readouterr().err


def test_a_flight_is_held_to_the_use_that_is_asked_for_under_the_policy_that_is_given(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_opensfm(tmp_path / "odm/opensfm", *fly(replace(SMALL, rows=1), SEED))
    policy = tmp_path / "wide.yaml"
    policy.write_text("schema: calibrary/policy-1\nname: wide\nfixed_sigma_px: 2.5\n", encoding="utf-8")
    asked = ["calibrate", "flight", "--from", str(tmp_path / "odm"), "--lens-model", "k1k2"]
    assert main([*asked, "--use", "start", "--policy", str(policy), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["verdict"] == "start"
    assert document["uses"]["limit_px"] == 2.5


@pytest.mark.thorough
def test_ground_control_takes_part_and_is_printed_without_a_place(
    tmp_path: Path, simulated: Callable[[Plan], None], capsys: pytest.CaptureFixture[str]
) -> None:
    simulated(SMALL)
    images, report = flight(tmp_path / "flight", SMALL), tmp_path / "r.html"
    gcp = write_gcp_list(tmp_path / "gcp_list.txt", survey(SMALL, SEED))
    assert (
        main(["calibrate", "flight", str(images), "--points", str(gcp), "--html", str(report), "--json"]) == 1
    )
    said = capsys.readouterr().out
    document = json.loads(said)
    control = document["flown"]["control"]
    assert (control["points"], control["rejected"]) == (6, [])
    assert control["rms_m"] < 0.06
    # Heights of another system: DATUM, but for what the receiver is off by itself.
    assert -70 < control["offset_m"][2] < -25
    digest = hashlib.sha256(gcp.read_bytes()).hexdigest()
    assert control["file"] == {"name": "gcp_list.txt", "sha256": digest}
    made = document["calibration"]["provenance"]
    assert made["assumptions"] == [f"the ground control of SHA-256 {digest} is right"]
    # A field is surveyed once and flown often: what flights share of it makes them no copies of one another.
    assert digest not in {one["sha256"] for one in made["sources"]}
    page = report.read_text(encoding="utf-8")
    assert "6 points by 36 marks" in page
    assert f"{LATITUDE:.3f}" not in said + page


@pytest.mark.parametrize(
    ("head", "north_deg", "code", "problem"),
    [
        ("WGS84", 0.1, 1, "11.1 km from where the images were taken: check the coordinate system"),
        ("UTM 32", 0.0, 3, "gcp_list.txt: line 1: 'UTM 32' is no coordinate system"),
    ],
)
def test_ground_control_of_another_place_is_refused_and_nothing_written(
    tmp_path: Path,
    simulated: Callable[[Plan], None],
    capsys: pytest.CaptureFixture[str],
    head: str,
    north_deg: float,
    code: int,
    problem: str,
) -> None:
    simulated(SMALL)
    images, report = flight(tmp_path / "flight", SMALL), tmp_path / "r.html"
    given = survey(SMALL, SEED)
    gcp = write_gcp_list(
        tmp_path / "gcp_list.txt", replace(given, places=given.places + np.array([0.0, north_deg, 0.0])), head
    )
    assert main(["calibrate", "flight", str(images), "--points", str(gcp), "--html", str(report)]) == code
    assert problem in capsys.readouterr().err
    assert not report.exists()


def test_ground_control_of_a_reconstruction_needs_no_images(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pycolmap", None)
    plan = replace(SMALL, gps_m=None)
    write_colmap(tmp_path / "sparse/0", *fly(plan, SEED))
    given, report = survey(plan, SEED), tmp_path / "r.html"
    x, y = given.marks[3].pixel
    wrong = (*given.marks[:3], replace(given.marks[3], pixel=(x + 40, y)), *given.marks[4:])
    gcp = write_gcp_list(tmp_path / "gcp_list.txt", replace(given, marks=wrong))
    flags = [
        "--from",
        str(tmp_path),
        "--points",
        str(gcp),
        "--points-std-m",
        "0.02",
        "--html",
        str(report),
        "--json",
    ]
    assert main(["calibrate", "flight", *flags]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["flown"]["control"]["points"] == 6
    assert [one["image"] for one in document["flown"]["control"]["rejected"]] == [given.marks[3].image]
    page = report.read_text(encoding="utf-8")
    assert "1 mark left out" in page
    assert "do not fit the others and were left out" in page
    assert document["flown"]["control"]["offset_m"] is None
    assert document["flown"]["geometry"]["metres"]


def test_nothing_is_written_of_images_that_do_not_fit_together(
    good: Path,
    simulated: Callable[[Plan], None],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    simulated(GOOD)

    def none(*_: object, **__: object) -> object:
        raise CalibrationError("no 3 fit together")

    monkeypatch.setattr(job, "reconstruct", none)
    report = tmp_path / "r.html"
    assert main(["calibrate", "flight", str(good), "--html", str(report)]) == 1
    assert "no 3 fit together" in capsys.readouterr().err
    assert not report.exists()
    assert list((tmp_path / "temporary").iterdir()) == []


@pytest.mark.parametrize(
    ("flags", "problem"),
    [
        (["--start", "3"], "is not a focal length"),
        (["--images", "2"], "from 3 to 200"),
        (["--to", "agisoft_xml"], "--out"),
        (["--approve"], "--registry"),
        (["--from", ".", "--start", "900"], "a reconstruction has its points"),
        (["--from", "."], "expected a folder with COLMAP's sparse model"),
        (["--camera", "2"], "--from FOLDER without DIR"),
        (["--same-datum-m", "0.1"], "--points FILE"),
        (["--points", "none.txt"], "none.txt: cannot be read"),
    ],
)
def test_what_makes_no_sense_is_said_before_any_work(
    good: Path, flags: list[str], problem: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code: object = None
    try:
        code = main(["calibrate", "flight", str(good), *flags])
    except SystemExit as stop:
        code = stop.code
    assert code in {2, 3}
    assert problem in capsys.readouterr().err
