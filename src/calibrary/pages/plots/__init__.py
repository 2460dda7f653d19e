"""Plots for pages: from plain numbers to a :class:`~calibrary.pages.Figure` with a text description.

Most are drawn by matplotlib in the palette's light colours; inside a page they follow the reader's theme.
"""

from calibrary.pages.plots.canvas import Axis
from calibrary.pages.plots.charts import bars, correlations, poses
from calibrary.pages.plots.frames import displacement, distortion_map, radial_curve
from calibrary.pages.plots.intervals import Band, Interval, Role, intervals

__all__ = [
    "Axis",
    "Band",
    "Interval",
    "Role",
    "bars",
    "correlations",
    "displacement",
    "distortion_map",
    "intervals",
    "poses",
    "radial_curve",
]
