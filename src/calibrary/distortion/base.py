"""Base class of the distortion models, the one without distortion, and the perspective geometry that they share."""

from __future__ import annotations

import inspect
import math
import re
from abc import abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, ClassVar, TypeAlias

from calibrary.arrays import ArrayLike, FloatArray, np
from calibrary.errors import InputError
from calibrary.kernel import Form
from calibrary.records import Record, force_setattr

Columns: TypeAlias = Sequence[FloatArray]

BLOCK_ROWS = 8_192
"""Number of rows per block: a dozen columns of this length fit into a processor's second-level cache."""


class Distortion(Record, tag_field="model"):
    """Distortion of a lens: a map from undistorted to distorted normalised coordinates.

    The fields of a model are its coefficients, in the order of its source. Normalised coordinates are x/z, y/z; K
    converts the distorted ones to pixels. Arrays are (N, 2) float64; rows without a solution are NaN.

    Raises:
        InputError: a coefficient is not a finite number.
    """

    model: ClassVar[str]
    """Name of the model in files and reports."""

    example: ClassVar[Mapping[str, Any]] = {}
    """Coefficients of a lens that the documentation draws, strong enough for its shape to be seen; the others are 0."""

    example_reach_deg: ClassVar[float] = 37.0
    """Angle from the axis up to which that lens is drawn to the left and right."""

    def __post_init__(self) -> None:
        for name in self.__struct_fields__:
            given = getattr(self, name)
            if type(given) is float and math.isfinite(given):
                continue
            value = finite_number(given)
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
        """Add the formula and the order of the parameters to the schema, so that it can be used without calibrary."""
        said = inspect.cleandoc(cls.__doc__ or "").partition("\n\n")[2].partition("\n\nRaises:")[0]
        plain = re.sub(r":\w+:`~?(?:[\w.]*\.)?(\w+)`", r"\1", said).replace("::\n", ":\n").replace("``", "")
        order = f"Parameters in order: {', '.join(cls.names()) or 'none'}. All models: docs/distortion.md."
        return schema | {"description": f"{order}\n\n{plain}".strip()}

    @property
    def coefficients(self) -> dict[str, float]:
        """The coefficients by name, in the model's order."""
        return {name: getattr(self, name) for name in self.__struct_fields__}

    @property
    def shown(self) -> dict[str, float]:
        """The coefficients that a person may want to read."""
        return self.coefficients

    @abstractmethod
    def distort(self, xy: FloatArray) -> FloatArray:
        """Undistorted (x/z, y/z) to distorted; NaN from :meth:`valid_radius` on."""

    @abstractmethod
    def undistort(self, xy: FloatArray) -> FloatArray:
        """Distorted to undistorted (x/z, y/z); NaN for points without a solution inside :meth:`valid_radius`."""

    @abstractmethod
    def valid_radius(self) -> float:
        """Radius of the largest disc, in undistorted normalised coordinates, on which the model is one-to-one.

        The distortion is not monotonic beyond it; ``inf`` if it is monotonic everywhere.
        """

    def equivalents(self) -> tuple[Distortion, ...]:
        """The same map in other models that represent it exactly."""
        return ()

    @classmethod
    def from_equivalent(cls, _other: Distortion) -> Distortion | None:
        """The same map in this model; None if this model cannot represent it exactly."""
        return None

    def covers(self, radius: float) -> bool:  # noqa: ARG002  a model that has a quick test of it looks at it
        """Return True if a quick test proves that every distorted point up to ``radius`` has an undistorted one.

        False means only that the test proves nothing; :meth:`undistort` then decides.
        """
        return False

    def form(self) -> Form | None:
        """The same map for the compiled code; None if it is not one of its maps."""
        return None

    def max_angle_rad(self) -> float:
        """Largest angle from the optical axis up to which the model is one-to-one in all directions."""
        return math.atan(self.valid_radius())

    def distort_rays(self, rays: FloatArray) -> FloatArray:
        """(N, 3) directions to (N, 2) distorted coordinates; NaN for directions outside the valid field of view."""
        return self.distort(perspective(as_rows(rays, 3)))

    def distort_unlimited(self, rays: FloatArray) -> FloatArray:
        """The formula of :meth:`distort_rays` alone, for a search: beyond the valid field of view it means nothing."""
        return self.distort_rays(rays)

    def undistort_to_rays(self, xy: FloatArray) -> FloatArray:
        """(N, 2) distorted coordinates to (N, 3) unit directions; NaN for points without a direction."""
        return unit_rays(self.undistort(xy))

    def distort_ray(self, _x: float, _y: float, _z: float, /) -> tuple[float, float] | None:
        """Fast :meth:`distort_rays` for one direction, without arrays; None if that method has to decide."""
        return None

    def undistort_to_ray(self, _x: float, _y: float, /) -> tuple[float, float, float] | None:
        """Fast :meth:`undistort_to_rays` for one point, without arrays; None if that method has to decide."""
        return None


