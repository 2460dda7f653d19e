"""How far a lens that departs from its model may have moved the camera: a smooth field, a wandering axis, by evidence.

A field of cubic B-splines, six intervals across and four down, stands beside the lens in the normal equations. Its
coefficients have a standard deviation τ of which a few values are weighed by the evidence of the observations, none
among them; each moves the lens by some step. The camera stays as it is, and the steps enter its covariance.

On simulated flights with a ripple of 0.6 px that no radial term describes a field of four by three intervals took the
worst fx of ten from 3.5 σ to 2.2 σ, and a field of radial terms alone made it worse. On lenses without a ripple it cost
nothing.

A stabilised lens moves its principal point from image to image. Halves of a dozen images hardly show it: of photographs
by a telephone the middle four fifths gave a focal length 3.6 % off at 1.0 % of σ, while a principal point for each
image explained several times more of the squared residuals than its 24 numbers would of noise.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.distortion.base import blocks
from calibrary.records import replace
from calibrary.sfm.bundle import Bundle, Linear, lens_block, linearise, projections, reduce

INTERVALS: Final = (6, 4)
"""Four by three followed half of a ripple of half the frame, which moved fy of a fisheye's flights to one side."""
DEGREE: Final = 3
CELLS: Final = (27, 21)
"""Of the frame, which count alike where the lens is compared."""
TAUS_PX: Final = (0.01, 0.03, 0.1, 0.2, 0.4, 0.8)
"""Standard deviations of the coefficients, px at the size of the images' features."""
WANDERS_PX: Final = (0.1, 0.3, 1.0, 3.0, 10.0)
"""The same of each image's principal point; a degree of stabilisation is 15 px."""
NUMBERS: Final = 1 << 24
"""Derivatives by parameters of single images that are kept at once: 128 MiB."""


def ripple_shift(bundle: Bundle, feature_px: float) -> FloatArray:
    """Return (n, n) the mean outer product of the steps of the lens, over all fields by their evidence.

    Args:
        bundle: result of the adjustment.
        feature_px: px of the images per px at the size of feature detection.

    Raises:
        CalibrationError: the images do not determine the camera.
    """
    size, fields = len(bundle.scene.parameters), basis(bundle.tracks.pixels, bundle.tracks.image_size)
    linear = linearise(bundle.tracks, bundle.scene, bundle.place_variance, lambda _: fields)
    if linear is None:
        return np.zeros((size, size))
    beside = beside_the_lens(bundle, linear, size)
    by_lens = np.concatenate([linear.by_lens[..., :size], linear.by_lens[..., size:] @ beside], axis=2)
    return _by_evidence(bundle, replace(linear, by_lens=by_lens), np.array(TAUS_PX) * feature_px)


def wander_shift(bundle: Bundle, feature_px: float) -> FloatArray:
    """Return (n, n) the same for a principal point that is another in each image, as a stabilised lens has it.

    Raises:
        CalibrationError: the images do not determine the camera.
    """
    model = bundle.scene.model
    centre = [model.parameters.index(name) for name in ("cx", "cy")]
    shift, stds = np.zeros((len(model.parameters),) * 2), np.array(WANDERS_PX) * feature_px
    for linear in by_image(bundle, projections(bundle.tracks, bundle.scene).by_lens[..., centre]):
        shift += _by_evidence(bundle, linear, stds)
    return shift


