"""Point Grey's (FLIR's, Teledyne's) Ladybug and Triclops calibrations: known by name, their lens model is not.

A Ladybug's parameters, as its programs print them::

    camera_model=Ladybug5 …
    camera_serialBase=…
    camera0_rotX=…
    camera0_transX=…
    camera0_FocalLen=…
    camera0_CameraCenterX=…

The focal lengths belong to images that the vendor's own library has rectified through tables that stand
nowhere in the text; the ``.cal`` file itself is not described by its maker.

Source: Teledyne, "Accessing Ladybug camera calibration data": the format is not published, the SDK reads it.
"""

from __future__ import annotations

import re

from calibrary.parsers.content import Content
from calibrary.parsers.format import Format, Sniff, Sure

__all__ = ["FORMAT"]

_NAME = re.compile(r"\b(?:ladybug|triclops|bumblebee|digiclops)", re.IGNORECASE)
_NUMBERED = re.compile(r"camera\d+_(?:FocalLen|CameraCenterX|rotX)\s*=", re.IGNORECASE)
NEAR_TOP = 40
"""Lines; a remark on a Ladybug farther down does not make a file one."""


def sniff(content: Content) -> Sniff | None:
    """Numbered cameras in the vendor's spelling, or the vendor's product in a file that is no markup."""
    if content.xml_tags or content.json is not None:
        return None
    top = content.lines[:NEAR_TOP]
    if any(_NUMBERED.match(line) for line in top):
        return Sniff(Sure.MAGIC, "it holds camera0_FocalLen and the like, as Ladybug programs print them")
    first = _NAME.search(content.first_line)
    if first is not None:
        return Sniff(Sure.WEAK, f"the first line names {first[0]}")
    return None


FORMAT = Format(
    name="ladybug_cal",
    title="a Ladybug or Triclops calibration",
    suffixes=(".cal", ".ini"),
    reference="https://www.teledynevisionsolutions.com/support/support-center/application-note/iis/geometric-vision-using-ladybug-cameras/",
    sniff=sniff,
    refuses=(
        "its maker does not publish what the numbers mean, and each of the camera's heads is a wide-angle lens "
        "that K alone does not describe; let the Ladybug SDK rectify the images and take the focal length and "
        "centre that it reports for them, or calibrate each head from photographs of a board"
    ),
)
