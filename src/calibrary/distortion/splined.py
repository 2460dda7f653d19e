"""mrcal's splined model: a stereographic projection, and beside it a smooth field that no formula prescribes."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache, lru_cache
from typing import Annotated, Any, ClassVar, Final, NoReturn

from msgspec import Struct

from calibrary.arrays import BoolArray, FloatArray, IntArray, np
from calibrary.distortion.base import Columns, by_columns, finite_number, finite_pair
from calibrary.distortion.omnidirectional import Omnidirectional, unit
from calibrary.errors import InputError
from calibrary.records import Meta, force_setattr

MOST_KNOTS: Final = 4_096
"""mrcal's own solves have some hundreds; twice as many numbers fit into an entry of a registry."""
PER_CELL: Final = 4
"""Places along a cell's side at which the map is shown to turn no way back."""


@cache
def directions() -> FloatArray:
    """Return (32, 2) directions all around, in which the limits of a valid field are stated."""
    return np.column_stack([f(np.arange(32) * math.pi / 16) for f in (np.cos, np.sin)])


"""Of the sides of the valid field."""
TURNS: Final = 60
"""Steps of Newton's search; a lens takes four."""
PLACES: Final = 25
"""Along a side of the grid, to start a search from."""


class SplinedStereographic(Omnidirectional):
    """mrcal ``LENSMODEL_SPLINED_STEREOGRAPHIC``, which follows a lens where every formula departs from it.

    With θ the angle between the ray (X, Y, Z) and the axis, and R² = X² + Y²::

        u = 2·tan(θ/2)·X/R                          v = 2·tan(θ/2)·Y/R
        x' = u + Σ B(p − i)·B(q − j)·x[i, j]        y' = v + Σ B(p − i)·B(q − j)·y[i, j]
        p = u·s + (nx − 1)/2                        q = v·s + (ny − 1)/2
        s = (nx − order)/(4·tan(fov_x_deg/4))       i = 0 … nx − 1, j = 0 … ny − 1

    B is the uniform B-spline about 0, quadratic or cubic by ``order``. ``knots`` has x and y of each knot in turn, row
    by row. Beyond the cells between the knots, and beyond where the map turns back, it has no value; mrcal continues
    the outermost polynomials there and calls that not meaningful.

    Source: mrcal, "Splined stereographic lens model", https://mrcal.secretsauce.net/splined-models.html.
    """

    model: ClassVar[str] = "splined-stereographic"
    example: ClassVar[Mapping[str, Any]] = {
        "order": 3,
        "nx": 6,
        "ny": 6,
        "fov_x_deg": 150,
        "knots": tuple(
            -0.007 * (r * r + (3 if column < 2 else 0)) * side
            for row in range(6)
            for column in range(6)
            for r in (math.hypot(column - 2.5, row - 2.5),)
            for side in (column - 2.5, row - 2.5)
        ),
    }

    order: Annotated[int, Meta(ge=2, le=3)]
    nx: Annotated[int, Meta(ge=3)]
    ny: Annotated[int, Meta(ge=3)]
    fov_x_deg: Annotated[int, Meta(ge=1, le=359)]
    knots: tuple[float, ...]

    def __post_init__(self) -> None:
        lowest = {"order": (2, 3), "nx": (3, MOST_KNOTS), "ny": (3, MOST_KNOTS), "fov_x_deg": (1, 359)}
        for name, (least, most) in lowest.items():
            value = getattr(self, name)
            if type(value) is not int or not least <= value <= most:
                self._refuse(name, value, f"a whole number from {least} to {most}")
        if min(self.nx, self.ny) <= self.order or self.nx * self.ny > MOST_KNOTS:
            wanted = f"more than {self.order} either way and at most {MOST_KNOTS} together"
            self._refuse("nx", f"{self.nx} by {self.ny}", wanted)
        knots: object = self.knots
        given = knots if isinstance(knots, tuple | list) else ()
        values = tuple(finite_number(value) for value in given)
        if len(values) != 2 * self.nx * self.ny:
            shown = f"{len(values)} numbers" if values else self.knots
            self._refuse("knots", shown, f"x and y of {self.nx}·{self.ny} knots")
        if None in values:
            self._refuse("knots", given[values.index(None)], "finite numbers")
        force_setattr(self, "knots", values)

    def _refuse(self, name: str, given: object, wanted: str) -> NoReturn:
        raise InputError(f"{name} of the {self.model} model is {given!r:.40}, expected {wanted}", place=name)

    @property
    def coefficients(self) -> dict[str, float]:
        """All numbers: the grid's, and x and y of each knot by its column and row."""
        knots = {
            f"{'xy'[at % 2]}_{at // 2 % self.nx}_{at // 2 // self.nx}": value
            for at, value in enumerate(self.knots)
        }
        return self.shown | knots

    @property
    def shown(self) -> dict[str, float]:
        """The grid's numbers; nobody reads the knots."""
        return {name: float(getattr(self, name)) for name in self.names()[:-1]}

    def max_angle_rad(self) -> float:
        """Angle from the axis up to which the map is one-to-one all around; it may be so farther to some sides."""
        return 2.0 * math.atan(max(float(_surface(self).limits.min()), 0.0) / 2.0)

    def distort_rays(self, rays: FloatArray) -> FloatArray:
        """(N, 3) directions to (N, 2) distorted coordinates; NaN outside the valid field, which is not round."""
        return self._image(rays, within=True)

    def distort_unlimited(self, rays: FloatArray) -> FloatArray:
        """The formula alone, which keeps its outermost values beyond the cells; NaN for straight backwards."""
        return self._image(rays, within=False)

    def _image(self, rays: FloatArray, *, within: bool) -> FloatArray:
        surface = _surface(self)

        def image(x: FloatArray, y: FloatArray, z: FloatArray) -> Columns:
            x, y, z = unit(x, y, z)
            u, v = x * (2.0 / (1.0 + z)), y * (2.0 / (1.0 + z))
            if within:
                u[~surface.holds(u, v)] = math.nan
            u, v = finite_pair(u, v)
            added = surface.at(u, v)
            return u + added[:, 0], v + added[:, 1]

        return by_columns(image, rays, 3, 2)

    def undistort_to_rays(self, xy: FloatArray) -> FloatArray:
        """(N, 2) distorted coordinates to (N, 3) unit directions; NaN for points without a direction."""
        surface = _surface(self)

        def direction(x: FloatArray, y: FloatArray) -> Columns:
            u, v = surface.found(np.column_stack(finite_pair(x, y))).T
            across = u * u + v * v
            shrink = 4.0 / (4.0 + across)
            return u * shrink, v * shrink, (4.0 - across) / (4.0 + across)

        return by_columns(direction, xy, 2, 3)


