"""Rotations in their three forms, against OpenCV and against one another."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from calibrary.rotations import (
    from_quaternion,
    left_jacobian,
    quaternion,
    rotation_matrix,
    rotation_vector,
)

VECTORS = [(0, 0, 0), (1e-9, 0, 0), (0.3, -0.2, 0.9), (0, np.pi, 0), (3.1, 0.2, -0.1), (-1.2, 1.9, 1.4)]


@pytest.mark.parametrize("vector", VECTORS)
def test_every_form_is_the_rotation_that_opencv_makes_of_it(vector: tuple[float, float, float]) -> None:
    given = np.array(vector, dtype=np.float64)
    peer = np.asarray(cv2.Rodrigues(given)[0], dtype=np.float64)
    assert rotation_matrix(given) == pytest.approx(peer, abs=1e-12)
    assert rotation_matrix(rotation_vector(peer)) == pytest.approx(peer, abs=1e-12)
    assert from_quaternion(quaternion(peer)) == pytest.approx(peer, abs=1e-12)


def test_a_quaternion_starts_with_its_real_part() -> None:
    assert quaternion(rotation_matrix(np.array([0.0, 0.0, np.pi / 2]))) == pytest.approx(
        [np.sqrt(0.5), 0, 0, np.sqrt(0.5)]
    )


@pytest.mark.parametrize("vector", [(0.3, -0.2, 0.9), (9e-4, 1e-4, 0), (2.0, 1.0, -1.0)])
def test_the_left_jacobian_is_the_slope_of_the_rotation(vector: tuple[float, float, float]) -> None:
    given, step = np.array(vector), 1e-6
    for axis in np.eye(3):
        turn = rotation_matrix(given + step * axis) @ rotation_matrix(given - step * axis).T
        assert rotation_vector(turn) / (2 * step) == pytest.approx(left_jacobian(given) @ axis, abs=1e-8)


def test_a_quaternion_of_any_length_is_the_rotation_of_its_direction() -> None:
    turn = rotation_matrix(np.array([0.3, -0.2, 0.9]))
    assert from_quaternion(-3.7 * quaternion(turn)) == pytest.approx(turn, abs=1e-12)
