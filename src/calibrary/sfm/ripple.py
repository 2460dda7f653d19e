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

from typing import Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.least_squares import inverted, marginal, reduce
from calibrary.calib.residual_field import splines
from calibrary.errors import CalibrationError
from calibrary.records import replace
from calibrary.sfm.bundle import Bundle, Linear, linearise, with_own

INTERVALS: Final = (6, 4)
"""Four by three followed half of a ripple of half the frame, which moved fy of a fisheye's flights to one side."""
CELLS: Final = (27, 21)
"""Of the frame, which count alike where the lens is compared."""
TAUS_PX: Final = (0.01, 0.03, 0.1, 0.2, 0.4, 0.8)
"""Standard deviations of the coefficients, px at the size of the images' features."""
WANDERS_PX: Final = (0.1, 0.3, 1.0, 3.0, 10.0)
"""The same of each image's principal point; a degree of stabilisation is 15 px."""


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
        raise CalibrationError("the adjusted flight puts a point behind an image that sees it")
    beside = beside_the_lens(bundle, linear, size)
    lens, further, nuisances = np.split(linear.shared, [size, size + fields.shape[2]], axis=2)
    free = np.concatenate([bundle.free, np.arange(size, size + beside.shape[1])])
    reduced = reduce(
        replace(linear, shared=np.concatenate([lens, further @ beside, nuisances], axis=2)), free
    )
    return _by_evidence(bundle, *marginal(reduced, len(free))[:2], np.array(TAUS_PX) * feature_px)


def wander_shift(bundle: Bundle, feature_px: float) -> FloatArray:
    """Return (n, n) the same for a principal point that is another in each image, as a stabilised lens has it.

    Raises:
        CalibrationError: the images do not determine the camera.
    """
    centre = [bundle.scene.model.parameters.index(name) for name in ("cx", "cy")]
    equations = with_own(bundle, bundle.linear.shared[..., centre])
    return _by_evidence(bundle, *equations, np.array(WANDERS_PX) * feature_px)


def _by_evidence(bundle: Bundle, matrix: FloatArray, right: FloatArray, stds: FloatArray) -> FloatArray:
    """Return (n, n) the mean outer product of the lens's steps by further parameters of each standard deviation.

    Args:
        bundle: result of the adjustment.
        matrix: (g + k, g + k) normal equations of the lens and of k further parameters.
        right: (g + k,) their right-hand side.
        stds: the standard deviations; none of the parameters is as likely as any of these.
    """
    size, g = len(bundle.scene.parameters), len(bundle.free)
    matrix, right = matrix / bundle.variance, right / bundle.variance
    own, by = inverted(matrix[:g, :g]), matrix[:g, g:]
    values, vectors = np.linalg.eigh(matrix[g:, g:] - by.T @ own @ by)
    # What the images do not tell of the further parameters is nought, and below it by rounding: their σ bounds it.
    values, along = np.maximum(values, 0.0), vectors.T @ (right[g:] - by.T @ own @ right[:g])
    steps, evidence = [np.zeros(g)], [0.0]
    for std in stds:
        further = along / (values + std**-2)
        steps.append(-own @ by @ vectors @ further)
        evidence.append(float(along @ further - np.log1p(values * std**2).sum()) / 2)
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
    imitated = np.concatenate([linear.shared[..., bundle.free], linear.kept.jac[..., :3]], axis=2)
    both = np.einsum("n,nij,nik->kj", weight, imitated, linear.by_lens[..., size:])
    left, _, _ = np.linalg.svd(both / np.maximum(np.linalg.norm(both, axis=0), 1e-300))
    return np.asarray(left[:, both.shape[1] :])


def basis(pixels: FloatArray, image_size: tuple[int, int]) -> FloatArray:
    """Return (N, 2, k) derivatives of the pixels by the coefficients that one of them shows, half across, half down."""
    x, y = (splines(pixels[:, axis] / image_size[axis] * INTERVALS[axis], INTERVALS[axis]) for axis in (0, 1))
    both = (x[:, :, None] * y[:, None, :]).reshape(len(pixels), -1)
    both = both[:, both.any(axis=0)]
    by = np.zeros((len(pixels), 2, 2 * both.shape[1]))
    by[:, 0, : both.shape[1]] = both
    by[:, 1, both.shape[1] :] = both
    return by
