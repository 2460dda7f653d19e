"""``calibrary undistort``: undistort images, and write the K that applies to the undistorted images."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from calibrary.cli.shown import Shown
from calibrary.jobs.undistort import undistort

if TYPE_CHECKING:
    from calibrary.jobs.undistort.run import UndistortReport

DESCRIPTION = "Remove lens distortion from images, and write the new K beside them."
EXAMPLES = """\
examples:
  calibrary undistort flight/ --calibration camera.xml              into ./undistorted
  calibrary undistort a.jpg --calibration camera.xml --keep all     no pixel is lost
  calibrary undistort a.jpg --calibration camera.xml --keep valid   no pixel is empty
  calibrary undistort a.jpg --calibration camera.xml --keep 0.3     as with OpenCV's alpha 0.3
  calibrary undistort *.tif --calibration rig.xml --camera 2 --keep all --size same-focal
  calibrary undistort flight/ --calibration camera.xml --to colmap --mask

The new K is written beside the pictures, without distortion. The orientation of EXIF is not applied. JPEG and PNG
keep the colour profile and EXIF (without maker's notes and thumbnail; without focal lengths if these change). They do
not keep XMP, because cameras store their distortion there; it states "lens profile applied" instead. TIFFs keep only
the pixels.

exit code 0: every picture was undistorted; 3: at least one was not.
"""

GROUPS = {
    "what the new pictures show": ("keep", "size", "max_angle_deg"),
    "how they are written": ("interpolation", "kind", "quality", "mask", "to"),
}


class _Undistort(Shown):
    def show(self, done: UndistortReport, arguments: argparse.Namespace, **_: Any) -> None:
        super().show(done, arguments, folder=arguments.out or "undistorted")


COMMAND = _Undistort(
    undistort,
    DESCRIPTION,
    EXAMPLES,
    positional={"images": "IMAGE"},
    groups=GROUPS,
    doing="undistorting",
    exits={"is_good": 3},
)
