"""How a format counts, as data: the same record is printed in the documentation and does the conversion.

The value of each enum member is the sentence people read. Half pixels are :mod:`calibrary.conventions`'s
business; units, the direction of y and the order of the tangential terms are dealt with here and nowhere
else.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import Self, TypeAlias

from msgspec import Struct

from calibrary.calibration import ImageSize, Intrinsics
from calibrary.conventions import Origin, canonical_from_file, file_from_canonical
from calibrary.errors import InputError, ParseError

__all__ = ["Convention", "Direction", "Native", "Origin", "Tangential", "Unit", "YAxis"]

SizeMm: TypeAlias = tuple[float, float]
"""(width, height) of the sensor in mm."""


class Unit(Enum):
    """What focal lengths and principal points are measured in."""

    PIXEL = "pixels"
    MILLIMETRE = "millimetres on the sensor"
    LONGER_SIDE = "fractions of the image's longer side"
    WIDTH = "fractions of the image's width"
    EACH_SIDE = "fractions of the image's width in x and of its height in y"


class YAxis(Enum):
    """Which way y grows, in the image and in the camera frame."""

    DOWN = "y points down"
    UP = "y points up"


class Direction(Enum):
    """Which way the distortion polynomial maps."""

    UNDISTORTED_TO_DISTORTED = "the polynomial maps the undistorted point to the distorted one, as in OpenCV"
    DISTORTED_TO_UNDISTORTED = (
        "the polynomial maps the distorted point to the undistorted one, inverse to OpenCV"
    )


class Tangential(Enum):
    """What the two tangential coefficients multiply."""

    OPENCV = "x gets 2·p1·x·y + p2·(r² + 2x²), as in OpenCV"
    SWAPPED = "x gets p1·(r² + 2x²) + 2·p2·x·y, so p1 and p2 are OpenCV's p2 and p1"
    NONE = "no tangential terms"


class Native(Struct, frozen=True, kw_only=True):
    """K's numbers as a format counts them, in its own unit, origin and direction of y."""

    fx: float
    fy: float
    cx: float
    cy: float
    skew: float = 0.0

    @classmethod
    def of_matrix(
        cls, rows: Sequence[Sequence[float]], *, place: str | None, source: str | None = None
    ) -> Self:
        """The numbers of a 3×3 camera matrix.

        Args:
            rows: three rows of three numbers.
            place: where the matrix stands in the file.
            source: the file's name.

        Raises:
            ParseError: it is not [[fx, skew, cx], [0, fy, cy], [0, 0, 1]]; the message says what it looks like.
        """
        (fx, skew, cx), (below, fy, cy), last = rows
        if below == 0.0 and tuple(last) == (0.0, 0.0, 1.0):
            return cls(fx=fx, fy=fy, cx=cx, cy=cy, skew=skew)
        expected = "expected zeros below the diagonal and 0 0 1 in the last row"
        if (skew, cx, cy, last[2]) == (0.0, 0.0, 0.0, 1.0):
            expected = "it is transposed, as MATLAB keeps it: write its transpose into the file"
        elif (below, *last[:2]) == (0.0, 0.0, 0.0) and last[2] not in (0.0, 1.0):
            expected = (
                f"its last number is {last[2]:g}: divide the matrix by it, so that the last row is 0 0 1"
            )
        raise ParseError(f"this is not a camera matrix: {expected}", place=place, source=source)


