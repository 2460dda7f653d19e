"""Telling frames of a board from a flight's images, by a look at a small copy."""

from __future__ import annotations

from pathlib import Path

import cv2
import pytest

from calibrary.calib.board import parse_board
from calibrary.calib.detection import shows_board
from calibrary.errors import InputError
from calibrary.jobs.demo.flight import farmland, infrared
from tests.calib.photographs import encoded, photograph, saved


def test_every_frame_of_a_board_is_seen(tmp_path: Path) -> None:
    assert [shows_board(path) for path in saved(tmp_path / "frames", 6)] == [True] * 6


@pytest.mark.parametrize("seed", range(4))
def test_fields_are_no_board_however_they_lie(tmp_path: Path, seed: int) -> None:
    path = tmp_path / "field.jpg"
    path.write_bytes(encoded(farmland((1368, 912), seed=seed), "JPEG", quality=80))
    assert not shows_board(path)
    path.write_bytes(encoded(infrared((640, 512), seed=seed), "JPEG", quality=80))
    assert not shows_board(path)


def test_a_large_jpeg_is_made_small_by_its_decoder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    frame = photograph()[0]
    large = cv2.resize(frame, (5120, 3840), interpolation=cv2.INTER_CUBIC)
    path = tmp_path / "large.jpg"
    path.write_bytes(encoded(large, "JPEG", quality=80))
    sizes: list[tuple[int, ...]] = []
    read = cv2.imread

    def noted(*arguments: object) -> object:
        found = read(*arguments)  # type: ignore[call-overload]  # handed on as they came
        sizes.append(found.shape)
        return found

    monkeypatch.setattr(cv2, "imread", noted)
    assert shows_board(path)
    assert sizes == [(480, 640)]


def test_a_board_with_markers_is_seen_by_its_name(tmp_path: Path) -> None:
    [path] = saved(tmp_path / "frames", 1, "charuco:8x5")
    assert shows_board(path, parse_board("charuco:8x5", 40.0))


def test_what_is_no_image_is_told(tmp_path: Path) -> None:
    (tmp_path / "torn.jpg").write_bytes(b"\xff\xd8\xff")
    with pytest.raises(InputError):
        shows_board(tmp_path / "torn.jpg")
