"""What the page of a calibration from a flight shows of the flight."""

from __future__ import annotations

import re

import numpy as np
import pytest

from calibrary.calib.observations import ControlPoints
from calibrary.calib.result import CalibrationResult, rows
from calibrary.jobs.calibrate.page_plots import flight_plots
from calibrary.records import replace
from calibrary.rotations import rotation_matrix
from calibrary.sfm.adjust import adjust
from calibrary.sfm.assessment import flight_result
from calibrary.view import Figure, SideBySide
from tests.sfm.flights import Plan, fly


@pytest.fixture(scope="module")
def flat() -> CalibrationResult:
    """Straight down, within few degrees."""
    return flight_result(adjust(*fly(Plan(relief=0.02, rows=2, columns=4, points=250, outliers=0.0), 1)))


@pytest.mark.parametrize("degrees", [0.0, 60.0])
def test_images_that_look_straight_down_are_drawn_so_however_the_world_leans(
    flat: CalibrationResult, degrees: float
) -> None:
    # In a world that leans, as positions may have turned it.
    turn = rotation_matrix(np.array([np.radians(degrees), 0.0, 0.0]))
    ground = ControlPoints(points=flat.observations.board.points @ turn.T)
    views = [
        replace(view, rotation=rows(np.array(view.rotation) @ turn.T)) if view.rotation is not None else view
        for view in flat.views
    ]
    [beside] = flight_plots(views, replace(flat.observations, board=ground))
    assert isinstance(beside, SideBySide)
    looked = beside.blocks[1]
    assert isinstance(looked, Figure)
    found = re.search(r"views, [\d.]+ to ([\d.]+) °", looked.alt)
    assert found is not None, looked.alt
    assert float(found[1]) < 15.0
