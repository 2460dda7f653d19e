"""Rotations of space: as a matrix, as axis times angle, and as a quaternion."""

from __future__ import annotations

import math

import numpy as np

from calibrary.arrays import FloatArray

__all__ = ["from_quaternion", "left_jacobian", "quaternion", "rotation_matrix", "rotation_vector"]


def rotation_matrix(vector: FloatArray) -> FloatArray:
    """Rodrigues' formula: (…, 3) axis times angle in rad to (…, 3, 3)."""
    cross = _cross(vector)
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    # sin(a)/a and (1 − cos a)/a², which have no trouble at 0 in this form.
    first, second = np.sinc(angle / math.pi), 0.5 * np.sinc(angle / (2 * math.pi)) ** 2
    return np.asarray(np.eye(3) + first * cross + second * (cross @ cross))


def left_jacobian(vector: FloatArray) -> FloatArray:
    """(3, 3) J with exp(v + δ) = exp(J δ) exp(v) to first order, for (3,) axis times angle in rad.

    Source: T. Barfoot, "State estimation for robotics", 2017, equation 7.77.
    """
    angle, cross = float(np.linalg.norm(vector)), _cross(vector)
    first = 0.5 * np.sinc(angle / (2 * math.pi)) ** 2
    second = (angle - math.sin(angle)) / angle**3 if angle > 1e-3 else 1 / 6 - angle**2 / 120
    return np.asarray(np.eye(3) + first * cross + second * (cross @ cross))


def quaternion(rotation: FloatArray) -> FloatArray:
    """(4,) w, x, y, z of a (3, 3) rotation, w ≥ 0, by the part whose divisor is largest."""
    (a, b, c), trace = np.diag(rotation), float(np.trace(rotation))
    parts = np.array([trace, a, b, c])
    # Rows of 4 q qᵀ; the one of the largest part has no small divisor.
    skew = rotation - rotation.T
    w = np.array([1 + trace, skew[2, 1], skew[0, 2], skew[1, 0]])
    both = rotation + rotation.T
    x = np.array([skew[2, 1], 1 + 2 * a - trace, both[0, 1], both[0, 2]])
    y = np.array([skew[0, 2], both[0, 1], 1 + 2 * b - trace, both[1, 2]])
    z = np.array([skew[1, 0], both[0, 2], both[1, 2], 1 + 2 * c - trace])
    row = (w, x, y, z)[int(np.argmax(parts))]
    return np.asarray(row / np.linalg.norm(row) * (1.0 if row[0] >= 0 else -1.0))


def from_quaternion(values: FloatArray) -> FloatArray:
    """(3, 3) of (4,) w, x, y, z of any length but zero."""
    w, *axis = (values / np.linalg.norm(values)).tolist()
    x = np.array(axis)
    return np.asarray((w * w - x @ x) * np.eye(3) + 2 * np.outer(x, x) + 2 * w * _cross(x))


def rotation_vector(rotation: FloatArray) -> FloatArray:
    """(3,) axis times angle in rad, the angle at most π."""
    w, *axis = quaternion(rotation).tolist()
    sine = float(np.linalg.norm(axis))
    return np.array(axis) * (2.0 if sine < 1e-12 else 2 * math.atan2(sine, w) / sine)


def _cross(vector: FloatArray) -> FloatArray:
    x, y, z = np.moveaxis(vector, -1, 0)
    zero = np.zeros_like(x)
    flat = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1)
    return flat.reshape(*vector.shape[:-1], 3, 3)
