"""The K that a solution begins at: a focal length, a file or, of a flight, an entry; and one of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrary.errors import InputError, UsageError
from calibrary.jobs.calibrate import Flight, calibrate
from calibrary.jobs.calibrate.run import starting_k

SIZE = (4000, 3000)


def test_a_number_is_a_focal_length_with_the_principal_point_in_the_middle(tmp_path: Path) -> None:
    K = starting_k(3000, SIZE)
    assert (K.fx, K.fy, K.cx, K.cy, K.image_size) == (3000, 3000, 2000, 1500, SIZE)
    # Between a tenth and thirty times the longer side.
    for focal in (400, 120_000, 1):
        with pytest.raises(InputError, match="not a focal length"):
            starting_k(focal, SIZE)
    with pytest.raises(InputError):
        starting_k(tmp_path / "none.yaml", SIZE)


def test_two_ways_to_begin_are_one_too_many(tmp_path: Path) -> None:
    (tmp_path / "a.jpg").touch()
    with pytest.raises(UsageError, match="give one"):
        calibrate(tmp_path, flight=Flight(from_registry="dji/fc6310r"), seed_k=3000)


def test_without_an_image_that_can_be_read_there_is_no_size_for_it(tmp_path: Path) -> None:
    (tmp_path / "a.jpg").touch()
    with pytest.raises(InputError, match="cannot be read"):
        calibrate(tmp_path, flight=Flight(), seed_k=3000)


def test_what_is_of_a_board_is_refused_of_a_flight(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="a flight has no board"):
        calibrate(tmp_path, flight=Flight(), board="checkerboard:9x6")
    with pytest.raises(UsageError, match="expected of a flight"):
        calibrate(tmp_path, flight=Flight(), lens_model="mei")
