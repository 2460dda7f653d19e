"""What the pixels do to the verdict of ``extract --verify`` and ``check --verify``."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import calibrary
from calibrary.calibration import Calibration, Grade
from calibrary.cli.main import main
from calibrary.distortion import BrownConrady
from calibrary.jobs.verify import look as job
from calibrary.jobs.verify.look import Look, look
from calibrary.provenance import Provenance
from calibrary.quality import Quality
from calibrary.records import replace
from calibrary.schemas import require
from calibrary.sfm.alterations import MeasuredCamera
from calibrary.sfm.engine import MatchedFlight
from calibrary.sfm.mapping import positions_of
from calibrary.sfm.pixel_check import PixelVerdict
from calibrary.validation import Severity, Use, Verdict
from tests.cli.test_calibrate_flight import SEED
from tests.cli.test_calibrate_flight import flight as images_of
from tests.jobs.extract.fleet import DEWARP, NOBODY, P4R, matrix, picture
from tests.sfm.flights import CAMERA, fly
from tests.sfm.pixel_cases import FLIGHTS, pairs_of

Pixels = Callable[..., None]
IMAGES = 9


@pytest.fixture
def pixels(monkeypatch: pytest.MonkeyPatch) -> Pixels:
    """Have the pixels show a focal length, without any."""

    def show(
        focal_px: float,
        *,
        std: float = 0.005,
        by_px: float = 0.3,
        corner_px: float = -40.0,
        centre_px: tuple[tuple[float, float], tuple[float, float]] | None = None,
    ) -> None:
        def seen(paths: list[Path], K: Calibration, **_: object) -> Look:
            found = MeasuredCamera(
                focal_px=focal_px,
                std=std,
                by_px=by_px,
                images=len(paths),
                corner_px=(corner_px, 1.0),
                split=True,
                centre_px=centre_px,
            )
            measured = replace(
                K,
                intrinsics=replace(K.intrinsics, fx=focal_px, fy=focal_px),
                grade=Grade.ADJUSTED,
                distortion=BrownConrady(k1=-0.1, k2=0.02, p1=0.0, p2=0.0, k3=0.0),
                quality=Quality(std={"fx": std * focal_px, "fy": std * focal_px}),
                provenance=Provenance(kind="pixels", tag=f"the pixels of {len(paths)} images"),
                notes=(f"start: {Calibration.SHORT}",),
            )
            return Look(chosen=len(paths), found=found, calibration=measured)

        monkeypatch.setattr("calibrary.jobs.extract.pixels.look", seen)

    return show


def flight(folder: Path, tags: dict[str, Any]) -> Path:
    for number in range(IMAGES):
        picture(folder / f"flight/{number}.jpg", **tags)
    return folder / "flight"


def fx_of(folder: Path, tags: dict[str, Any]) -> float:
    [camera] = calibrary.extract(flight(folder, tags)).cameras
    assert camera.calibration is not None
    return camera.calibration.intrinsics.fx


@pytest.mark.parametrize(
    ("tags", "factor", "std", "before", "after"),
    [
        (P4R, 1.0, 0.005, Verdict.VALID, Verdict.VALID),
        (P4R, 1.04, 0.005, Verdict.VALID, Verdict.UNPROVEN),
        (P4R, 1.3, 0.005, Verdict.VALID, Verdict.UNPROVEN),  # the catalogue agrees with the tags
        (P4R, 1.3, 0.2, Verdict.VALID, Verdict.VALID),  # the pixels do not know
        (NOBODY, 1.01, 0.005, Verdict.UNPROVEN, Verdict.VALID),  # an assumed sensor is no K: theirs is
    ],
)
def test_pixels_add_to_the_verdict(
    tags: dict[str, Any],
    factor: float,
    std: float,
    before: Verdict,
    after: Verdict,
    tmp_path: Path,
    pixels: Pixels,
) -> None:
    fx = fx_of(tmp_path, tags)
    pixels(fx * factor, std=std)
    [plain] = calibrary.extract(tmp_path / "flight").cameras
    assert plain.verdict is before
    [camera] = calibrary.extract(tmp_path / "flight", verify=True).cameras
    assert camera.verdict is after


ALONE = NOBODY | {"focal_plane_resolution": ((54720, 132), (54720, 132)), "focal_plane_unit": 4}
"""In no catalogue either, and with a focal plane resolution in px per mm as its single source."""


@pytest.mark.parametrize(
    ("factor", "std", "verdict"),
    [
        (1.01, 0.01, Verdict.VALID),
        (1.01, 0.03, Verdict.UNPROVEN),  # ±2 σ is not inside 5 %
        (1.04, 0.005, Verdict.VALID),  # the K of the pixels, which a nominal one may differ from by 5 %
        (1.3, 0.01, Verdict.REJECTED),  # two sources that contradict each other, and no third
    ],
)
def test_pixels_are_the_second_source_of_a_camera_with_one(
    factor: float, std: float, verdict: Verdict, tmp_path: Path, pixels: Pixels
) -> None:
    fx = fx_of(tmp_path, ALONE)
    [before] = calibrary.extract(tmp_path / "flight").cameras
    assert before.verdict is Verdict.UNPROVEN
    pixels(fx * factor, std=std)
    [camera] = calibrary.extract(tmp_path / "flight", verify=True).cameras
    assert camera.verdict is verdict


def test_pixels_decide_where_tags_contradict_each_other(tmp_path: Path, pixels: Pixels) -> None:
    tags = ALONE | {"focal_35mm": 70}
    fx = 5472.0
    [before] = calibrary.extract(flight(tmp_path, tags)).cameras
    assert before.verdict is Verdict.REJECTED
    pixels(fx * 1.004)
    [camera] = calibrary.extract(tmp_path / "flight", verify=True).cameras
    assert camera.verdict is Verdict.VALID
    [disbelieved] = [one for one in camera.findings if one.rule == "contradicted"]
    assert disbelieved.severity is Severity.NOTE
    assert disbelieved.message.endswith("the pixels of 9 images agree with K, and not with it")


def test_k_of_a_crop_is_that_of_its_pixels_and_a_start(tmp_path: Path, pixels: Pixels) -> None:
    """The tags are of the frame before, so they contradict the pixels rightly, and do not count."""
    cropped = P4R | {"pixel_size": (5472, 3648)}
    for number in range(IMAGES):
        picture(tmp_path / f"flight/{number}.jpg", size=(2736, 1824), **cropped)
    [before] = calibrary.extract(tmp_path / "flight").cameras
    assert before.verdict is Verdict.UNPROVEN
    pixels(3666.7)
    [camera] = calibrary.extract(tmp_path / "flight", verify=True).cameras
    assert camera.calibration is not None
    assert (camera.verdict, camera.calibration.intrinsics.fx) == (Verdict.VALID, 3666.7)
    assert camera.use is not None
    assert camera.use.use is Use.START
    assert camera.why is not None
    assert camera.why.startswith("the pixels of 9 images is used")


def test_k_by_the_pixels_that_the_tags_contradict_is_written_as_a_seed(
    tmp_path: Path, pixels: Pixels
) -> None:
    fx = fx_of(tmp_path, P4R)
    pixels(fx * 1.2)
    calibrary.extract(tmp_path / "flight", verify=True, out=tmp_path / "K.npy")
    assert np.load(tmp_path / "K_seed.npy")[0, 0] == pytest.approx(fx * 1.2)
    assert (tmp_path / "K_unproven.npy").is_file()


@pytest.mark.parametrize(
    ("moved", "std", "severity"),
    [
        (1.0, 5.0, Severity.PASS),
        (120.0, 5.0, Severity.UNPROVEN),
        (120.0, 60.0, Severity.NOTE),  # they do not determine it
    ],
)
def test_the_principal_point_is_judged_too(
    moved: float, std: float, severity: Severity, tmp_path: Path, pixels: Pixels
) -> None:
    tags = P4R | {"dewarp": DEWARP}
    [camera] = calibrary.extract(flight(tmp_path, tags)).cameras
    assert camera.calibration is not None
    K = camera.calibration.intrinsics
    pixels(K.fx, corner_px=-700.0, centre_px=((K.cx + moved, K.cy), (std, std)))
    [camera] = calibrary.extract(tmp_path / "flight", verify=True).cameras
    [finding] = [one for one in camera.findings if one.rule == "pixels-centre"]
    assert finding.severity is severity
    assert f"{K.cx + moved:.1f} ± {std:.1f}" in finding.message


def test_only_cameras_without_a_valid_k_are_looked_at_if_wanted(tmp_path: Path, pixels: Pixels) -> None:
    flight(tmp_path, ALONE)
    for number in range(IMAGES):
        picture(tmp_path / f"flight/known{number}.jpg", **P4R)
    pixels(5472.0)
    report = calibrary.extract(tmp_path / "flight", verify="unproven")
    looked = {one.camera.model: one.pixels is not None for one in report.cameras}
    assert looked == {"One": True, "FC6310R": False}


def test_a_contradiction_states_both_figures_and_what_would_do_that(tmp_path: Path, pixels: Pixels) -> None:
    fx = fx_of(tmp_path, P4R)
    pixels(fx * 1.25)
    [camera] = calibrary.extract(tmp_path / "flight", verify=True).cameras
    assert camera.why is not None
    assert f"fx = {fx * 1.25:.1f} px ± 0.5%, +25.0% from K's {fx:.1f} px" in camera.why
    assert "a digital zoom of 1.25× would do that" in camera.why


def test_pixels_that_cannot_tell_are_a_note(tmp_path: Path, pixels: Pixels) -> None:
    pixels(fx_of(tmp_path, P4R) * 1.2, by_px=3.0)
    [camera] = calibrary.extract(tmp_path / "flight", verify=True).cameras
    [finding] = [one for one in camera.findings if one.rule == "pixels"]
    assert finding.severity is Severity.NOTE
    assert "cannot be told apart" in finding.message


def test_distortion_that_the_camera_removed_makes_k_unproven(tmp_path: Path, pixels: Pixels) -> None:
    tags = P4R | {"dewarp": DEWARP}
    pixels(fx_of(tmp_path, tags), corner_px=1.0)
    [camera] = calibrary.extract(tmp_path / "flight", verify=True).cameras
    assert camera.verdict is Verdict.UNPROVEN
    assert "it was removed already" in (camera.why or "")


@pytest.mark.parametrize("factor", [1.5, 1 / 1.5])
def test_a_digital_zoom_that_the_tags_state_explains_a_contradiction(
    factor: float, tmp_path: Path, pixels: Pixels
) -> None:
    """Whether K has the zoom and the pixels have not, or the other way round."""
    tags = P4R | {"digital_zoom": (3, 2)}
    pixels(fx_of(tmp_path, tags) * factor)
    [camera] = calibrary.extract(tmp_path / "flight", verify=True).cameras
    [finding] = [one for one in camera.findings if one.rule == "zoomed"]
    assert "DigitalZoomRatio states 1.5×" in finding.message
    assert finding.severity is Severity.UNPROVEN
    pixels(fx_of(tmp_path, tags) * 1.2)
    [camera] = calibrary.extract(tmp_path / "flight", verify=True).cameras
    assert not [one for one in camera.findings if one.rule in {"zoomed", "cropped"}]


def test_too_few_images_are_said_to_be_so_without_a_look(tmp_path: Path) -> None:
    paths = [tmp_path / f"{number}.jpg" for number in range(5)]
    [camera] = calibrary.extract(flight(tmp_path, P4R)).cameras
    assert camera.calibration is not None
    check = look(paths, camera.calibration).check(camera.calibration, 0.05)
    assert (check.verdict, check.reason) == (PixelVerdict.CANNOT_TELL, "5 images of this camera, need 8")


@pytest.mark.parametrize(
    ("plan", "verdict"),
    [("flat, two heights, RTK", PixelVerdict.AGREES), ("flat, two heights", PixelVerdict.CANNOT_TELL)],
)
def test_exact_positions_tell_the_focal_length_from_the_height(
    plan: str, verdict: PixelVerdict, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Positions as the images state them, σ and all; what COLMAP finds is simulated."""
    tracks, scene = fly(FLIGHTS[plan], SEED)
    monkeypatch.setattr(
        job, "match", lambda images, *, folder, **_: MatchedFlight(folder=folder, images=tuple(images))
    )
    monkeypatch.setattr(job, "read_matches", lambda _: pairs_of(tracks))
    monkeypatch.setattr(
        job,
        "reconstruct",
        lambda matched, **_: (replace(tracks, positions=positions_of(matched.images)), scene),
    )
    images = images_of(tmp_path / "flight", FLIGHTS[plan])
    assert look(sorted(images.iterdir()), CAMERA).check(CAMERA, 0.05).verdict is verdict