class _Grid(Struct, frozen=True, kw_only=True, eq=False):
    """Where the knots are.

    Attributes:
        order: degree of the polynomials.
        counts: number of knots in a row, and of rows.
        per_unit: knots in a unit of u and v.
        edges: largest |u| and |v| inside the cells.
    """

    order: int
    counts: tuple[int, int]
    per_unit: float
    edges: tuple[float, float]

    @classmethod
    def of(cls, order: int, nx: int, ny: int, fov_x_deg: int) -> _Grid:
        edge = 2.0 * math.tan(math.radians(fov_x_deg) / 4.0)
        per_unit = (nx - order) / (2.0 * edge)
        return cls(
            order=order, counts=(nx, ny), per_unit=per_unit, edges=(edge, (ny - order) / 2.0 / per_unit)
        )

    def weights(self, values: FloatArray, axis: int) -> tuple[IntArray, FloatArray, FloatArray]:
        """First knot of each value's cell, the weights of its knots, and the weights' derivatives."""
        edge, count = self.edges[axis], self.counts[axis]
        inside = np.clip(np.nan_to_num(values), -edge, edge)
        at = inside * self.per_unit + (count - 1) / 2.0
        cubic = self.order == 3
        # The knot before the cell of a cubic, nearest to the place of a quadratic.
        first = np.clip(np.floor(at if cubic else at + 0.5), 1, count - self.order).astype(np.intp) - 1
        t = at - first - 1
        s = 1 - t
        weights: tuple[FloatArray, ...]
        slopes: tuple[FloatArray, ...]
        if cubic:
            weights = (s**3 / 6, (3 * t**3 - 6 * t * t + 4) / 6, (3 * s**3 - 6 * s * s + 4) / 6, t**3 / 6)
            slopes = (-s * s / 2, 1.5 * t * t - 2 * t, 2 * s - 1.5 * s * s, t * t / 2)
        else:
            weights = ((0.5 - t) ** 2 / 2, 0.75 - t * t, (0.5 + t) ** 2 / 2)
            slopes = (t - 0.5, -2 * t, t + 0.5)
        grown = np.where(np.abs(values) <= edge, self.per_unit, 0.0)
        return first, np.stack(weights, axis=-1), np.stack(slopes, axis=-1) * grown[:, None]


