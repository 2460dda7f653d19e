from __future__ import annotations

import json
import os
from datetime import date
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibrary.calib.corners_file import decode_corners, encode_corners, read_corners, write_corners
from calibrary.calib.observations import ControlPoints, Observations, View
from calibrary.calibration import CameraKey
from calibrary.errors import InputError, ParseError
from calibrary.records import replace

from .solving import BOARD, Session, shoot

SMALL = shoot(how=Session(views=2), seed=1)


def _document(**changes: object) -> bytes:
    return json.dumps({**json.loads(encode_corners(SMALL)), **changes}).encode()


@given(st.lists(st.tuples(*[st.floats(-1e5, 1e5)] * 2), min_size=1, max_size=8))
def test_corners_come_back_bit_for_bit(points: list[tuple[float, float]]) -> None:
    view = View(name="a.jpg", sha256="0" * 64, ids=np.arange(len(points)), image_points=np.array(points))
    seen = replace(SMALL, views=(view,), focus="manual", firmware="01.02")
    back = decode_corners(encode_corners(seen))
    assert back.views[0].image_points.tobytes() == view.image_points.tobytes()
    assert (back.board, back.camera, back.focus, back.firmware) == (BOARD, seen.camera, "manual", "01.02")
    assert encode_corners(back) == encode_corners(seen)


def test_the_days_of_the_frames_come_back_and_unknown_ones_are_null() -> None:
    days = (date(2019, 5, 17), date(2019, 5, 18))
    assert decode_corners(encode_corners(replace(SMALL, taken=days))).taken == days
    assert json.loads(encode_corners(SMALL))["taken"] is None
    for wrong in ["2019-05-17"], ["2019-05-17", "2019-02-30"], "2019-05-17":
        with pytest.raises(ParseError, match="taken"):
            decode_corners(_document(taken=wrong))


def test_control_points_come_back() -> None:
    points = ControlPoints(points=np.random.default_rng(0).normal(0, 1e5, (9, 3)))
    view = View(name="a.jpg", ids=np.arange(9), image_points=np.ones((9, 2)))
    seen = Observations(board=points, image_size=(640, 480), views=(view,), camera=CameraKey())
    np.testing.assert_array_equal(decode_corners(encode_corners(seen)).board.points, points.points)


def test_a_file_is_written_and_read(tmp_path: Path) -> None:
    write_corners(SMALL, tmp_path / "corners.json")
    assert len(read_corners(tmp_path / "corners.json").views) == 2


def _with_view(**changes: object) -> bytes:
    document = json.loads(encode_corners(SMALL))
    document["views"][1].update(changes)
    return json.dumps(document).encode()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is not JSON"),
        (b"\xff\xfe", "not UTF-8"),
        (b"[" * 100_000, "is not JSON"),
        (b'{"schema": "corners-1", "schema": "corners-1"}', "duplicate key"),
        (b'{"views": [NaN]}', "NaN is not a number"),
        (b"9" * 5000, "is not JSON"),
        (b"[]", "expected a map"),
        (_document(schema="corners-2"), "corners-1"),
        (_document(pixel_origin="centre"), "corner"),
        (_document(image_size=[1920, 0]), "at least 1"),
        (_document(board=None), "either a board or control_points_mm"),
        (_document(extra=1), "not a valid key"),
        (_with_view(ids=[0, 0]), "expected as many"),
        (_with_view(ids=[0] * 88), "each once"),
        (_with_view(ids=[*range(87), 88]), "below 88"),
        (_with_view(ids=[*range(87), 0.5]), r"ids\[87\]: Expected int"),
        (_with_view(x=[1e999] * 88), "not finite"),
        (_with_view(x=[True] * 88), "Expected float, got bool"),
        (_with_view(x=["1"] * 88), "Expected float, got str"),
        (_with_view(x=[[1.0]] * 88), "Expected float, got array"),
        (_with_view(x=[10**400] * 88), "out of range"),
        (_with_view(sha256="x"), "matches"),
    ],
)
def test_a_broken_document_is_refused_in_one_line(content: bytes, words: str) -> None:
    with pytest.raises(ParseError, match=words) as error:
        decode_corners(content.replace(b"Infinity", b"1e999"), source="corners.json")
    assert str(error.value).startswith("corners.json: ")
    assert "\n" not in str(error.value)


@given(st.binary(max_size=60))
def test_noise_is_refused_and_nothing_worse(content: bytes) -> None:
    with pytest.raises(ParseError):
        decode_corners(content)


def test_what_is_no_file_is_refused_without_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path, tmp_path / "pipe", tmp_path / "missing.json"):
        with pytest.raises(InputError, match=r"regular file|cannot be read"):
            read_corners(path)
