"""Synthetic images of a board in a known camera.

The correct result of a calibration is then known. This is used by the tests, by the demo, and for testing a set-up
before a flight.
"""

from calibrary.calib.synthesis.poses import poses
from calibrary.calib.synthesis.rendering import render, render_raw
from calibrary.calib.synthesis.settings import Settings
from calibrary.calib.synthesis.sheet import Pose, Sheet, Shutter, seen_corners
from calibrary.calib.synthesis.truth import Truth

__all__ = [
    "Pose",
    "Settings",
    "Sheet",
    "Shutter",
    "Truth",
    "poses",
    "render",
    "render_raw",
    "seen_corners",
]
