"""Frames, or only their corners, of a board under a camera that is known exactly.

What a calibration should find is known beforehand: the tests, the demo and everybody who wants to judge a
set-up before a flight photograph the board here.
"""

from calibrary.calib.synthesis.observe import Truth, observe
from calibrary.calib.synthesis.poses import poses
from calibrary.calib.synthesis.render import render, render_raw
from calibrary.calib.synthesis.settings import Settings
from calibrary.calib.synthesis.sheet import Pose, Sheet, Shutter, seen_corners

__all__ = [
    "Pose",
    "Settings",
    "Sheet",
    "Shutter",
    "Truth",
    "observe",
    "poses",
    "render",
    "render_raw",
    "seen_corners",
]
