"""Numerical difference of two calibrations at one image size: parameters, projections, image scale, uncertainty."""

from __future__ import annotations

import math
from typing import Annotated, Final

import numpy as np
from msgspec import Struct

from calibrary.arrays import BoolArray
from calibrary.calib.projection_difference import (
    GRID,
    ProjectionDifference,
    pixel_grid,
    projection_difference,
)
from calibrary.calibration import Calibration
from calibrary.errors import CalibraryError
from calibrary.jobs.diff.common_numbers import K_NAMES, Common, common_numbers
from calibrary.jobs.diff.lens_rays import axial, pinholes
from calibrary.jobs.diff.uncertainty import (
    Basis,
    Scale,
    Significance,
    Spread,
    basis_of,
    covariances_of,
    image_scale,
    is_usual,
    noise_test,
    spread_of,
    std_of,
)
from calibrary.jobs.diff.wording import percent, pixels
from calibrary.policy import Policy
from calibrary.records import Meta, Record, replace

BLIND_SHARE: Final = 0.05
"""Fraction of the image covered by only one of two lenses above which the border alone cannot be the cause."""
LARGE_SHARE: Final = 0.1
"""Fraction of the image with an uncertainty above the limit beyond which the corners alone cannot be the cause."""


class Parameter(Record):
    """One parameter of both calibrations.

    Attributes:
        name: fx, fy, cx, cy, skew, or a distortion coefficient.
        a, b: values; None if the calibration has no such parameter.
        std_a, std_b: measured standard deviations; None if not stated.
        delta: b − a.
        z: delta ÷ its standard deviation.
    """

    name: str
    a: float | None
    b: float | None
    std_a: float | None
    std_b: float | None
    delta: float | None
    z: float | None


class Ground(Record):
    """Effect of a difference on a map.

    Attributes:
        altitude_m: above ground.
        gsd_cm: ground sampling distance at this altitude, for nadir images.
        rms_cm, max_cm: RMS and maximum of the pixel differences, projected to the ground.
        height_cm: error of heights due to the difference in image scale, positive if B magnifies more.
    """

    altitude_m: Annotated[float, Meta(gt=0)]
    gsd_cm: Annotated[float, Meta(ge=0)]
    rms_cm: Annotated[float, Meta(ge=0)]
    max_cm: Annotated[float, Meta(ge=0)]
    height_cm: float


class Numbers(Struct, frozen=True, kw_only=True, eq=False):
    """Numerical difference of two calibrations at a common image size.

    Attributes:
        a, b: at the common image size.
        parameters: all parameters of both.
        common: which of them are equal to the last digit.
        difference: between the projections over the whole image, after the rotation that minimises its RMS.
        focal_change: Δf / f, of fx or fy, whichever is larger.
        scale: change of the image scale: the part of Δf / f that the distortion does not compensate.
        significance: of the difference.
        spread_a, spread_b: uncertainty of each, and its source.
        blind: (R, C) True where only one of the two has a projection.
        policy: policy with the limits.
        lens_compared: False if one of the distortions is unknown and only K was compared.
    """

    a: Calibration
    b: Calibration
    parameters: tuple[Parameter, ...]
    common: Common
    difference: ProjectionDifference
    focal_change: float
    scale: Scale
    significance: Significance
    spread_a: Spread
    spread_b: Spread
    blind: BoolArray
    policy: Policy
    lens_compared: bool

    @property
    def is_measured(self) -> bool:
        """Whether the uncertainty of the difference is based on a measured covariance."""
        return self.significance.basis in {Basis.BOTH, Basis.ONE}

    @property
    def matters(self) -> bool:
        """Whether the projections differ by more than the policy's limits, regardless of noise."""
        seen = self.difference
        return (
            seen.rms_px >= self.policy.drift_rms_px
            or seen.max_px >= self.policy.drift_max_px
            or abs(self.scale.change) >= self.policy.drift_focal
            or float(self.blind.mean()) >= BLIND_SHARE
        )

    @property
    def unknown(self) -> BoolArray:
        """Mask (R, C) of pixels without a result: one has no projection, or the measured noise exceeds the limit."""
        std = self.difference.std_px
        if std is None or not self.is_measured:
            return self.blind
        noisy = self.difference.region & (np.nan_to_num(std, nan=np.inf) > self.policy.drift_max_px)
        return np.asarray(self.blind | noisy, dtype=np.bool_)

    @property
    def is_noise_large(self) -> bool:
        """Whether the measured uncertainty exceeds the limits, so that agreement proves little."""
        std = self.difference.std_px
        if std is None or not self.is_measured:
            return False
        unknown = self.unknown
        known = std[self.difference.region & ~unknown]
        return (
            float(unknown.mean()) >= LARGE_SHARE
            or float(np.sqrt(np.mean(known**2))) >= self.policy.drift_rms_px
            or (self.scale.std or 0.0) >= self.policy.drift_focal
        )

    def ground(self, altitude_m: float) -> Ground:
        """Effect of the difference on a map, for an altitude above ground in m."""
        gsd_cm = 100 * altitude_m / axial(self.a).fx
        return Ground(
            altitude_m=altitude_m,
            gsd_cm=gsd_cm,
            rms_cm=self.difference.rms_px * gsd_cm,
            max_cm=self.difference.max_px * gsd_cm,
            height_cm=100 * altitude_m * self.scale.change,
        )


