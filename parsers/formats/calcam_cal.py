"""CalCam, a camera file that Metashape exports beside a dozen others: known by name only.

Metashape lists it among its export formats::

    Tools ▸ Camera Calibration ▸ Save ▸ CalCam Camera Calibration (*.cal)

and its Python interface as ``CalibrationFormat.CalibrationFormatCalCam``. Nobody describes what is in it, so
nothing is guessed: a wrong sign of a principal point passes every glance. (Plasma physicists' ``calcam`` of
the same name writes ``.ccc`` archives and has nothing to do with it.)

Source: Agisoft Metashape User Manual, appendix B "Supported formats".
"""

from __future__ import annotations

import re

from calibrary.parsers.content import Content
from calibrary.parsers.format import Format, Sniff, Sure

__all__ = ["FORMAT"]

_NAME = re.compile(r"\bcalcam\b", re.IGNORECASE)
NEAR_TOP = 5


def sniff(content: Content) -> Sniff | None:
    """Its name in the first lines of a text that is no markup."""
    if content.xml_tags or content.json is not None:
        return None
    if any(_NAME.search(line) for line in content.lines[:NEAR_TOP]):
        return Sniff(Sure.SHAPE, "its first lines name CalCam")
    return None


FORMAT = Format(
    name="calcam_cal",
    title="a CalCam camera calibration",
    suffixes=(".cal",),
    reference="https://www.agisoft.com/pdf/metashape-pro_2_2_en.pdf",
    sniff=sniff,
    refuses=(
        "no description of the format is public; in Metashape export Agisoft XML instead "
        "(Tools ▸ Camera Calibration ▸ Save ▸ Agisoft Camera Calibration)"
    ),
)