def by_image(bundle: Bundle, derivatives: FloatArray) -> Iterator[Linear]:
    """Yield the flight with further parameters that each image has for itself, of a few images at a time.

    Args:
        bundle: result of the adjustment.
        derivatives: (N, 2, c) of the pixels by the c parameters of their own image.
    """
    tracks, (rows, _, c) = bundle.tracks, derivatives.shape
    images = np.flatnonzero(tracks.used)
    at = np.searchsorted(images, tracks.image)
    for some in blocks(len(images), max(1, NUMBERS // (2 * c * rows))):
        columns = np.zeros((rows, 2, c, some.stop - some.start))
        mine = np.flatnonzero((at >= some.start) & (at < some.stop))
        columns[mine, :, :, at[mine] - some.start] = derivatives[mine]
        flat = columns.reshape(rows, 2, -1)
        linear = linearise(tracks, bundle.scene, bundle.place_variance, lambda _: flat)  # noqa: B023  called at once
        if linear is not None:
            yield linear


def _by_evidence(bundle: Bundle, linear: Linear, stds: FloatArray) -> FloatArray:
    """Return (n, n) the mean outer product of the lens's steps by further parameters of each standard deviation."""
    size, g = len(bundle.scene.parameters), len(bundle.free)
    free = np.concatenate([bundle.free, np.arange(size, linear.by_lens.shape[2])])
    matrix, right, _ = lens_block(reduce(bundle.tracks, linear, free), len(free))
    matrix, right, at = matrix / bundle.variance, right / bundle.variance, np.arange(g, len(free))
    steps: list[FloatArray] = [np.zeros(g)]
    evidence = [-float(np.linalg.slogdet(matrix[:g, :g])[1]) / 2]
    for std in stds:
        known = matrix.copy()
        known[at, at] += std**-2
        step: FloatArray = np.asarray(np.linalg.solve(known, right), dtype=np.float64)
        steps.append(step[:g])
        evidence.append(float(right @ step - np.linalg.slogdet(known)[1]) / 2 - len(at) * np.log(std))
    # As likely none as any, and the sizes alike.
    weight = np.exp(np.array(evidence) - max(evidence)) * np.r_[1.0, np.full(len(stds), 1 / len(stds))]
    shift, found = np.zeros((size, size)), np.array(steps)
    shift[np.ix_(bundle.free, bundle.free)] = (weight[:, None] * found).T @ found / weight.sum()
    return shift


def beside_the_lens(bundle: Bundle, linear: Linear, size: int) -> FloatArray:
    """Return (k, k − m) the fields that no lens of the model and no turn of the camera imitates over the frame.

    The camera sought is the model's nearest one to the lens, so that what is left of the lens is at right angles to
    both; without that a field could stand for a longer focal length. For parameters that are held it has to stand.
    """
    tracks = bundle.tracks
    cell = (tracks.pixels / tracks.image_size * CELLS).astype(np.intp).clip(0, np.array(CELLS) - 1)
    number = cell[:, 1] * CELLS[0] + cell[:, 0]
    weight = 1.0 / np.bincount(number, minlength=CELLS[0] * CELLS[1])[number]
    imitated = np.concatenate([linear.by_lens[..., bundle.free], linear.by_pose[..., :3]], axis=2)
    both = np.einsum("n,nij,nik->kj", weight, imitated, linear.by_lens[..., size:])
    left, _, _ = np.linalg.svd(both / np.maximum(np.linalg.norm(both, axis=0), 1e-300))
    return np.asarray(left[:, both.shape[1] :])


def basis(pixels: FloatArray, image_size: tuple[int, int]) -> FloatArray:
    """Return (N, 2, k) derivatives of the pixels by the coefficients, half of them across and half down."""
    x, y = (
        _splines(pixels[:, axis] / image_size[axis] * INTERVALS[axis], INTERVALS[axis]) for axis in (0, 1)
    )
    both = (x[:, :, None] * y[:, None, :]).reshape(len(pixels), -1)
    by = np.zeros((len(pixels), 2, 2 * both.shape[1]))
    by[:, 0, : both.shape[1]] = both
    by[:, 1, both.shape[1] :] = both
    return by


def _splines(at: FloatArray, intervals: int) -> FloatArray:
    """Return (N, intervals + 3) uniform cubic B-splines at places between 0 and ``intervals``."""
    cell = np.clip(at.astype(np.intp), 0, intervals - 1)
    t = np.clip(at - cell, 0.0, 1.0)
    values = np.stack([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3], axis=1)
    by = np.zeros((len(at), intervals + DEGREE))
    np.put_along_axis(by, cell[:, None] + np.arange(DEGREE + 1), values / 6, axis=1)
    return by
