"""``calibrary calibrate synth``: render frames of a board with an exactly known camera."""

from __future__ import annotations

import argparse
from typing import Any

from calibrary.cli.shown import Shown
from calibrary.jobs.synth import render_frames

DESCRIPTION = """\
Render frames of a board as a camera would take them, and write the true values beside them: K, distortion, poses
and corners in OUT/truth.json. With these you can test a set-up before you print a board.
"""
EXAMPLES = """\
examples:
  calibrary calibrate synth frames/ --board checkerboard:11x8 --square-mm 40
  calibrary calibrate synth frames/ --board checkerboard:11x8 --square-mm 40 --camera FC6310
  calibrary calibrate synth frames/ --board charuco:8x5 --square-mm 30 --calibration camera.yaml
"""


def _said(truth: Any, arguments: argparse.Namespace) -> list[str]:
    calibration, K = truth.calibration, truth.calibration.intrinsics
    return [
        f"wrote {len(truth.poses)} frames of {K.image_size[0]}×{K.image_size[1]} px by {calibration.camera} to "
        f"{arguments.out}, and K (fx {K.fx:.2f} px) with everything else that is true in truth.json"
    ]


COMMAND = Shown(
    render_frames,
    DESCRIPTION,
    EXAMPLES,
    positional={"out": "OUT"},
    exclusive=(("camera", "calibration"),),
    doing="rendering",
    said=_said,
    json=False,
)
