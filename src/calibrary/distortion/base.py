"""What every distortion model can do, and the perspective geometry they share."""

from __future__ import annotations

import inspect
import math
import re
from abc import abstractmethod
from collections.abc import Callable, Iterator, Sequence
from typing import Any, ClassVar, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from calibrary.arrays import FloatArray
from calibrary.errors import InputError
from calibrary.records import Record, force_setattr

Columns: TypeAlias = Sequence[FloatArray]

BLOCK_ROWS = 8_192
"""Rows worked on at a time: a dozen columns of this length stay in a processor's second-level cache."""


class Distortion(Record, tag_field="model"):
    """How a lens departs from a pinhole: a map from undistorted to distorted normalised coordinates.

    A model is a record whose fields are its coefficients, in the order of its source. Normalised
    coordinates are x/z, y/z: K turns the distorted ones into pixels. Arrays are (N, 2) float64 throughout;
    where the model has no answer the row is NaN.

    Raises:
        InputError: a coefficient is not a finite number.
    """

    model: ClassVar[str]
    """The name files and reports use."""

    def __post_init__(self) -> None:
        for name in self.names():
            given = getattr(self, name)
            if type(given) is float and math.isfinite(given):
                continue
            value = _number(given)
            if value is None:
                raise InputError(
                    f"{name} of the {self.model} model is {given!r:.40}, expected a finite number", place=name
                )
            force_setattr(self, name, value)

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """The names of the coefficients, in the model's order."""
        return cls.__struct_fields__

    @classmethod
    def _wire_schema(cls, schema: dict[str, Any], _defs: dict[str, Any]) -> dict[str, Any]:
        """With the formula and the order of the parameters, so that its reader needs no calibrary."""
        said = inspect.cleandoc(cls.__doc__ or "").partition("\n\n")[2].partition("\n\nRaises:")[0]
        plain = re.sub(r":\w+:`~?(?:[\w.]*\.)?(\w+)`", r"\1", said).replace("::\n", ":\n").replace("``", "")
        order = f"Parameters in order: {', '.join(cls.names()) or 'none'}. All models: docs/distortion.md."
        return schema | {"description": f"{order}\n\n{plain}".strip()}

    @property
    def coefficients(self) -> dict[str, float]:
        """The coefficients by name, in the model's order."""
        return {name: getattr(self, name) for name in self.names()}

    @abstractmethod
    def distort(self, xy: FloatArray) -> FloatArray:
        """Undistorted (x/z, y/z) to distorted; NaN from :meth:`valid_radius` on."""

    @abstractmethod
    def undistort(self, xy: FloatArray) -> FloatArray:
        """Distorted to undistorted (x/z, y/z); NaN where nothing inside :meth:`valid_radius` is seen there."""

    @abstractmethod
    def valid_radius(self) -> float:
        """The largest radius, in undistorted normalised coordinates, of a disc on which the model is one-to-one.

        The distortion is not monotonic beyond it; ``inf`` when it is monotonic everywhere.
        """

    def equivalents(self) -> tuple[Distortion, ...]:
        """The same map in other models, as many as hold it exactly."""
        return ()

    @classmethod
    def from_equivalent(cls, _other: Distortion) -> Distortion | None:
        """The same map in this model, None where this model cannot hold it exactly."""
        return None

    def covers(self, radius: float) -> bool:  # noqa: ARG002  a model that has a quick test of it looks at it
        """Whether every distorted point up to a radius is certain to have an undistorted one, by a quick test.

        False says nothing: then :meth:`undistort` tells.
        """
        return False

    def max_angle_rad(self) -> float:
        """The largest angle from the optical axis, in every direction, up to which the model is one-to-one."""
        return math.atan(self.valid_radius())

    def distort_rays(self, rays: FloatArray) -> FloatArray:
        """(N, 3) directions to (N, 2) distorted coordinates; NaN for what the camera cannot see."""
        return self.distort(perspective(as_rows(rays, 3)))

    def undistort_to_rays(self, xy: FloatArray) -> FloatArray:
        """(N, 2) distorted coordinates to (N, 3) unit directions; NaN where nothing is seen."""
        return unit_rays(self.undistort(xy))

    def distort_ray(self, _x: float, _y: float, _z: float, /) -> tuple[float, float] | None:
        """One direction as :meth:`distort_rays`, without an array's overhead; None where that has to decide."""
        return None

    def undistort_to_ray(self, _x: float, _y: float, /) -> tuple[float, float, float] | None:
        """One point as :meth:`undistort_to_rays`, without an array's overhead; None where that has to decide."""
        return None


