"""What would help a flight that is flown already: what each measure would make of σ of its focal length.

Each is computed from the flight's own normal equations: surveyed points are added to them, parameters that are known
are taken out of them. What the flight cannot know of itself (whether a principal point from elsewhere is this unit's)
is for the user to judge.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from typing import Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import FloatArray, IntArray
from calibrary.calib.least_squares import inverted, marginal, reduce
from calibrary.calib.lens_models import Solvable
from calibrary.errors import CalibrationError
from calibrary.policy import FLEET
from calibrary.records import replace
from calibrary.sfm.bundle import Bundle
from calibrary.sfm.nuisances import PRECISE_M
from calibrary.sfm.sigma import CENTRE, CameraUncertainty, covariance

WORTH: Final = 0.8
"""Largest σ afterwards, as a share of that before, of what is worth its effort."""
SURVEYED: Final = 5
SURVEYED_STD_M: Final = 0.03
SAME_DATUM_M: Final = 0.05
MARKED_PX: Final = 2.0
"""What marks of one pixel in some images leave of a point's place, in pixels on the ground."""
NEAR_ZERO: Final = 2.0
"""Number of σ within which a coefficient may as well be zero."""
MOST_IMAGES: Final = 200
"""Most that ``--images`` takes."""
SMALLER: Final = (Solvable.K1K2P1P2, Solvable.K1K2)


class Help(Struct, frozen=True, kw_only=True):
    """A measure.

    Attributes:
        measure: what to do.
        sigma: standard deviation of the focal length afterwards, as a fraction.
    """

    measure: str
    sigma: float


def helps(bundle: Bundle, known: CameraUncertainty, left_out: int) -> list[Help]:
    """Return what would help this flight, what helps most first; nothing if its K may be kept fixed as it is.

    Args:
        bundle: the adjusted flight.
        known: its uncertainty.
        left_out: number of its images that were not chosen.
    """
    now = math.sqrt(known.covariance.matrix[0, 0] * known.inflation) / known.fx
    if now <= FLEET.fixed_sigma_focal or not known.separates_height:
        # What one height over flat ground does not tell, no measure but another flight or points of another height do.
        return []
    with suppress(CalibrationError):
        found = [one for one in _measures(bundle, known, left_out) if one.sigma < WORTH * now]
        return sorted(found, key=lambda one: one.sigma)
    return []


def _measures(bundle: Bundle, known: CameraUncertainty, left_out: int) -> Iterator[Help]:
    C, names = covariance(bundle) * known.inflation, bundle.scene.model.parameters
    total = known.covariance.matrix[0, 0] * known.inflation
    rest = max(total - C[0, 0], 0.0)

    def by(measure: str, noise: float, others: float = rest) -> Help:
        return Help(measure=measure, sigma=math.sqrt(max(noise, 0.0) + max(others, 0.0)) / known.fx)

    if known.held is not None:
        shift = float(known.held.parameters[0]) - known.held.free_fx
        yield by(
            "keep cx and cy at those of a board, or of a better flight of this unit",
            _given(C, [names.index(name) for name in CENTRE]),
            rest - known.held.weight * shift**2,
        )
    std = np.sqrt(np.diag(C))
    for model in SMALLER:
        further = [at for at, name in enumerate(names) if name not in model.parameters]
        small = np.abs(bundle.scene.parameters[further]) < NEAR_ZERO * std[further]
        if further and set(model.parameters) < set(names) and small.all():
            listed = ", ".join(names[at] for at in further)
            yield by(
                f"--lens-model {model.value}: {listed} may as well be zero by these images",
                _given(C, further),
            )
    used = int(bundle.tracks.used.sum())
    if (more := min(MOST_IMAGES, used + left_out)) > used:
        yield by(f"--images {more}: {left_out} images were not chosen", C[0, 0] * used / more)
    if known.geometry.metres and bundle.tracks.control is None:
        points = f"--points with {SURVEYED} surveyed points of ± {SURVEYED_STD_M * 100:.0f} cm, spread over the ground"
        if _is_precise(bundle):
            points += f", and --same-datum-m {SAME_DATUM_M:g} if positions and points are of one base station"
        yield by(points, _surveyed(bundle) * known.inflation)


def _given(C: FloatArray, at: list[int]) -> float:
    """Return the variance of fx if some parameters are known."""
    gain = np.linalg.solve(C[np.ix_(at, at)], C[at, 0])
    return float(C[0, 0] - C[0, at] @ gain)


def _surveyed(bundle: Bundle) -> float:
    """Return the variance of fx with surveyed points; in the positions' datum if these are good to centimetres."""
    linear, points = bundle.linear, _spread(bundle)
    by_point = linear.priors.by_point.copy()
    height = np.median(bundle.scene.centres[bundle.tracks.used, 2]) - np.median(bundle.scene.points[:, 2])
    std = math.hypot(SURVEYED_STD_M, MARKED_PX * float(height) / float(bundle.scene.parameters[0]))
    by_point[points] = math.sqrt(bundle.place_variance) / std
    by_offset = bundle.place_variance / SAME_DATUM_M**2 if _is_precise(bundle) else 0.0
    priors = replace(linear.priors, by_point=by_point, by_offset=by_offset)
    reduced = reduce(replace(linear, priors=priors), bundle.free)
    return float(bundle.variance * inverted(marginal(reduced, len(bundle.free))[0])[0, 0])


def _is_precise(bundle: Bundle) -> bool:
    positions = bundle.tracks.positions
    return positions is not None and float(np.nanmedian(positions.std)) < PRECISE_M


def _spread(bundle: Bundle) -> IntArray:
    """Return points far from one another, such as a surveyor marks: each the farthest from those before it."""
    counts = np.bincount(bundle.tracks.point, minlength=len(bundle.scene.points))
    often = np.flatnonzero(counts >= np.median(counts[counts > 0]))
    places = bundle.scene.points[often]
    chosen = [int(np.argmax(counts[often]))]
    while len(chosen) < min(SURVEYED, len(often)):
        apart = np.linalg.norm(places[:, None] - places[chosen], axis=2).min(axis=1)
        chosen.append(int(np.argmax(apart)))
    return np.asarray(often[chosen])
