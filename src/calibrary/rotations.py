"""Rotations in 3-D as matrices, rotation vectors (axis times angle) and quaternions."""

from __future__ import annotations

import math

from calibrary.arrays import FloatArray, np


def rotation_matrix(vector: FloatArray) -> FloatArray:
    """Convert rotation vectors, (…, 3) rad, to rotation matrices, (…, 3, 3), by Rodrigues' formula."""
    cross = _cross(vector)
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    # sin(a)/a and (1 − cos a)/a²; written with sinc, both are exact at a = 0.
    first, second = np.sinc(angle / math.pi), 0.5 * np.sinc(angle / (2 * math.pi)) ** 2
    return np.asarray(np.eye(3) + first * cross + second * (cross @ cross))


def left_jacobian(vector: FloatArray) -> FloatArray:
    """Return J, (3, 3), with exp(v + δ) = exp(J δ) exp(v) to first order, for a rotation vector v, (3,) rad.

    Source: T. Barfoot, "State estimation for robotics", 2017, equation 7.77.
    """
    angle, cross = float(np.linalg.norm(vector)), _cross(vector)
    first = 0.5 * np.sinc(angle / (2 * math.pi)) ** 2
    # The next term of the series, angle²/120, changes J by 1e-14 where the series takes over.
    second = (angle - math.sin(angle)) / angle**3 if angle > 1e-3 else 1 / 6
    return np.asarray(np.eye(3) + first * cross + second * (cross @ cross))


def quaternion(rotation: FloatArray) -> FloatArray:
    """Convert a rotation matrix, (3, 3), to a unit quaternion (w, x, y, z) with w ≥ 0."""
    (a, b, c), trace = np.diag(rotation), float(np.trace(rotation))
    parts = np.array([trace, a, b, c])
    # Rows of 4 q qᵀ; dividing by the largest component is numerically stable.
    skew = rotation - rotation.T
    w = np.array([1 + trace, skew[2, 1], skew[0, 2], skew[1, 0]])
    both = rotation + rotation.T
    x = np.array([skew[2, 1], 1 + 2 * a - trace, both[0, 1], both[0, 2]])
    y = np.array([skew[0, 2], both[0, 1], 1 + 2 * b - trace, both[1, 2]])
    z = np.array([skew[1, 0], both[0, 2], both[1, 2], 1 + 2 * c - trace])
    row = (w, x, y, z)[int(np.argmax(parts))]
    return np.asarray(row / np.linalg.norm(row) * (1.0 if row[0] >= 0 else -1.0))


def from_quaternion(values: FloatArray) -> FloatArray:
    """Convert a quaternion (w, x, y, z) of any length except zero to a rotation matrix, (3, 3)."""
    w, *axis = (values / np.linalg.norm(values)).tolist()
    x = np.array(axis)
    return np.asarray((w * w - x @ x) * np.eye(3) + 2 * np.outer(x, x) + 2 * w * _cross(x))


def rotation_vector(rotation: FloatArray) -> FloatArray:
    """Convert a rotation matrix, (3, 3), to a rotation vector, (3,) rad, with an angle of at most π."""
    w, *axis = quaternion(rotation).tolist()
    sine = float(np.linalg.norm(axis))
    return np.array(axis) * (2.0 if sine < 1e-12 else 2 * math.atan2(sine, w) / sine)


def _cross(vector: FloatArray) -> FloatArray:
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    flat = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1)
    return flat.reshape(*vector.shape[:-1], 3, 3)
