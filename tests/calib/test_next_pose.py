"""Where the board is asked for next."""

from __future__ import annotations

import numpy as np
import pytest

from calibrary.calib.lens_models import Solvable
from calibrary.calib.network import State
from calibrary.calib.next_pose import _candidates
from tests.calib.solving import BOARD, SIZE


@pytest.mark.parametrize("share", [0.2, 0.5])
def test_a_board_is_held_so_that_it_fills_a_share_of_the_images_width(share: float) -> None:
    lens = np.array([1450.0, 1450.0, 960.0, 720.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    state = State(
        model=Solvable.BROWN,
        parameters=lens,
        warp=np.zeros(2),
        rotations=np.zeros((0, 3, 3)),
        translations=np.zeros((0, 3)),
    )
    network, held = _candidates(BOARD, SIZE, state, np.array([[0.5, 0.5, 0.0, 0.0, share]]))
    inside = network.points[0] @ held.rotations[0].T + held.translations[0]
    x = 1450.0 * inside[:, 0] / inside[:, 2]
    assert np.ptp(x) == pytest.approx(share * SIZE[0])
    assert held.translations[0, 2] > 0
