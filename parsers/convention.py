"""Conventions of a format as data; the same record generates the documentation and performs the conversion.

The value of each enum member is the text shown to the user. :mod:`calibrary.calibration` handles the pixel
origin; this module handles units, the direction of y and the order of the tangential terms.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum
from typing import Self, TypeAlias

from msgspec import Struct

from calibrary.calibration import ImageSize, Intrinsics, Origin, canonical_from_file, file_from_canonical
from calibrary.errors import InputError, ParseError

__all__ = ["Convention", "Direction", "Native", "Origin", "Tangential", "Unit", "YAxis"]

SizeMm: TypeAlias = tuple[float, float]
"""(width, height) of the sensor in mm."""


class Unit(Enum):
    """Unit of focal lengths and principal points."""

    PIXEL = "pixels"
    MILLIMETRE = "millimetres on the sensor"
    LONGER_SIDE = "fractions of the image's longer side"
    WIDTH = "fractions of the image's width"
    EACH_SIDE = "fractions of the image's width in x and of its height in y"


class YAxis(Enum):
    """Direction of the y axis, in the image and in the camera frame."""

    DOWN = "y points down"
    UP = "y points up"


class Direction(Enum):
    """Direction in which the distortion polynomial maps."""

    UNDISTORTED_TO_DISTORTED = "the polynomial maps the undistorted point to the distorted one, as in OpenCV"
    DISTORTED_TO_UNDISTORTED = (
        "the polynomial maps the distorted point to the undistorted one, inverse to OpenCV"
    )


class Tangential(Enum):
    """Definition of the two tangential coefficients."""

    OPENCV = "x gets 2·p1·x·y + p2·(r² + 2x²), as in OpenCV"
    SWAPPED = "x gets p1·(r² + 2x²) + 2·p2·x·y, so p1 and p2 are OpenCV's p2 and p1"
    NONE = "no tangential terms"


class Native(Struct, frozen=True, kw_only=True):
    """The numbers of K in the format's own unit, origin and direction of y."""

    fx: float
    fy: float
    cx: float
    cy: float
    skew: float = 0.0

    @classmethod
    def of_matrix(
        cls, rows: Sequence[Sequence[float]], *, place: str | None, source: str | None = None
    ) -> Self:
        """Take the numbers from a 3×3 camera matrix.

        Args:
            rows: three rows of three numbers.
            place: place of the matrix in the file, for messages.
            source: file name, for messages.

        Raises:
            ParseError: it is not [[fx, skew, cx], [0, fy, cy], [0, 0, 1]]; the message states what it looks
                like.
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
    """Conventions of a format.

    Attributes:
        unit: of focal lengths and principal point.
        origin: of the principal point.
        y_axis: direction of y.
        direction: in which the distortion maps.
        tangential: definition of p1 and p2.
        coefficients: names of the distortion coefficients in the file's order, or those that it names.
        remarks: other facts for the documentation, one sentence each.
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
        """Convert the format's own numbers to the canonical form.

        Args:
            native: the numbers in the file.
            image_size: (width, height) px.
            sensor_mm: size of the sensor, needed if the unit is mm.
            source: file name, for messages.

        Raises:
            ParseError: the numbers are not a valid K.
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
        """Convert a canonical K to the format's own numbers; the inverse of :meth:`intrinsics`."""
        width, height = size = intrinsics.image_size
        sx, sy = self._pixels_per_unit((width, height), sensor_mm)
        cy, skew = intrinsics.cy, intrinsics.skew
        if self.y_axis is YAxis.UP:
            cy, skew = height - cy, _negated(skew)
        cx, cy = file_from_canonical((intrinsics.cx, cy), self.origin, size)
        return Native(fx=intrinsics.fx / sx, fy=intrinsics.fy / sy, cx=cx / sx, cy=cy / sy, skew=skew / sx)

    def tangential_from_file(self, first: float, second: float) -> tuple[float, float]:
        """Convert the two terms in the file's order to OpenCV's (p1, p2).

        Only for terms that map undistorted to distorted in x/z, y/z; others differ by more than order and sign.
        """
        if self.tangential is Tangential.NONE:
            return 0.0, 0.0
        p1, p2 = (second, first) if self.tangential is Tangential.SWAPPED else (first, second)
        return self._mirror * p1, p2

    def tangential_to_file(self, p1: float, p2: float) -> tuple[float, float]:
        """Convert OpenCV's (p1, p2) to the file's order; the inverse of :meth:`tangential_from_file`."""
        p1 *= self._mirror
        return (p2, p1) if self.tangential is Tangential.SWAPPED else (p1, p2)

    @property
    def _mirror(self) -> float:
        """Sign of OpenCV's p1: mirroring y changes the sign of this term, which is odd in y."""
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
        if self.unit is Unit.EACH_SIDE:
            return float(width), float(height)
        side = float(width if self.unit is Unit.WIDTH else max(image_size))
        return side, side


def _negated(value: float) -> float:
    """−value without a negative zero, so that a 0 in a file is not written back as −0."""
    return -value if value else 0.0
