"""Local metric frame (east, north, up) at a place on the WGS 84 ellipsoid.

A degree of latitude is 110.6 to 111.7 km long, and metres of a map projection differ from metres on the ground.
Positions and points are therefore converted exactly: different scales of east and north would change the focal length.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from msgspec import Struct
from numpy.typing import ArrayLike

from calibrary.arrays import FloatArray

SEMI_MAJOR_M: Final = 6_378_137.0
FLATTENING: Final = 1 / 298.257223563
"""NIMA TR8350.2, "Department of Defense World Geodetic System 1984", table 3.1."""
ECCENTRICITY2: Final = FLATTENING * (2 - FLATTENING)


class LocalFrame(Struct, frozen=True, kw_only=True):
    """A local frame with the axes east, north and up at its origin.

    Attributes:
        longitude_deg, latitude_deg, height_m: origin, WGS 84.
    """

    longitude_deg: float
    latitude_deg: float
    height_m: float

    @classmethod
    def around(cls, places: FloatArray) -> LocalFrame:
        """Make the frame at the median of (N, 3) longitudes, latitudes (degrees) and heights (m)."""
        longitude, latitude, height = np.median(places, axis=0).tolist()
        return cls(longitude_deg=longitude, latitude_deg=latitude, height_m=height)

    def metres(self, places: ArrayLike) -> FloatArray:
        """Convert to (N, 3) m east, north and up of the origin.

        Args:
            places: (N, 3) longitudes, latitudes (degrees) and heights (m).
        """
        lon, lat = np.radians([self.longitude_deg, self.latitude_deg])
        (s, c), (sin, cos) = (np.sin(lon), np.cos(lon)), (np.sin(lat), np.cos(lat))
        east_north_up = np.array([[-s, c, 0.0], [-sin * c, -sin * s, cos], [cos * c, cos * s, sin]])
        origin = _geocentric(np.array([[self.longitude_deg, self.latitude_deg, self.height_m]]))
        return np.asarray((_geocentric(np.asarray(places, dtype=np.float64)) - origin) @ east_north_up.T)


def _geocentric(places: FloatArray) -> FloatArray:
    """Return (N, 3) geocentric coordinates, m; B. Hofmann-Wellenhof et al., "GNSS", 2008, equation 8.7."""
    lon, lat, height = np.radians(places[:, 0]), np.radians(places[:, 1]), places[:, 2]
    normal = SEMI_MAJOR_M / np.sqrt(1 - ECCENTRICITY2 * np.sin(lat) ** 2)
    across = (normal + height) * np.cos(lat)
    return np.column_stack(
        [across * np.cos(lon), across * np.sin(lon), ((1 - ECCENTRICITY2) * normal + height) * np.sin(lat)]
    )
