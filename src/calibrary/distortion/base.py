"""What every distortion model can do, and the perspective geometry they share."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import fields
from typing import ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]


class Distortion(ABC):
    """How a lens departs from a pinhole: a map from ideal to observed normalised coordinates.

    A model is a frozen dataclass whose fields are its coefficients, in the order of its source. Normalised
    coordinates are x/z, y/z: K turns the observed ones into pixels. Arrays are (N, 2) float64 throughout;
    where the model has no answer the row is NaN.
    """

    __slots__ = ()

    model: ClassVar[str]
    """The name files and reports use."""

    @property
    def coefficients(self) -> dict[str, float]:
        """The coefficients by name, in the model's order."""
        return {f.name: float(getattr(self, f.name)) for f in fields(self)}  # type: ignore[arg-type]

    @abstractmethod
    def distort(self, xy: FloatArray) -> FloatArray:
        """Ideal (x/z, y/z) to observed; NaN past :meth:`valid_radius`."""

    @abstractmethod
    def undistort(self, xy: FloatArray) -> FloatArray:
        """Observed to ideal (x/z, y/z); NaN where nothing inside :meth:`valid_radius` is seen there."""

    @abstractmethod
    def valid_radius(self) -> float:
        """The largest radius, in ideal normalised coordinates, of a disc on which the model is one-to-one.

        At this radius the image folds back over itself; ``inf`` when it never does.
        """

    def observe(self, rays: FloatArray) -> FloatArray:
        """(N, 3) directions to (N, 2) observed coordinates; NaN for what the camera cannot see."""
        return self.distort(perspective(rays))

    def rays(self, xy: FloatArray) -> FloatArray:
        """(N, 2) observed coordinates to (N, 3) unit directions; NaN where nothing is seen."""
        return unit_rays(self.undistort(xy))


def perspective(rays: FloatArray) -> FloatArray:
    """(N, 3) directions to (N, 2) x/z, y/z; NaN for what is not in front of the camera."""
    z = rays[:, 2]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        inverse = np.where(z > 0, 1.0 / z, math.nan)
        return rays[:, :2] * inverse[:, None]


def unit_rays(xy: FloatArray) -> FloatArray:
    """(N, 2) x/z, y/z to (N, 3) unit directions."""
    rays = np.column_stack([xy, np.ones(len(xy))])
    return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))
