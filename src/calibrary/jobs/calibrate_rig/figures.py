"""Figures of a rig's page: positions and directions of its cameras, and the reprojection error of each shot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from calibrary.arrays import FloatArray
from calibrary.calib.rig.estimation import RigResult
from calibrary.pages import Figure
from calibrary.pages.palette import Colour
from calibrary.pages.plots import Axis, bars
from calibrary.pages.plots.canvas import draw

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

__all__ = ["rig_picture", "shot_errors"]

REACH: Final = 0.6
"""Distance at which the outline of a camera's view is drawn, relative to the distance between cameras."""
MOST_BARS: Final = 120


def rig_picture(result: RigResult) -> Figure:
    """The cameras from above and from the front, with their fields of view."""
    centres = {result.reference: np.zeros(3)} | {name: pose.centre_mm for name, pose in result.poses.items()}
    turns = {result.reference: np.eye(3)} | {name: pose.rotation for name, pose in result.poses.items()}
    spread = max(float(np.ptp(np.array(list(centres.values())), axis=0).max()), 1.0)
    outlines = {
        name: _outline(result, name, centres[name], turns[name], REACH * spread) for name in result.cameras
    }

    def paint(canvas: Canvas) -> None:
        above, front = canvas.subplots(1, 2)
        for axes, (a, b), labels in (
            (above, (0, 2), ("x, to the right (mm)", "z, ahead (mm)")),
            (front, (0, 1), ("x, to the right (mm)", "y, down (mm)")),
        ):
            for name, corners in outlines.items():
                own = Colour.SECOND if name == result.reference else Colour.ACCENT
                centre = centres[name]
                for corner in corners:
                    axes.plot(
                        [centre[a], corner[a]],
                        [centre[b], corner[b]],
                        color=Colour.MUTED.light,
                        linewidth=0.7,
                    )
                closed = np.concatenate([corners, corners[:1]])
                axes.plot(closed[:, a], closed[:, b], color=own.light, linewidth=1.2)
                axes.plot(centre[a], centre[b], "o", color=own.light, markersize=6)
                axes.annotate(
                    name, (centre[a], centre[b]), xytext=(5, -11), textcoords="offset points", color=own.light
                )
            axes.set_xlabel(labels[0])
            axes.set_ylabel(labels[1])
            axes.set_aspect("equal", adjustable="datalim")
            axes.margins(0.12)
            axes.grid()
        front.invert_yaxis()

    distances = ", ".join(
        f"{name} {np.linalg.norm(at):.1f} mm" for name, at in centres.items() if name != result.reference
    )
    return Figure(
        svg=draw(paint, width=900, height=380),
        alt=f"Plan and front view of the rig; distance from {result.reference}: {distances}.",
        caption=f"The rig from above and from behind, in the frame of {result.reference}: projection centres, and what "
        "each camera sees at a short distance.",
    )


def _outline(
    result: RigResult, name: str, centre: FloatArray, rotation: FloatArray, reach_mm: float
) -> FloatArray:
    """Corners (4, 3) of a camera's view in mm, in the frame of the reference camera."""
    calibration = result.cameras[name].calibration
    width, height = calibration.intrinsics.image_size
    rays = calibration.unproject([[0, 0], [width, 0], [width, height], [0, height]])
    middle = calibration.unproject([[width / 2, height / 2]])
    # An image corner without a ray, as outside a fisheye's circle, is moved towards the centre.
    rays = np.where(np.isfinite(rays), rays, np.where(np.isfinite(middle), middle, (0.0, 0.0, 1.0)))
    along = rays / np.maximum(rays[:, 2:], 0.3) * reach_mm
    return np.asarray(along @ rotation + centre)


def shot_errors(result: RigResult) -> Figure:
    """Reprojection error of each shot over all its cameras, with a single pose of the board."""
    shots = sorted(result.shots, key=lambda shot: -max(shot.rms_px.values()))[:MOST_BARS]
    kept = {shot.name for shot in shots}
    ordered = [shot for shot in result.shots if shot.name in kept]
    return bars(
        [float(np.sqrt(np.mean(np.square(list(shot.rms_px.values()))))) for shot in ordered],
        labels=[f"{shot.name} (apart)" if shot.apart else shot.name for shot in ordered],
        axis=Axis("reprojection error (RMS)", "px"),
        caption="How far corners are from where the rig puts them, by shot, over all cameras. A shot that stands out "
        "was taken while something moved, or its frames do not belong together.",
    )