def perspective(rays: FloatArray) -> FloatArray:
    """(N, 3) directions to (N, 2) x/z, y/z; NaN for directions that do not point forward (z ≤ 0)."""

    def divided(x: FloatArray, y: FloatArray, z: FloatArray) -> Columns:
        # In place, like all operations on columns: on a short array, most of the time goes into allocating the result.
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
    """Return the unit direction of x/z, y/z."""
    depth = 1.0 / math.hypot(x, y, 1.0)
    return x * depth, y * depth, depth


def by_columns(function: Callable[..., Columns], values: ArrayLike, columns: int, into: int) -> FloatArray:
    """Apply a function of columns to (N, columns) rows, block by block; returns (N, into) rows.

    Args:
        function: takes ``columns`` arrays, which it may change, and returns ``into`` arrays.
        values: input rows.
        columns: length of an input row.
        into: length of an output row.

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


def radially(xy: ArrayLike, radius: Callable[[FloatArray], FloatArray]) -> FloatArray:
    """Move (N, 2) points along their radius to the one that ``radius`` gives for it; NaN where that is not finite."""

    def moved(x: FloatArray, y: FloatArray) -> Columns:
        x, y = finite_pair(x, y)
        r = np.hypot(x, y)
        scale = radius(r) / r
        scale[r == 0] = 0.0
        return finite_pair(x * scale, y * scale)

    return by_columns(moved, xy, 2, 2)


def finite_pair(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Set both columns to NaN, in place, wherever either is not finite; returns the columns."""
    finite = np.isfinite(x)
    finite &= np.isfinite(y)
    if np.count_nonzero(finite) < len(finite):
        lost = ~finite
        x[lost] = y[lost] = math.nan
    return x, y


def as_rows(values: ArrayLike, columns: int) -> FloatArray:
    """Return ``values`` as (N, columns) float64.

    Raises:
        InputError: the values have another shape or are not numbers.
    """
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"got values that are no (N, {columns}) array of numbers: {error}") from None
    if array.ndim != 2 or array.shape[1] != columns:
        raise InputError(f"got an array of shape {array.shape}, expected (N, {columns})")
    return array


def blocks(rows: int, size: int = BLOCK_ROWS) -> Iterator[slice]:
    """Divide ``rows`` rows into slices of at most ``size``, to keep temporary arrays small."""
    return (slice(start, min(start + size, rows)) for start in range(0, rows, size))


def finite_number(value: object) -> float | None:
    """Return ``value`` as a float if it is a finite number, otherwise None (also for bool and str)."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | float | np.number):
        return None
    try:
        number = float(value)
    except (TypeError, OverflowError):
        return None
    return number if math.isfinite(number) else None


class NoDistortion(Distortion):
    """Distorted = undistorted. This states that the lens has no distortion; an *unknown* distortion is ``None``."""

    model: ClassVar[str] = "none"

    def distort(self, xy: FloatArray) -> FloatArray:
        """The same coordinates; a row that is not finite becomes NaN."""
        return _copied(xy)

    def undistort(self, xy: FloatArray) -> FloatArray:
        """The same coordinates; a row that is not finite becomes NaN."""
        return _copied(xy)

    def distort_ray(self, x: float, y: float, z: float, /) -> tuple[float, float] | None:
        """One direction, without arrays."""
        return (x / z, y / z) if z > 0 and math.isfinite(x / z) and math.isfinite(y / z) else None

    def undistort_to_ray(self, x: float, y: float, /) -> tuple[float, float, float] | None:
        """One point, without arrays."""
        return unit_ray(x, y) if math.isfinite(x) and math.isfinite(y) else None

    def valid_radius(self) -> float:
        """Infinite: a pinhole has no limit."""
        return math.inf

    def form(self) -> Form:
        """The map without any term."""
        return Form()


def _copied(xy: FloatArray) -> FloatArray:
    copy = np.array(as_rows(xy, 2))
    finite_pair(copy[:, 0], copy[:, 1])
    return copy
