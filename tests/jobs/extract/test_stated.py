"""K of images without EXIF, from what a person knows of their camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from calibrary.calibration import Grade
from calibrary.errors import UsageError
from calibrary.evidence.context import Source
from calibrary.validation import Verdict
from tests.jobs.extract.fleet import NOBODY, P4R, gate, only, picture


@pytest.fixture
def web(tmp_path: Path) -> Path:
    picture(tmp_path / "web.jpg", (1368, 912))
    return tmp_path


@pytest.mark.parametrize(
    ("said", "fx"),
    [
        ({"focal_mm": 8.8, "sensor_mm": (13.2, None)}, 8.8 / 13.2 * 1368),
        ({"camera": "FC6310", "focal_mm": 8.8}, 8.8 / 13.2 * 1368),
        ({"camera": "FC6310"}, 3660.0 / 4),
        ({"camera": "fc6310", "focal_mm": 8.8, "sensor_mm": (13.2, 8.8)}, 8.8 / 13.2 * 1368),
    ],
)
def test_what_is_stated_of_an_image_gives_an_unproven_k(web: Path, said: dict[str, Any], fx: float) -> None:
    camera = only(gate(web, **said))
    assert camera.calibration is not None
    assert camera.camera.evidence.chosen is not None
    assert camera.camera.evidence.chosen.source is Source.STATED
    assert camera.calibration.provenance.kind == "stated"
    assert (camera.calibration.grade, camera.verdict) == (Grade.DERIVED, Verdict.UNPROVEN)
    assert camera.calibration.intrinsics.fx == pytest.approx(fx, rel=0.01)


def test_images_that_state_their_camera_keep_it(web: Path) -> None:
    picture(web / "a.jpg", (1368, 912), **NOBODY)
    models = {camera.camera.key.model for camera in gate(web, camera="FC6310").judged}
    assert models == {"FC6310", NOBODY["model"]}


@pytest.mark.parametrize(
    ("said", "why"),
    [
        ({"focal_mm": 8.8}, "--sensor-width-mm"),
        ({"sensor_mm": (13.2, None)}, "--focal-mm"),
        ({"camera": "FC6310", "sensor_mm": (13.2, None)}, "--focal-mm"),
        ({"camera": "No such"}, "none like it"),
        ({"camera": "Mavic 3 Thermal, wide"}, "do not fit it"),
    ],
)
def test_what_is_stated_without_effect_ends_the_run(web: Path, said: dict[str, Any], why: str) -> None:
    with pytest.raises(UsageError, match=why):
        gate(web, **said)


@pytest.mark.parametrize("said", [{"camera": "FC6310"}, {"focal_mm": 8.8, "sensor_mm": (13.2, 8.8)}])
def test_what_all_images_state_is_not_to_be_stated(tmp_path: Path, said: dict[str, Any]) -> None:
    picture(tmp_path / "a.jpg", **P4R)
    with pytest.raises(UsageError, match="has no effect"):
        gate(tmp_path, **said)
