"""Pictures are the same for the same seed, another country for another, and move along the flight line."""

from __future__ import annotations

import numpy as np

from calibrary.jobs.demo.flight import farmland, infrared
from tests.imagery.jpeg import pixel_scan

SIZE = (960, 640)


def test_one_seed_gives_one_picture() -> None:
    np.testing.assert_array_equal(farmland(SIZE, seed=5), farmland(SIZE, seed=5))
    np.testing.assert_array_equal(infrared(SIZE, seed=5), infrared(SIZE, seed=5))


def test_another_seed_or_place_gives_another() -> None:
    assert (farmland(SIZE, seed=5) != farmland(SIZE, seed=6)).any()
    assert (farmland(SIZE, seed=5) != farmland(SIZE, seed=5, along=0.3)).any()
    assert (infrared(SIZE, seed=5) != infrared(SIZE, seed=6)).any()


def test_two_frames_of_a_line_overlap() -> None:
    first, second = farmland(SIZE, seed=5), farmland(SIZE, seed=5, along=0.25)
    shift = round(0.25 * SIZE[1])
    apart = np.abs(first[:-shift].astype(int) - second[shift:].astype(int))
    assert np.median(apart) <= 12


def test_warm_spots_stand_out_of_cool_ground() -> None:
    red = infrared(SIZE, seed=5)[..., 0]
    assert np.median(red) < 190
    assert red.max() > 250


def test_a_picture_compresses_to_little() -> None:
    pixels = farmland(SIZE, seed=5)
    assert pixels.shape == (640, 960, 3)
    assert pixels.std() > 15
    assert len(pixel_scan(pixels, quality=40)) < 0.035 * SIZE[0] * SIZE[1]