def numbers_of(a: Calibration, b: Calibration, policy: Policy) -> Numbers:
    """Measure the difference of two calibrations at one image size.

    Raises:
        CalibrationError: their fields of view overlap too little.
    """
    lens_compared = a.distortion is not None and b.distortion is not None
    one, two = (a, b) if lens_compared else pinholes(a, b)
    common = common_numbers(one, two)
    # What two solves were given alike cancels in their difference.
    spreads = spread_of(one, common.same), spread_of(two, common.same)
    basis = basis_of(a, b, spreads, common)
    covariances, swapped = covariances_of(basis, spreads), _field(one) < _field(two)
    # Every pixel counts, however well it is known: an image has features everywhere, and what is unknown is said. They
    # are counted in the frame that sees more: from A to B it is as far as from B to A, whoever asks.
    difference = projection_difference(
        *((two, one) if swapped else (one, two)),
        weights=np.ones(GRID[::-1]),
        covariances=covariances[::-1] if swapped and covariances is not None else covariances,
        trusted_px=float("inf"),
    )
    scale = image_scale(difference)
    if swapped:
        difference = replace(difference, vectors=-difference.vectors, rotation_rad=-difference.rotation_rad)
        by = 1.0 / (1.0 + scale.change)
        scale = Scale(change=by - 1.0, std=scale.std * by**2 if scale.std is not None else None)
    tested = noise_test(
        difference,
        scale,
        level=policy.drift_significance,
        matters_px=min(policy.drift_rms_px, policy.drift_max_px),
        matters_scale=policy.drift_focal,
    )
    p, explains = tested if tested is not None else (None, None)
    if basis in {Basis.TYPICAL, Basis.PARTIAL}:
        p, explains = None, is_usual(one, two)
    return Numbers(
        a=a,
        b=b,
        parameters=_parameters(a, b),
        common=common,
        difference=difference,
        focal_change=_focal_change(a, b),
        scale=scale,
        significance=Significance(
            basis=basis, p=p, explains=explains, spread_a=spreads[0].source, spread_b=spreads[1].source
        ),
        spread_a=spreads[0],
        spread_b=spreads[1],
        blind=_blind(one, two, difference),
        policy=policy,
        lens_compared=lens_compared,
    )


