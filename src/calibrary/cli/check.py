"""``calibrary check``: check whether a K is right for the images of a flight before it is used."""

from __future__ import annotations

from calibrary.cli.shown import Shown
from calibrary.jobs.check import check

DESCRIPTION = (
    "Check whether the K that you are about to use is right for the images of a flight, and by how much it "
    "is off, in per cent and on the ground. ('calibrary registry check' checks the entries of a registry.)"
)
EXAMPLES = """\
examples:
  calibrary check flight/                        every calibration file beside the images
  calibrary check flight/ K.npy                  a K, of any format, for these images
  calibrary check flight/ camera.xml cameras.json --altitude-m 60
  calibrary check flight/ K.npy --json           the same for machines
  calibrary check flight/ --verify               the K of tags and files against the pixels of a dozen images

exit code 0: every file is right for every camera that it can belong to; 1: at least one is off, or the images give
no valid K to compare it with, or it is a start only, as the profile of a kind of lens.
"""

COMMAND = Shown(
    check,
    DESCRIPTION,
    EXAMPLES,
    positional={"images": "FOLDER", "files": "FILE"},
    doing="checking",
    exits={"is_right": 1},
)
