"""``calibrary calibrate --rig``: calibrate the lenses and relative poses of cameras that form a rig."""

from __future__ import annotations

from calibrary.cli.calibrate.keeping import Kept
from calibrary.jobs.calibrate import calibrate_rig

DESCRIPTION = """\
Compute K and distortion of every camera of a rig and their poses relative to one another, in one adjustment.

FRAMES are folders, one for each camera, in which frames of one shot have the same name or number; or a folder or
files whose names state camera and shot: MicaSense (IMG_0001_1.tif), P4 Multispectral, Mavic 3 Multispectral, Sequoia,
left01/right01, or as --pattern states. If only one camera shows the board in a shot, that frame serves the lens of that
camera. It says for each camera and for the rig whether it may be kept FIXED, is a START, or good for NONE.
"""
EXAMPLES = """\
examples:
  calibrary calibrate --rig left/ right/ --board checkerboard:11x8 --square-mm 40 --html rig.html
  calibrary calibrate --rig SET/ --square-mm 40 --reference 5 --out rig_config.json
  calibrary calibrate --rig 'shots/*.png' --pattern '{shot}_{camera}.png' --square-mm 40 --out camchain.yaml
  calibrary calibrate --rig left/ right/ --square-mm 40 --compare extrinsics.yml --corners corners/
  calibrary calibrate --rig --from corners/rig.json --registry ../fleet --rig-name mapper-2

exit codes: 0 good for --use (default: fixed); 1 not, no board, or an error of the registry's check; 3 unreadable input
"""


COMMAND = Kept(
    calibrate_rig,
    DESCRIPTION,
    EXAMPLES,
    doing="finding the board in",
    made=lambda report: report.entries,
    positional={"frames": "FRAMES"},
    spelled={"corners": "--from", "keep_corners": "--corners"},
    without=("tool",),
    groups={
        "which frames belong together": ("pattern", "in_order", "reference", "corners"),
        "the board": ("board", "square_mm", "marker_mm"),
        "how to solve": ("lens_model", "flat", "focus", "workers"),
        "what is written": ("html", "keep_corners", "out", "to", "compare"),
        "the registry": ("registry", "rig_name"),
    },
)
