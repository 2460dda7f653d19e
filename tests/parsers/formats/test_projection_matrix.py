"""Projection matrices, against OpenCV's decomposition and against the K they were made of."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from calibrary import parsers
from calibrary.calibration import Calibration, Grade
from calibrary.errors import MissingTagError, ParseError, UnknownFormatError
from tests.parsers.samples import Sample
from tests.thorough import examples

SIZE = (1920, 1080)
K = np.array([[1604.3, 1.7, 963.7], [0, 1601.1, 541.9], [0, 0, 1]])


def matrix(seed: int, factor: float = 1.0) -> NDArray[np.float64]:
    rng = np.random.default_rng(seed)
    R = cv2.Rodrigues(rng.uniform(-2, 2, 3))[0]
    return factor * K @ np.column_stack([R, rng.uniform(-5, 5, 3)])


def text(P: NDArray[np.float64]) -> bytes:
    return "".join(" ".join(map(repr, row)) + "\n" for row in P.tolist()).encode()


def read(data: bytes, **options: str) -> Calibration:
    [calibration] = parsers.decode(data, name="cam1.Pmat.cal", image_size=SIZE, options=options)
    return calibration


SAMPLES = {"projection_matrix": Sample(text(matrix(1)))}


@settings(deadline=None, max_examples=examples(12))
@given(seed=st.integers(0, 2**32 - 1), factor=st.sampled_from([1.0, -1.0, 3e-4, -2e5]))
def test_k_is_what_the_matrix_was_made_of(seed: int, factor: float) -> None:
    found = read(text(matrix(seed, factor)), origin="corner").intrinsics.matrix
    np.testing.assert_allclose(found, K, rtol=1e-9, atol=1e-8)


def test_k_is_what_opencv_decomposes() -> None:
    P = matrix(17)
    expected = cv2.decomposeProjectionMatrix(P)[0]
    found = read(text(P)).intrinsics.matrix
    np.testing.assert_allclose(
        found - [[0, 0, 0.5], [0, 0, 0.5], [0, 0, 0]], expected / expected[2, 2], atol=1e-8
    )


def test_distortion_is_unknown_and_the_grade_derived() -> None:
    calibration = read(text(matrix(17)))
    assert calibration.distortion is None
    assert calibration.grade is Grade.DERIVED
    assert any("nothing in the file says" in note for note in calibration.notes)


def test_the_image_size_is_asked_for() -> None:
    with pytest.raises(MissingTagError, match="--image-size"):
        parsers.decode(text(matrix(17)), name="x.cal")


def test_a_pose_is_no_camera() -> None:
    with pytest.raises(ParseError, match="pose"):
        read(text(np.linalg.inv(K) @ matrix(17)))


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"1 2 3 4\n2 4 6 8\n0 0 1 0\n", "no inverse"),
        (b"0 0 0 0\n0 0 0 0\n0 0 0 0\n", "no inverse"),
        (b"1 2 3 4\n2 4 6 8\n", "2 rows"),
        (b"1 2 3 4\n2 4 6\n1 1 1 1\n", "3 numbers, expected 4"),
        (b"1 2 3 4\n2 4 6,5 1\n1 1 1 1\n", "decimal point"),
    ],
)
def test_a_broken_file_names_what_is_wrong(data: bytes, message: str) -> None:
    with pytest.raises(ParseError, match=message):
        parsers.decode(data, name="x.cal", format="projection_matrix", image_size=SIZE)


def test_twelve_numbers_in_another_shape_are_not_claimed() -> None:
    with pytest.raises(UnknownFormatError):
        read(b"1 2 3\n4 5 6\n7 8 9\n10 11 12\n")
