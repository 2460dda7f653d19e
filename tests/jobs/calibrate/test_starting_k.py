"""The K that the solution of a flight begins at: a focal length, a file or an entry, and one of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrary.errors import InputError
from calibrary.jobs.calibrate_flight.run import starting_k

SIZE = (4000, 3000)


def test_none_is_given_if_nothing_is_said() -> None:
    assert starting_k(None, None, None, SIZE) is None


def test_a_number_is_a_focal_length_with_the_principal_point_in_the_middle(tmp_path: Path) -> None:
    K = starting_k(3000, None, None, SIZE)
    assert K is not None
    assert (K.fx, K.fy, K.cx, K.cy, K.image_size) == (3000, 3000, 2000, 1500, SIZE)
    # Between a tenth and thirty times the longer side.
    for focal in (400, 120_000, 1):
        with pytest.raises(InputError, match="not a focal length"):
            starting_k(focal, None, None, SIZE)
    with pytest.raises(InputError):
        starting_k(tmp_path / "none.yaml", None, None, SIZE)


def test_two_ways_to_begin_are_one_too_many() -> None:
    with pytest.raises(InputError, match="give one"):
        starting_k(3000, "dji/fc6310r", None, SIZE)


def test_without_an_image_that_can_be_read_there_is_no_size_for_it() -> None:
    with pytest.raises(InputError, match="cannot be read"):
        starting_k(3000, None, None, None)
