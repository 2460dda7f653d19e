"""The cameras of a file with one for every image: numbers first, a Calibration when it is asked for.

A Calibration takes some 20 µs and 2 kB, which a file of a hundred thousand cameras takes that often. The numbers of
such a file are checked all at once, and only those that fail are made, so that they say what is wrong with them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import overload

import numpy as np
from numpy.typing import ArrayLike

from calibrary.arrays import BoolArray
from calibrary.calibration import Calibration

__all__ = ["REACH", "CamerasOnDemand", "make_a_camera", "on_demand"]

REACH = 1e6
"""How many times longer or shorter than the image a length may be; the longest telescope's is a thousand."""


FEW = 20


class CamerasOnDemand(Sequence[Calibration]):
    """A file's cameras, equal to a list of them; each is made anew every time it is asked for."""

    def __init__(self, sure: ArrayLike, make: Callable[[int], Calibration]) -> None:
        """Cameras of which none is made yet.

        Args:
            sure: (N,), whether making the camera at each place certainly raises no error.
            make: gives the camera at a place.
        """
        self._sure = np.asarray(sure, dtype=bool)
        self._places = range(len(self._sure))
        self._make = make

    def made_at_once(self) -> list[Calibration]:
        """Those whose making may raise an error, so that reading the file raises it.

        Raises:
            InputError: the kinds that making a camera raises.
        """
        return [self._make(place) for place in np.flatnonzero(~self._sure).tolist()]

    def __len__(self) -> int:
        return len(self._places)

    @overload
    def __getitem__(self, index: int) -> Calibration: ...
    @overload
    def __getitem__(self, index: slice) -> list[Calibration]: ...

    def __getitem__(self, index: int | slice) -> Calibration | list[Calibration]:
        if isinstance(index, slice):
            return [self._make(place) for place in self._places[index]]
        return self._make(self._places[index])

    def __iter__(self) -> Iterator[Calibration]:
        return map(self._make, self._places)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Sequence) or isinstance(other, str | bytes):
            return NotImplemented
        return len(self) == len(other) and all(a == b for a, b in zip(self, other, strict=True))

    __hash__ = None  # type: ignore[assignment]  # as a list, which it is equal to

    def __repr__(self) -> str:
        return f"<{len(self)} cameras of a file, made on demand>"

    def __reduce__(self) -> tuple[type[list[Calibration]], tuple[list[Calibration]]]:
        """Another process gets the cameras: how they are made may depend on the files beside theirs."""
        return list, (list(self),)


def on_demand(
    count: int, make: Callable[[int], Calibration], sure: Callable[[], BoolArray]
) -> Sequence[Calibration]:
    """A file's cameras; a few of them are made at once, which is quicker than checking their numbers.

    Args:
        count: how many there are.
        make: gives the camera at a place.
        sure: gives (count,), whether making each certainly raises no error.

    Raises:
        InputError: the kinds that making a camera raises.
    """
    return [make(place) for place in range(count)] if count < FEW else CamerasOnDemand(sure(), make)


def make_a_camera(
    focals: ArrayLike, centres: ArrayLike, coefficients: ArrayLike, sides: ArrayLike
) -> BoolArray:
    """Which rows of numbers certainly make a K and a lens whose coefficients may be any finite numbers, (N,).

    Args:
        focals: (N, 1 or 2) px.
        centres: (N, 2) px, or one number that no coordinate of any exceeds.
        coefficients: (N, any number of them).
        sides: the longer side of each image or of all, px.
    """
    f, c, side = np.asarray(focals), np.asarray(centres), np.asarray(sides)
    with np.errstate(over="ignore", invalid="ignore"):
        good = (f.min(axis=1) * REACH >= side) & (f.max(axis=1) <= REACH * side) & (f.min(axis=1) > 0)
        good &= (np.abs(c).max(axis=1) if c.ndim else c) <= REACH * side
    certain: BoolArray = good & np.isfinite(np.asarray(coefficients)).all(axis=1)
    return certain
