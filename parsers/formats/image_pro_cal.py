"""Image-Pro's ``.CAL``: how long a pixel is under a microscope and how bright; no camera.

In the format's own words::

    [SPATIAL]
    CalibName=Spatial Cal 0
    UnitName=Pixels
    PixPerUnit=10,10
    Origin=15,15

    [INTENSITY]
    ImageClass=1
    InputRange=0,255

Source: Image-Pro Plus, reference guide, appendix B "File format specifications".
"""

from __future__ import annotations

from calibrary.parsers.content import Content
from calibrary.parsers.format import Format, Sniff, Sure

__all__ = ["FORMAT"]

SECTIONS = ("[SPATIAL]", "[INTENSITY]")
KEYS = ("CALIBNAME=", "UNITNAME=", "PIXPERUNIT=", "IMAGECLASS=", "INPUTRANGE=")


def sniff(content: Content) -> Sniff | None:
    """One of its sections comes first, and one of its keys stands in it."""
    section = content.first_line.upper()
    if section in SECTIONS and any(line.upper().startswith(KEYS) for line in content.lines[1:]):
        return Sniff(Sure.MAGIC, f"it begins with the section {section}")
    return None


FORMAT = Format(
    name="image_pro_cal",
    title="an Image-Pro spatial and intensity calibration",
    suffixes=(".cal",),
    reference="https://mc-hakuto.jp/webhelp/appb_cal.htm",
    sniff=sniff,
    refuses=(
        "it tells how many pixels make a unit of length on a specimen and how grey values scale, nothing of a "
        "lens or a focal length; calibrate the camera from photographs of a board instead"
    ),
)
