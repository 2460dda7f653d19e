"""Test whether two calibrations are independent measurements, or one measurement that was copied, edited or rounded.

Two measurements never give equal numbers to the last digit. If numbers are equal, both files contain the same
measurement, and any difference was made by a person or a program, not by noise. Numbers fixed by a model (a
coefficient of 0, a principal point in the exact centre) are expected to be equal and prove nothing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from msgspec import Struct

from calibrary.calibration import Calibration
from calibrary.distortion import NESTED, Distortion, NoDistortion, exact
from calibrary.records import replace

K_NAMES: Final = ("fx", "fy", "cx", "cy")
PINHOLE: Final = (*K_NAMES, "skew")

HELD: Final = ({"fx", "fy"}, {"cx", "cy"})
"""Numbers that a solver holds or frees together, besides the whole distortion."""

SAME: Final = 1e-7
"""Relative difference below which two numbers count as equal; files have seven digits or more."""
FEWEST_COMMON: Final = 2
COMMON_SHARE: Final = 1 / 3
"""Fraction of equal free numbers above which equality is not a coincidence."""


class Common(Struct, frozen=True, kw_only=True):
    """Numbers of two calibrations by whether they are equal to the last digit.

    Attributes:
        same: free numbers that are equal.
        changed: numbers of both that differ.
        lost: coefficients of A that B lacks or has as 0.
        gained: coefficients of B that A lacks or has as 0.
        is_measured: whether a standard deviation is stated for one of the equal numbers, so that it was not held.
    """

    same: tuple[str, ...]
    changed: tuple[str, ...]
    lost: tuple[str, ...]
    gained: tuple[str, ...]
    is_measured: bool = False

    @property
    def could_be_held(self) -> bool:
        """Whether a solve can have found what differs while the equal numbers were held fixed.

        Solvers hold focal lengths, the principal point, or the distortion; a part of one of these was edited.
        """
        if self.is_measured or self.lost or self.gained or not self.changed:
            return False
        lens = {name for name in (*self.same, *self.changed) if name not in PINHOLE}
        return all(group.isdisjoint(self.same) or group.isdisjoint(self.changed) for group in (*HELD, lens))

    @property
    def is_copy(self) -> bool:
        """Whether both hold one measurement, and no solve explains the numbers that differ."""
        return self.is_one_measurement and not self.could_be_held

    @property
    def is_one_measurement(self) -> bool:
        """Whether too many numbers are equal for two independent measurements."""
        free = len(self.same) + len(self.changed) + len(self.lost) + len(self.gained)
        return len(self.same) >= FEWEST_COMMON and len(self.same) >= COMMON_SHARE * free


def common_numbers(a: Calibration, b: Calibration) -> Common:
    """Compare the numbers of two calibrations at one image size for equality, in one model if one is the other's."""
    a, b = in_one_model(a, b)
    one, two = values_of(a), values_of(b)
    other_model = not _share_names(a.distortion, b.distortion)
    if other_model:
        one, two = ({name: values[name] for name in PINHOLE} for values in (one, two))
    names = [name for name in dict.fromkeys([*one, *two]) if one.get(name) or two.get(name)]
    same, lost, gained = [], [], []
    changed = ["the distortion model"] if other_model else []
    for name in names:
        x, y = one.get(name, 0.0), two.get(name, 0.0)
        if is_same(x, y):
            same += [name] if _is_free(a, name, x) else []
        elif not y and name not in PINHOLE:
            lost.append(name)
        elif not x and name not in PINHOLE:
            gained.append(name)
        else:
            changed.append(name)
    return Common(
        same=tuple(same),
        changed=tuple(changed),
        lost=tuple(lost),
        gained=tuple(gained),
        is_measured=any(_is_stated(side, name) for side in (a, b) for name in same),
    )


def in_one_model(a: Calibration, b: Calibration) -> tuple[Calibration, Calibration]:
    """Both with the distortion in one model, if that of one can be written in the other's without loss."""
    one, two = a.distortion, b.distortion
    if (
        one is None
        or two is None
        or type(one) is type(two)
        or (isinstance(one, NESTED) and isinstance(two, NESTED))
    ):
        return a, b
    if isinstance(one, NoDistortion) or isinstance(two, NoDistortion):
        return a, b
    if (same := exact(two, type(one))) is not None:
        return a, replace(b, distortion=same)
    if (same := exact(one, type(two))) is not None:
        return replace(a, distortion=same), b
    return a, b


def has_other_source(a: Calibration, b: Calibration) -> bool:
    """Whether their provenance states independent measurements: other dates, other data, or another method."""
    one, two = a.provenance, b.provenance
    frames = [{source.sha256 for source in provenance.sources} for provenance in (one, two)]
    return (
        one.kind != two.kind
        or a.grade is not b.grade
        or _differ(one.date, two.date)
        or _differ(one.tool, two.tool)
        or (all(frames) and frames[0].isdisjoint(frames[1]))
    )


def values_of(calibration: Calibration) -> Mapping[str, float]:
    """All numbers of K and the distortion, by name."""
    K, lens = calibration.intrinsics, calibration.distortion
    pinhole = {name: float(getattr(K, name)) for name in PINHOLE}
    return pinhole | (lens.coefficients if lens is not None else {})


def is_same(x: float, y: float) -> bool:
    """Whether two numbers are equal within the digits of a file."""
    return abs(x - y) <= SAME * max(abs(x), abs(y))


def _share_names(one: Distortion | None, two: Distortion | None) -> bool:
    """Whether coefficient names mean the same in both: equal models, or a model and its extension."""
    if one is None or two is None or isinstance(one, NoDistortion) or isinstance(two, NoDistortion):
        return True
    return type(one) is type(two) or (isinstance(one, NESTED) and isinstance(two, NESTED))


def _is_stated(calibration: Calibration, name: str) -> bool:
    quality = calibration.quality
    covariance = quality.covariance.std if quality is not None and quality.covariance is not None else {}
    return quality is not None and quality.std.get(name, covariance.get(name, 0.0)) > 0


def _is_free(calibration: Calibration, name: str, value: float) -> bool:
    """Whether a number was measured rather than fixed by the model."""
    width, height = calibration.intrinsics.image_size
    centre = {"cx": width / 2, "cy": height / 2}.get(name, math.nan)
    at_the_centre = abs(value - centre) <= 0.5 * (1 + SAME)
    covariance = calibration.quality.covariance if calibration.quality is not None else None
    fixed = covariance is not None and not covariance.std.get(name, 0.0)
    return value != 0 and not at_the_centre and not fixed


def _differ(one: str | None, two: str | None) -> bool:
    return one is not None and two is not None and one != two