def _field(c: Calibration) -> float:
    """How much a camera sees: the sum of the angles of its pixels from the axis, in rad."""
    rays = c.unproject(pixel_grid(c.intrinsics.image_size).reshape(-1, 2))
    return float(np.nansum(np.arctan2(np.hypot(rays[:, 0], rays[:, 1]), rays[:, 2])))


def _blind(a: Calibration, b: Calibration, difference: ProjectionDifference) -> BoolArray:
    """Mask of pixels with a ray in at least one calibration that lie outside the compared region."""
    flat = pixel_grid(a.intrinsics.image_size).reshape(-1, 2)
    sees = [np.isfinite(one.unproject(flat)).all(axis=1).reshape(difference.region.shape) for one in (a, b)]
    return np.asarray((sees[0] | sees[1]) & ~difference.region, dtype=np.bool_)


def _focal_change(a: Calibration, b: Calibration) -> float:
    before, after = axial(a), axial(b)
    return max((after.fx / before.fx - 1, after.fy / before.fy - 1), key=abs)


def _parameters(a: Calibration, b: Calibration) -> tuple[Parameter, ...]:
    # In different models the same name means different parameters, so they are not subtracted.
    lenses = [c.distortion.shown if c.distortion is not None else {} for c in (a, b)]
    skew = ("skew",) if a.intrinsics.skew or b.intrinsics.skew else ()
    rows = [(name, *(float(getattr(c.intrinsics, name)) for c in (a, b))) for name in (*K_NAMES, *skew)]
    found = [_parameter(a, b, *row) for row in rows]
    if type(a.distortion) is type(b.distortion):
        return (*found, *(_parameter(a, b, name, lenses[0][name], lenses[1][name]) for name in lenses[0]))
    found += [_parameter(a, b, name, value, None) for name, value in lenses[0].items()]
    return (*found, *(_parameter(a, b, name, None, value) for name, value in lenses[1].items()))


def _parameter(a: Calibration, b: Calibration, name: str, one: float | None, two: float | None) -> Parameter:
    std_a = std_of(a, name) or None if one is not None else None
    std_b = std_of(b, name) or None if two is not None else None
    delta = two - one if one is not None and two is not None else None
    z = None
    if delta is not None and std_a is not None and std_b is not None:
        z = delta / math.hypot(std_a, std_b)
    return Parameter(name=name, a=one, b=two, std_a=std_a, std_b=std_b, delta=delta, z=z)


LEFT: Final = 0.25
"""A part of K explains the difference if at most this fraction of it is left once that part is taken over."""


def what_moved(numbers: Numbers) -> str | None:
    """Name the part of K that explains the difference; None if several moved, or the distortion did.

    A focus or a temperature changes both focal lengths by one factor. The principal point moves alone if the lens
    or the sensor shifted.
    """
    a, b = (numbers.a, numbers.b) if numbers.lens_compared else pinholes(numbers.a, numbers.b)
    before, after, K = axial(a), axial(b), a.intrinsics
    by = math.sqrt(after.fx / before.fx * (after.fy / before.fy))
    dx, dy = after.cx - before.cx, after.cy - before.cy
    focused = replace(K, fx=K.fx * by, fy=K.fy * by, skew=K.skew * by)
    for moved, reason in (
        (
            focused,
            f"mainly the focal length moved ({percent(by - 1)}), and the lens bends as before: another focus or "
            "zoom, or another temperature",
        ),
        (
            replace(K, cx=K.cx + dx, cy=K.cy + dy),
            f"mainly the principal point moved, by {pixels(math.hypot(dx, dy))}: the sensor or a lens "
            "element shifted, or an image was cut",
        ),
        (
            replace(focused, cx=K.cx + dx, cy=K.cy + dy),
            "focal length and principal point moved, and the lens bends as before",
        ),
    ):
        try:
            left = projection_difference(replace(a, intrinsics=moved), b, weights=np.ones(GRID[::-1]))
        except CalibraryError:
            continue
        if left.rms_px <= LEFT * numbers.difference.rms_px:
            return reason
    return None
