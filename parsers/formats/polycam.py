"""Polycam's cameras: JSON of fx, fy, cx, cy and a pose, one file for each image.

In the format's own words::

    {"fx": 1360.2, "fy": 1360.2, "cx": 514.9, "cy": 385.3, "width": 1024, "height": 768, "t_00": 0.7, …}

The numbers are ARKit's, which count from the corner of the image. The images are not corrected, and no distortion is
stated.

Sources: Polycam, "Raw data export", whose program is closed; nerfstudio, ``process_data/polycam_utils.py``, which
copies the numbers unchanged to a transforms.json, and ``cameras/cameras.py``, ``get_image_coords``, which has the
pixels' centres at 0.5, 1.5, … of it.
"""

from __future__ import annotations

from calibrary.calibration import Calibration
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._json_text import loaded
from calibrary.parsers.formats._one_camera import ORIGIN, camera, chosen_origin
from calibrary.records import replace

CONVENTION = Convention(origin=Origin.CORNER, remarks=("every number has its name",))
PLACE = ("fx", "fy", "cx", "cy")
MARKS = ("t_00", "t_01")


def sniff(content: Content) -> Sniff | None:
    """The four names beside a pose as Polycam writes it."""
    if set(content.json_keys) >= {*PLACE, *MARKS}:
        return Sniff(Sure.MAGIC, "JSON with fx, fy, cx, cy and Polycam's t_00")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera."""
    document = loaded(data, context)
    fx, fy, cx, cy = (document[key].number() for key in PLACE)
    origin, sentence = chosen_origin(context, CONVENTION.origin)
    size = document.image_size("width", "height") if "width" in document else None
    native = Native(fx=fx, fy=fy, cx=cx, cy=cy)
    return [camera(context, replace(CONVENTION, origin=origin), native, size, None, assumptions=(sentence,))]


FORMAT = Format(
    name="polycam",
    title="Polycam camera",
    suffixes=(".json",),
    syntaxes=(Syntax.JSON,),
    reference="https://github.com/PolyCam/polyform",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    options=(ORIGIN,),
)
