"""What the catalogue knows of a fixed lens is evidence where EXIF states no focal length that can be believed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from calibrary.calibration import Grade
from calibrary.catalogue import load_catalogue
from calibrary.evidence.metadata import ImageMetadata
from calibrary.known_camera import KnownCamera, Projection
from calibrary.policy import FLEET, SOURCE, Policy
from calibrary.validation import Verdict
from tests.jobs.extract.fleet import gate, judge_known, only, picture

FIXED = [
    camera
    for camera in load_catalogue()
    if camera.zoom_mm is None
    and camera.projection is Projection.PERSPECTIVE
    and camera.native_size is not None
    and camera.fx_over_w_at(camera.focal_mm) is not None
    # Of two cameras of one Model that write the same frame, nothing tells which it is.
    and (camera.names[0], camera.sub_camera) not in {("ZH20N", "thermal"), ("M30T", "wide")}
]
PHANTOM_4: dict[str, Any] = {"make": "DJI", "model": "FC330"}
BY_THE_CATALOGUE = 3.61 / 6.3175 * 4000
SKYDIO: dict[str, Any] = {"make": "Skydio", "model": "2"}


@pytest.mark.parametrize(
    "known", FIXED, ids=lambda known: f"{known.make} {known.names[0]} {known.sub_camera}"
)
def test_a_fixed_lens_without_a_focal_length_has_its_k(known: KnownCamera) -> None:
    assert known.native_size is not None
    stated = ImageMetadata(
        size=known.native_size, make=known.make, model=known.names[0], lens=known.lens, has_exif=True
    )
    camera = judge_known(stated)
    expected = known.fx_over_w_at(known.focal_mm)
    assert expected is not None
    assert camera.calibration is not None
    assert camera.calibration.grade is Grade.DESIGN
    assert camera.calibration.intrinsics.fx == pytest.approx(
        expected * known.native_size[0], rel=known.spread or 0.03
    )
    # Thermal cameras write no focal length, so theirs lacks nothing.
    assert camera.verdict is (Verdict.VALID if known.sub_camera == "thermal" else Verdict.UNPROVEN)


@pytest.mark.parametrize("focal_mm", [(0, 100), None, (0, 0), (5, 0)], ids=["0", "absent", "0/0", "5/0"])
def test_a_focal_length_that_is_none_does_not_reject_a_known_camera(
    tmp_path: Path, focal_mm: tuple[int, int] | None
) -> None:
    picture(tmp_path / "a.jpg", (4000, 3000), **PHANTOM_4, focal_mm=focal_mm)
    camera = only(gate(tmp_path))
    assert camera.verdict is Verdict.UNPROVEN
    assert camera.calibration is not None
    assert camera.calibration.intrinsics.fx == pytest.approx(BY_THE_CATALOGUE, rel=0.01)
    assert "original files" not in str(camera.camera.remedy)


@pytest.mark.parametrize(("policy", "seed"), [(SOURCE, 3200.0)])
def test_the_source_document_has_no_k_without_a_focal_length(
    tmp_path: Path, policy: Policy, seed: float
) -> None:
    picture(tmp_path / "a.jpg", (4000, 3000), **PHANTOM_4, focal_mm=(0, 100))
    camera = only(gate(tmp_path, policy=policy))
    assert (camera.verdict, camera.calibration) == (Verdict.REJECTED, None)
    assert camera.fallback is not None
    assert camera.fallback.seed is not None
    assert camera.fallback.seed.intrinsics.fx == seed


def test_a_focal_length_that_a_model_writes_wrong_is_believed_where_it_is_the_lens(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg", (4056, 3040), **SKYDIO, focal_mm=(37, 10))
    camera = only(gate(tmp_path))
    assert camera.verdict is not Verdict.REJECTED
    assert camera.calibration is not None
    assert camera.calibration.intrinsics.fx == pytest.approx(2387.0, rel=0.01)


def test_a_focal_length_that_a_model_writes_wrong_gives_way_to_the_lens(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg", (4056, 3040), **SKYDIO, focal_mm=(20, 1))
    camera = only(gate(tmp_path))
    assert camera.verdict is Verdict.UNPROVEN
    assert camera.calibration is not None
    assert camera.calibration.intrinsics.fx == pytest.approx(2387.0, rel=0.01)
    assert "known to write a wrong one" in str(camera.reason)


def test_the_owner_of_an_original_is_not_asked_for_it(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg", (4000, 3000), make="Example", model="Scanner", software="1.0")
    assert (
        only(gate(tmp_path)).camera.remedy == "register the camera (--registry), or give its K (--fallback-k)"
    )


def test_a_start_is_what_the_catalogue_knows_even_if_a_tag_is_rejected(tmp_path: Path) -> None:
    picture(tmp_path / "a.jpg", (4000, 3000), **PHANTOM_4, focal_mm=(20, 1))
    camera = only(gate(tmp_path, policy=FLEET))
    assert camera.verdict is Verdict.REJECTED
    assert camera.fallback is not None
    assert camera.fallback.seed is not None
    assert camera.fallback.seed.intrinsics.fx == pytest.approx(BY_THE_CATALOGUE, rel=0.01)
