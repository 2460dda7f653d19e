"""``calibrary calibrate flight``: self-calibration of a camera from the images of a flight, without a board."""

from __future__ import annotations

from calibrary.cli.calibrate.keeping import Kept
from calibrary.jobs.calibrate import calibrate

DESCRIPTION = """\
Compute a camera's K and distortion from the images of a flight, and report how far to trust them.

The command chooses some 30 images that overlap, of different heights, headings and tilts if there are any. It finds
the points that they share, and adjusts lens, poses and points together. It weights positions in the images by their
own standard deviation and writes them nowhere. A flight over flat ground at one height, straight down, does not
determine the focal length: the command reports that, within what fx is known, and what to fly. Needs
"calibrary[sfm]". Without --date the day of the images is taken, if they state one.

With --from the points are those of a finished reconstruction: COLMAP's sparse model, or the result of OpenSfM or ODM.
They are adjusted and judged in the same way and need no other library. DIR then states the camera and where the images
were taken; you may omit it.

With --points the command also uses surveyed points on the ground, with marks that show where images see them: the
gcp_list.txt of ODM and WebODM, whose first line names the coordinate system. Points at different heights help most.
A constant offset to the positions in the images, such as the height of the geoid, is solved for;
--same-datum-m states how small it is.
"""
EXAMPLES = """\
examples:
  calibrary calibrate flight flight/ --html flight.html
  calibrary calibrate flight flight/ --images 40 --registry ../fleet
  calibrary calibrate flight flight/ --from-registry dji/fc6310r/5472x3648 --registry ../fleet --json
  calibrary calibrate flight flight/ --start 3650 --out camera.xml --to agisoft_xml
  calibrary calibrate flight flight/ --from project/sparse/0 --registry ../fleet
  calibrary calibrate flight flight/ --points gcp_list.txt --points-std-m 0.02 --html flight.html
  calibrary calibrate flight --from odm_project --make DJI --model FC6310R --html flight.html

exit codes: 0 good for --use (default: fixed); 1 not, images that do not fit together, or the registry's check
  objects; 3 unreadable input
"""
OF_A_BOARD = (
    "board",
    "square_mm",
    "marker_mm",
    "skip_other_sizes",
    "corners",
    "pixel_origin",
    "flat",
    "keep_corners",
    "workers",
)

COMMAND = Kept(
    calibrate,
    DESCRIPTION,
    EXAMPLES,
    doing="flight:",
    made=lambda report: [report.entry],
    always=("flight",),
    positional={"frames": "DIR"},
    spelled={"most": "--images", "result_of": "--from", "camera_number": "--camera", "seed_k": "--start"},
    exclusive=(("seed_k", "from_registry"),),
    without=("tool", *OF_A_BOARD),
    groups={
        "a finished reconstruction": ("result_of", "camera_number"),
        "where the search begins": ("seed_k", "from_registry"),
        "how to solve": ("lens_model", "max_side_px", "focus"),
        "ground control": ("points", "points_std_m", "mark_std_px", "same_datum_m"),
        "what is written": ("html", "out", "to"),
        "the registry": ("registry", "as_"),
    },
    switches={"--correlations": "also show correlated parameters"},
)
