"""Lazy cameras for files with a camera for every image: a Calibration is made only on access.

A Calibration takes about 20 µs and 2 kB, too much for a file of a hundred thousand cameras. The numbers of
such a file are checked as arrays, and only cameras that fail the check are made at once, so that they raise
their error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import overload

from msgspec import Struct

from calibrary.arrays import ArrayLike, BoolArray, FloatArray, NDArray, np
from calibrary.calibration import Calibration

REACH = 1e6
"""Largest ratio, either way, between a length and the image size; that of the longest telescope is a thousand."""


FEW = 20


class Columns(Struct, frozen=True, kw_only=True, eq=False):
    """The numbers of cameras of one model as arrays.

    Attributes:
        model: the model of the cameras' format.
        ids: (N,) numbers of the cameras.
        sizes: (N, 2) px.
        K: (N, 4) fx, fy, cx, cy in px.
        coefficients: (N, m) of the lens, in the format's order.
    """

    model: object
    ids: NDArray[np.int64]
    sizes: NDArray[np.int64]
    K: FloatArray
    coefficients: FloatArray

    def kinds(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Return the place of one camera of each kind, and (N,) the kind of each camera.

        Cameras of a kind differ in numbers alone: the same coefficients are zero, and fx is fy or is not.
        """
        shown = np.column_stack([self.K[:, 0] == self.K[:, 1], self.coefficients != 0])
        _, first, kind = np.unique(
            shown @ (1 << np.arange(shown.shape[1])), return_index=True, return_inverse=True
        )
        return first, kind

    def equals(self, other: Columns) -> bool:
        """Whether all numbers are the same, bit for bit but for the sign of zero."""
        return self.model is other.model and all(
            np.array_equal(getattr(self, name), getattr(other, name))
            for name in ("ids", "sizes", "K", "coefficients")
        )

    def of(self, places: slice) -> Columns:
        """The cameras at some places."""
        return Columns(
            model=self.model,
            ids=self.ids[places],
            sizes=self.sizes[places],
            K=self.K[places],
            coefficients=self.coefficients[places],
        )


class CamerasOnDemand(Sequence[Calibration]):
    """The cameras of a file, equal to a list of them; each is made anew on every access.

    Attributes:
        columns: their numbers, if all are of one model and the reader gives them.
    """

    def __init__(
        self, sure: ArrayLike, make: Callable[[int], Calibration], columns: Columns | None = None
    ) -> None:
        """Store the function that makes the cameras.

        Args:
            sure: (N,), True where making the camera certainly raises no error.
            make: makes the camera at an index.
            columns: the numbers of all of them.
        """
        self._sure = np.asarray(sure, dtype=bool)
        self._places = range(len(self._sure))
        self._make = make
        self.columns = columns

    def made_at_once(self) -> list[Calibration]:
        """Make the cameras that may raise an error, so that reading the file raises it.

        Raises:
            InputError: raised by making a camera.
        """
        return [self[place] for place in np.flatnonzero(~self._sure).tolist()]

    def __len__(self) -> int:
        return len(self._places)

    @overload
    def __getitem__(self, index: int) -> Calibration: ...
    @overload
    def __getitem__(self, index: slice) -> CamerasOnDemand: ...

    def __getitem__(self, index: int | slice) -> Calibration | CamerasOnDemand:
        if isinstance(index, slice):
            columns = None if self.columns is None else self.columns.of(index)
            some = CamerasOnDemand(self._sure[index], self._make, columns)
            some._places = self._places[index]
            return some
        return self._make(self._places[index])

    def __iter__(self) -> Iterator[Calibration]:
        return map(self._make, self._places)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Sequence) or isinstance(other, str | bytes):
            return NotImplemented
        return len(self) == len(other) and all(a == b for a, b in zip(self, other, strict=True))

    __hash__ = None  # type: ignore[assignment]  # like a list, which it is equal to

    def __repr__(self) -> str:
        return f"<{len(self)} cameras of a file, made on demand>"

    def __reduce__(self) -> tuple[type[list[Calibration]], tuple[list[Calibration]]]:
        """Pickle as a list of cameras, because making them may depend on other files in the folder."""
        return list, (list(self),)


def on_demand(
    count: int, make: Callable[[int], Calibration], sure: Callable[[], BoolArray]
) -> Sequence[Calibration]:
    """The cameras of a file; if there are few, all are made at once, which is faster than checking their numbers.

    Args:
        count: number of cameras.
        make: makes the camera at an index.
        sure: returns (count,), True where making the camera certainly raises no error.

    Raises:
        InputError: raised by making a camera.
    """
    return [make(place) for place in range(count)] if count < FEW else CamerasOnDemand(sure(), make)


def make_a_camera(
    focals: ArrayLike, centres: ArrayLike, coefficients: ArrayLike, sides: ArrayLike
) -> BoolArray:
    """Mask (N,) of the rows that certainly give a valid K and finite coefficients.

    Args:
        focals: (N, 1 or 2) px.
        centres: (N, 2) px, or one number that bounds all coordinates.
        coefficients: (N, any number).
        sides: longer side of each image, or of all, px.
    """
    f, c, side = np.asarray(focals), np.asarray(centres), np.asarray(sides)
    with np.errstate(over="ignore", invalid="ignore"):
        good = (f.min(axis=1) * REACH >= side) & (f.max(axis=1) <= REACH * side) & (f.min(axis=1) > 0)
        good &= (np.abs(c).max(axis=1) if c.ndim else c) <= REACH * side
    certain: BoolArray = good & np.isfinite(np.asarray(coefficients)).all(axis=1)
    return certain
