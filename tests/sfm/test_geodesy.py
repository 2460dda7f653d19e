"""Metres around a place, against PROJ's."""

from __future__ import annotations

import numpy as np
import pytest

from calibrary.sfm.geodesy import LocalFrame


@pytest.mark.parametrize(
    ("origin", "place", "metres"),
    [
        ((8.51234, 47.31642, 450.0), (8.52234, 47.32642, 500.0), (755.974676, 1111.906845, 49.858247)),
        ((8.51234, 47.31642, 450.0), (8.5, 47.3, 420.0), (-933.326117, -1825.570355, -30.329738)),
        ((-70.5, -33.4, 100.0), (-70.49, -33.41, 130.0), (930.204821, -1109.184225, 29.835440)),
    ],
)
def test_metres_are_those_of_proj(
    origin: tuple[float, ...], place: tuple[float, ...], metres: tuple[float, ...]
) -> None:
    """PROJ 9.5.1: ``+proj=cart +ellps=WGS84`` and ``+proj=topocentric +ellps=WGS84`` at the origin."""
    frame = LocalFrame(longitude_deg=origin[0], latitude_deg=origin[1], height_m=origin[2])
    np.testing.assert_allclose(frame.metres([place])[0], metres, atol=1e-6)


def test_the_origin_is_in_the_middle() -> None:
    places = np.array([(8.0, 47.0, 400.0), (8.002, 47.001, 480.0), (8.001, 47.004, 410.0)])
    found = LocalFrame.around(places).metres(places)
    assert np.abs(np.median(found, axis=0)).max() < 0.05