class _Surface:
    """The two spline surfaces, with what is computed of them once.

    Attributes:
        limits: (32,) how far the valid field reaches in each of :func:`directions`: a convex polygon in u and v.
        places, images: (N, 2) some u and v inside it, and what is seen of them.
    """

    def __init__(self, lens: SplinedStereographic) -> None:
        self.grid = _Grid.of(lens.order, lens.nx, lens.ny, lens.fov_x_deg)
        self.knots = np.reshape(lens.knots, (lens.ny, lens.nx, 2))
        self.limits = self._limits()
        u, v = np.meshgrid(*(edge * np.linspace(-1, 1, PLACES) for edge in self.grid.edges))
        places = np.column_stack([u.ravel(), v.ravel()])
        self.places = places[self.holds(*places.T)]
        self.images = self.with_slopes(self.places)[0]

    def holds(self, u: FloatArray, v: FloatArray, *, stretched: float = 1.0) -> BoolArray:
        """Whether (u, v) are inside the valid field, or one so many times as large."""
        offsets = np.outer(u, directions()[:, 0]) + np.outer(v, directions()[:, 1])
        return np.asarray((offsets < stretched * self.limits).all(axis=1))

    def at(self, u: FloatArray, v: FloatArray) -> FloatArray:
        """What is added at (u, v), (N, 2)."""
        return self._sums(self.grid.weights(u, 0)[:2], self.grid.weights(v, 1)[:2])

    def with_slopes(self, uv: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The image of (N, 2) places, and its derivatives, (N, 2, 2) with those by u first."""
        first, across, by_u = self.grid.weights(uv[:, 0], 0)
        second, down, by_v = self.grid.weights(uv[:, 1], 1)
        by = (self._sums((first, by_u), (second, down)), self._sums((first, across), (second, by_v)))
        return uv + self._sums((first, across), (second, down)), np.eye(2) + np.stack(by, axis=-1)

    def _sums(self, across: tuple[IntArray, FloatArray], down: tuple[IntArray, FloatArray]) -> FloatArray:
        (i, a), (j, b) = across, down
        found = np.zeros((len(a), 2))
        for row in range(self.grid.order + 1):
            for column in range(self.grid.order + 1):
                found += (a[:, column] * b[:, row])[:, None] * self.knots[j + row, i + column]
        return found

    def _limits(self) -> FloatArray:
        """Cut off the places where the map turns back: where the symmetric part of its derivative is not positive.

        On a convex field where that is positive everywhere, the map is one-to-one.
        """
        counts = [PER_CELL * (count - self.grid.order) + 1 for count in self.grid.counts]
        u, v = np.meshgrid(*(np.linspace(-e, e, n) for e, n in zip(self.grid.edges, counts, strict=True)))
        places = np.column_stack([u.ravel(), v.ravel()])
        slopes = self.with_slopes(places)[1]
        xx, yy, xy = slopes[:, 0, 0], slopes[:, 1, 1], slopes[:, 0, 1] + slopes[:, 1, 0]
        bad = places[~(xx + yy > np.hypot(xx - yy, xy))]
        whole: FloatArray = np.abs(directions()) @ self.grid.edges
        limits = whole.copy()
        # From a good place to a bad one the map may turn back anywhere between.
        offsets = bad[np.argsort(np.hypot(*bad.T))] @ directions().T - 1.0 / PER_CELL / self.grid.per_unit
        while len(offsets):
            # The side that loses least.
            side = int(np.argmax(offsets[0] / whole))
            limits[side] = min(limits[side], offsets[0, side])
            offsets = offsets[(offsets < limits).all(axis=1)]
        return limits

    def found(self, xy: FloatArray) -> FloatArray:
        """The (u, v) whose image is (x, y); NaN where there is none."""
        inside = xy / np.maximum(
            (xy @ directions().T / self.limits).max(axis=1, keepdims=True, initial=1.0), 1.0
        )
        found = self._searched(xy, inside)
        lost = np.flatnonzero(np.isnan(found[:, 0]) & np.isfinite(xy).all(axis=1))
        if len(lost) and len(self.places):
            # From the nearest of some places, in case that the way there was lost outside the field.
            near = ((self.images[None] - xy[lost, None]) ** 2).sum(axis=-1).argmin(axis=1)
            found[lost] = self._searched(xy[lost], self.places[near])
        return found

    def _searched(self, xy: FloatArray, start: FloatArray) -> FloatArray:
        """Newton's search inside the field, with steps shortened until they come closer; NaN where it is lost."""
        best, share = start.copy(), np.ones(len(xy))
        seen, slopes = self.with_slopes(best)
        missed = seen - xy
        left = np.flatnonzero(np.isfinite(missed).all(axis=1))
        for _ in range(TURNS):
            (a, b), (c, d) = slopes[left].transpose(1, 2, 0)
            x, y = missed[left].T * share[left] / (a * d - b * c)
            step = np.column_stack([d * x - b * y, a * y - c * x])
            trial = best[left] - step
            seen, turned = self.with_slopes(trial)
            short = seen - xy[left]
            closer = (np.hypot(*short.T) < np.hypot(*missed[left].T)) & self.holds(*trial.T, stretched=1.02)
            share[left] = np.where(closer, np.minimum(4 * share[left], 1.0), share[left] / 4)
            moved = left[closer]
            best[moved], missed[moved], slopes[moved] = trial[closer], short[closer], turned[closer]
            left = left[np.hypot(*step.T) > 1e-15 * (1.0 + np.hypot(*trial.T))]
            if not len(left):
                break
        best[~(np.hypot(*missed.T) <= 1e-12 * (1.0 + np.hypot(*xy.T))) | ~self.holds(*best.T)] = math.nan
        return best


@lru_cache(maxsize=64)
def _surface(lens: SplinedStereographic) -> _Surface:
    # Knots that overflow leave no valid field.
    with np.errstate(all="ignore"):
        return _Surface(lens)