def perspective(rays: FloatArray) -> FloatArray:
    """(N, 3) directions to (N, 2) x/z, y/z; NaN for what is not in front of the camera."""

    def divided(x: FloatArray, y: FloatArray, z: FloatArray) -> Columns:
        # In place, as all along a column: what an operation costs on a short array is mostly a new one's making.
        np.copyto(z, math.nan, where=~(z > 0))
        x /= z
        y /= z
        return finite_pair(x, y)

    return by_columns(divided, rays, 3, 2)


def unit_rays(xy: FloatArray) -> FloatArray:
    """(N, 2) x/z, y/z to (N, 3) unit directions."""

    def scaled(x: FloatArray, y: FloatArray) -> Columns:
        x, y = finite_pair(x, y)
        # hypot does not overflow where the sum of squares would.
        depth = np.hypot(x, y)
        np.hypot(depth, 1.0, out=depth)
        np.divide(1.0, depth, out=depth)
        x *= depth
        y *= depth
        return x, y, depth

    return by_columns(scaled, xy, 2, 3)


def unit_ray(x: float, y: float) -> tuple[float, float, float]:
    """x/z, y/z to a unit direction."""
    depth = 1.0 / math.hypot(x, y, 1.0)
    return x * depth, y * depth, depth


def by_columns(function: Callable[..., Columns], values: ArrayLike, columns: int, into: int) -> FloatArray:
    """What a function of columns gives for (N, columns) rows, as (N, into) rows; a block of rows at a time.

    Args:
        function: takes ``columns`` arrays, which it may change, and returns ``into``.
        values: the rows.
        columns: how many numbers a row has.
        into: how many it has afterwards.

    Raises:
        InputError: the rows have another shape or are not numbers.
    """
    given = as_rows(values, columns)
    out = np.empty((len(given), into))
    with np.errstate(all="ignore"):
        for rows in blocks(len(given)):
            for at, column in enumerate(function(*given[rows].T.copy())):
                out[rows, at] = column
    return out


def finite_pair(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The same columns, changed in place: where either is not finite, both are NaN."""
    finite = np.isfinite(x)
    finite &= np.isfinite(y)
    if np.count_nonzero(finite) < len(finite):
        lost = ~finite
        x[lost] = y[lost] = math.nan
    return x, y


def as_rows(values: ArrayLike, columns: int) -> FloatArray:
    """``values`` as (N, columns) float64.

    Raises:
        InputError: they have another shape or are no numbers.
    """
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"got values that are no (N, {columns}) array of numbers: {error}") from None
    if array.ndim != 2 or array.shape[1] != columns:
        raise InputError(f"got an array of shape {array.shape}, expected (N, {columns})")
    return array


def blocks(rows: int, size: int = BLOCK_ROWS) -> Iterator[slice]:
    """Cut ``rows`` rows into slices of at most ``size``, so that temporaries stay small."""
    return (slice(start, min(start + size, rows)) for start in range(0, rows, size))


def _number(value: object) -> float | None:
    """``value`` as a float when it is a finite number (a bool or a numeral in a string is none)."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | float | np.number):
        return None
    try:
        number = float(value)
    except (TypeError, OverflowError):
        return None
    return number if math.isfinite(number) else None
