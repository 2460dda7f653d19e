"""``calibrary calibrate --rig``: from rendered frames of a payload to poses, files, a page and entries."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calibrary.calib.board import Board
from calibrary.calib.rig.lens import Place
from calibrary.calib.synthesis import Settings, poses, render
from calibrary.calibration import Calibration, CameraKey, Grade, Intrinsics, Provenance
from calibrary.cli.main import main
from calibrary.distortion import BrownConrady
from calibrary.jobs.calibrate import calibrate_rig
from calibrary.parsers.rigs import read_rig
from calibrary.parsers.rigs.micasense import relatives_of
from calibrary.records import to_json
from calibrary.registry.init import init
from calibrary.registry.registry import Registry
from calibrary.rotations import rotation_matrix
from calibrary.schemas import require
from calibrary.synthetic import Head, description, packet, write_image
from tests.calib.rigs import TrueRig, off, posed
from tests.registry.git.repositories import nobodys_git

__all__ = ["nobodys_git"]

BOARD = Board(columns=9, rows=6, square_mm=40.0)
SIZE = (800, 600)
SHOTS = 12
PLACE = Place(rotation=rotation_matrix(np.radians((0.3, -0.9, 0.5))), translation=np.array([-70.0, 2.0, 1.0]))
FLAGS = ("--board", "checkerboard:9x6", "--square-mm", "40")


def lens(seed: int) -> Calibration:
    random = np.random.default_rng(seed)
    fx = 0.95 * SIZE[0] * (1 + 0.004 * random.standard_normal())
    cx, cy = np.array(SIZE) / 2 + 4 * random.standard_normal(2)
    return Calibration(
        camera=CameraKey(image_size=SIZE),
        intrinsics=Intrinsics(fx=fx, fy=fx, cx=float(cx), cy=float(cy), image_size=SIZE),
        distortion=BrownConrady(k1=-0.1, k2=0.05, p1=2e-4, p2=-1e-4, k3=0.0),
        grade=Grade.CALIBRATED,
        provenance=Provenance(kind="synthesis"),
    )


def head(place: Place) -> Head:
    """What a RedEdge writes of a band."""
    angles = ",".join(f"{angle:.6f}" for angle in relatives_of(place.rotation.T))
    xmp = packet([description("", elements={"Camera:RigRelatives": angles})])
    return Head(exif={"Make": "Example", "Model": "Rig One"}, xmp=xmp)


@pytest.fixture(scope="module")
def taken(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, TrueRig]:
    """Frames of two bands as a payload writes them, and the truth."""
    folder = tmp_path_factory.mktemp("SET") / "000"
    folder.mkdir()
    cameras = (lens(1), lens(2))
    truth = TrueRig(
        calibrations=cameras,
        places=(Place(rotation=np.eye(3), translation=np.zeros(3)), PLACE),
        shots=poses(BOARD, cameras[0], SHOTS, 5, fill=(0.35, 0.7)),
    )
    settings = Settings(noise=1.0, blur_px=0.7)
    for band, (camera, place) in enumerate(zip(cameras, truth.places, strict=True), start=1):
        for shot, pose in enumerate(truth.shots):
            pixels = render(BOARD, camera, posed(place, pose), settings, 100 * band + shot)
            gray = pixels if pixels.ndim == 2 else pixels[..., 0]
            write_image(folder / f"IMG_{shot:04}_{band}.tif", gray, head(place))
    return folder.parent, truth


@pytest.fixture(scope="module")
def done(
    taken: tuple[Path, TrueRig], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, dict[str, Any]]:
    """The outputs of one run, and its JSON document."""
    out = tmp_path_factory.mktemp("rig")
    result = calibrate_rig(
        taken[0],
        board="checkerboard:9x6",
        square_mm=40,
        lens_model="k1k2p1p2",
        html=out / "rig.html",
        keep_corners=out / "corners",
        out=out / "camchain.yaml",
    )
    document = to_json(result)
    (out / "result.json").write_text(json.dumps(document, allow_nan=False), encoding="utf-8")
    degrees, share, z = off(result.poses["2"], taken[1].places[1])
    assert degrees < 0.02
    assert share < 0.002
    assert np.abs(z).max() < 4
    return out, document


def test_the_document_fits_its_schema_and_says_what_the_metadata_state(
    done: tuple[Path, dict[str, Any]],
) -> None:
    document = done[1]
    require(document, "rig-calibration-result-2", source="record")
    assert document["reference"] == "1"
    assert [camera["name"] for camera in document["cameras"]] == ["1", "2"]
    [stated] = document["stated"]
    assert stated["camera"] == "2"
    assert stated["rotation_deg"] < 0.03
    assert stated["translation_mm"] is None


def test_what_is_written_is_the_rig(done: tuple[Path, dict[str, Any]]) -> None:
    out, document = done
    second = read_rig(out / "camchain.yaml").cameras[1]
    assert second.pose is not None
    assert second.pose.translation_mm == pytest.approx(document["poses"]["2"]["translation_mm"], abs=1e-6)
    page = (out / "rig.html").read_text(encoding="utf-8")
    assert "Relative poses" in page
    assert "baseline (mm)" in page


@pytest.mark.usefixtures("nobodys_git")
def test_its_corners_are_solved_again_to_the_same_rig_and_become_entries(
    done: tuple[Path, dict[str, Any]],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out, document = done
    fleet = tmp_path / "fleet"
    init(fleet)
    capsys.readouterr()
    code = main(
        ["calibrate", "--rig", "--from", str(out / "corners" / "rig.json"), "--lens-model", "k1k2p1p2", "--json",
         "--compare", str(out / "camchain.yaml"), "--make", "Example", "--model", "Rig One",
         "--registry", str(fleet), "--rig-name", "mapper-2", "--yes"]
    )  # fmt: skip
    said = capsys.readouterr()
    again = json.loads(said.out)
    assert code in {0, 1}
    assert again["poses"]["2"]["rotation_deg"] == pytest.approx(
        document["poses"]["2"]["rotation_deg"], abs=1e-9
    )
    assert again["compared"][0]["rotation_deg"] < 1e-6
    if again["verdict"] == "none":
        pytest.fail(json.dumps(again["findings"]))
    assert "check objects" not in said.err, said.err
    members = {
        one.entry.rig.camera: one.entry.rig
        for one in Registry.open(fleet).snapshot().proposals()
        if one.entry.rig
    }
    assert set(members) == {"1", "2"}
    assert members["1"].pose is None
    assert members["2"].rig == "mapper-2"
    assert members["2"].pose is not None
    assert members["2"].pose.translation_std_mm is not None


def test_a_rig_is_held_to_the_use_that_is_asked_for(done: tuple[Path, dict[str, Any]]) -> None:
    corners = done[0] / "corners" / "rig.json"
    found = [calibrate_rig(corners=corners, lens_model="k1k2p1p2", use=use) for use in ("start", "metrology")]
    assert [one.is_good for one in found] == [True, False]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((), "expected frames or --from"),
        (("left", "right"), "--square-mm"),
        (("left", "right", *FLAGS, "--to", "kalibr"), "--out"),
        (("left", "right", *FLAGS, "--registry", "x", "--yes"), "--rig-name"),
        (("left", "right", *FLAGS, "--pattern", "{camera}/{shot}", "--in-order"), "give one"),
    ],
)
def test_misuse_is_told(words: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrate", "--rig", *words]) == 2
    assert said in capsys.readouterr().err


def test_frames_that_cannot_be_paired_are_an_input_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("a/101.png", "b/7.png"):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).touch()
    assert main(["calibrate", "--rig", str(tmp_path / "a"), str(tmp_path / "b"), *FLAGS]) == 3
    assert "--in-order" in capsys.readouterr().err