def test_the_report_the_page_and_the_terminal_say_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], pixels: Pixels
) -> None:
    fx = fx_of(tmp_path, P4R)
    pixels(fx)
    monkeypatch.chdir(tmp_path)
    assert main(["extract", "flight", "--verify", "--html", "page.html"]) == 0
    assert "the pixels of 9 images agree" in " ".join(capsys.readouterr().out.split())
    report = json.loads((tmp_path / "K_matrix.json").read_text())
    require(report, "report-1")
    assert report["cameras"][0]["pixels"]["verdict"] == "agrees"
    page = (tmp_path / "page.html").read_text()
    assert "K compared with the pixels" in page
    assert "pixels of 9 images" in page


@pytest.mark.parametrize(("factor", "code", "verdict"), [(1.0, 0, "right"), (0.9, 1, "off")])
def test_a_file_is_checked_by_the_pixels_too(
    factor: float,
    code: int,
    verdict: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    pixels: Pixels,
) -> None:
    fx = fx_of(tmp_path, P4R)
    pixels(fx * factor)
    K = matrix(tmp_path / "K.npy", fx)
    assert main(["check", str(tmp_path / "flight"), str(K), "--verify", "--json"]) == code
    document = json.loads(capsys.readouterr().out)
    require(document, "check-1")
    [file] = document["files"]
    assert (file["verdict"], file["pixels"]["difference"]) == (verdict, pytest.approx(factor - 1, abs=1e-3))


def test_without_any_file_the_pixels_are_held_against_the_tags(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], pixels: Pixels
) -> None:
    pixels(fx_of(tmp_path, P4R))
    assert main(["check", str(tmp_path / "flight"), "--verify"]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == "the pixels say of the images' own K: agrees"
    pixels(fx_of(tmp_path, P4R) * 0.9)
    assert main(["check", str(tmp_path / "flight"), "--verify"]) == 1