class Convention(Struct, frozen=True, kw_only=True):
    """How a format counts.

    Attributes:
        unit: of focal lengths and principal point.
        origin: where the principal point is counted from.
        y_axis: which way y grows.
        direction: which way the distortion maps.
        tangential: what p1 and p2 multiply.
        coefficients: the names of the distortion coefficients in the file's order, or just those it names.
        remarks: what else a reader of the documentation must know, one sentence each.
    """

    unit: Unit = Unit.PIXEL
    origin: Origin
    y_axis: YAxis = YAxis.DOWN
    direction: Direction = Direction.UNDISTORTED_TO_DISTORTED
    tangential: Tangential = Tangential.OPENCV
    coefficients: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()

    def intrinsics(
        self,
        native: Native,
        image_size: ImageSize,
        *,
        sensor_mm: SizeMm | None = None,
        source: str | None = None,
    ) -> Intrinsics:
        """K in the canonical form from the format's own numbers.

        Args:
            native: as they stand in the file.
            image_size: (width, height) px.
            sensor_mm: size of the sensor, which millimetres need.
            source: the file's name, for messages.

        Raises:
            ParseError: the numbers make no K.
        """
        sx, sy = self._pixels_per_unit(image_size, sensor_mm)
        centre = (native.cx * sx, native.cy * sy)
        cx, cy = canonical_from_file(centre, self.origin, image_size)
        skew = native.skew * sx
        if self.y_axis is YAxis.UP:
            cy, skew = image_size[1] - cy, _negated(skew)
        try:
            return Intrinsics(
                fx=native.fx * sx, fy=native.fy * sy, cx=cx, cy=cy, skew=skew, image_size=image_size
            )
        except InputError as error:
            raise ParseError(error.message, source=source, place=error.place) from None

    def native(self, intrinsics: Intrinsics, *, sensor_mm: SizeMm | None = None) -> Native:
        """The format's own numbers from a canonical K; the inverse of :meth:`intrinsics`."""
        width, height = size = intrinsics.image_size
        sx, sy = self._pixels_per_unit((width, height), sensor_mm)
        cy, skew = intrinsics.cy, intrinsics.skew
        if self.y_axis is YAxis.UP:
            cy, skew = height - cy, _negated(skew)
        cx, cy = file_from_canonical((intrinsics.cx, cy), self.origin, size)
        return Native(fx=intrinsics.fx / sx, fy=intrinsics.fy / sy, cx=cx / sx, cy=cy / sy, skew=skew / sx)

    def tangential_from_file(self, first: float, second: float) -> tuple[float, float]:
        """OpenCV's (p1, p2) from the two terms in the file's order.

        Only for terms that map undistorted to distorted in x/z, y/z; others are no matter of order and sign.
        """
        if self.tangential is Tangential.NONE:
            return 0.0, 0.0
        p1, p2 = (second, first) if self.tangential is Tangential.SWAPPED else (first, second)
        return self._mirror * p1, p2

    def tangential_to_file(self, p1: float, p2: float) -> tuple[float, float]:
        """The two terms in the file's order; the inverse of :meth:`tangential_from_file`."""
        p1 *= self._mirror
        return (p2, p1) if self.tangential is Tangential.SWAPPED else (p1, p2)

    @property
    def _mirror(self) -> float:
        """Mirroring y changes the sign of the term that is odd in it, which is OpenCV's p1."""
        return -1.0 if self.y_axis is YAxis.UP else 1.0

    def sentences(self) -> tuple[str, ...]:
        """The convention in words, for ``inspect`` and the documentation."""
        order = (f"coefficients {', '.join(self.coefficients)}",) if self.coefficients else ()
        enums = (
            self.unit.value,
            f"the principal point counts from {self.origin.value}",
            self.y_axis.value,
            self.direction.value,
        )
        return (*enums, self.tangential.value, *order, *self.remarks)

    def _pixels_per_unit(self, image_size: ImageSize, sensor_mm: SizeMm | None) -> tuple[float, float]:
        width, height = image_size
        if self.unit is Unit.PIXEL:
            return 1.0, 1.0
        if self.unit is Unit.MILLIMETRE:
            if sensor_mm is None or not min(sensor_mm) > 0:
                raise InputError("millimetres need the sensor's size in mm to become pixels")
            return width / sensor_mm[0], height / sensor_mm[1]
        longer = float(max(image_size))
        return {
            Unit.LONGER_SIDE: (longer, longer),
            Unit.WIDTH: (float(width), float(width)),
            Unit.EACH_SIDE: (float(width), float(height)),
        }[self.unit]


def _negated(value: float) -> float:
    """−value, where zero has no sign: no file that says 0 is to come back as −0."""
    return -value if value else 0.0
