"""Calibrations of other sensors that share the ending ``.cal``: inertial, magnetic, radiometric, display.

Such files hold biases, gains or response curves under keys of their own::

    accel_bias = …                       DEVICE_CLASS "DISPLAY"
    gyro_scale = …                       NUMBER_OF_FIELDS 4
    mag_offset_x = …                     KEYWORD "RGB_I"

None of them says anything of where a lens puts a ray.

Source: ArgyllCMS, "Description of the .cal format", for displays; the others are makers' habits, no format.
"""

from __future__ import annotations

import re

from calibrary.parsers.content import Content
from calibrary.parsers.format import Format, Sniff, Sure

__all__ = ["FORMAT"]

_KEY = re.compile(r"\s*[\"']?([A-Za-z][\w .\-\[\]]{0,60}?)[\"']?\s*[=:,\s]")
_INERTIAL = re.compile(r"acc(?:el\w*)?|gyro\w*|mag(?:net\w*)?|imu|barom\w*")
_RADIOMETRIC = re.compile(
    r"radian\w*|irradian\w*|radiometr\w*|darkcurrent|vignett\w*|wavelengths?|reflectance\w*"
)
_PARTS = re.compile(r"[^a-z]+")
_LENS = re.compile(r"focal|principal|distort|\bf[xy]\b|\bc[xy]\b|fc\b|camera_matrix|intrinsic", re.IGNORECASE)
NEAR_TOP = 200
FEWEST = 2
"""One such word may stand anywhere; two at the head of lines make the subject."""


def sniff(content: Content) -> Sniff | None:
    """Keys of another sensor, and not a word about a lens."""
    if content.first_line.split()[:1] == ["CAL"] and "DEVICE_CLASS" in (content.text or ""):
        return Sniff(Sure.MAGIC, "it begins with CAL and holds DEVICE_CLASS, as ArgyllCMS writes displays")
    if content.xml_tags or content.json is not None:
        return None
    words = [
        word
        for line in content.lines[:NEAR_TOP]
        if (key := _KEY.match(line))
        for word in _PARTS.split(key[1].lower())
        if _INERTIAL.fullmatch(word) or _RADIOMETRIC.fullmatch(word)
    ]
    if len(words) >= FEWEST and not _LENS.search(content.text or ""):
        return Sniff(Sure.WEAK, f"its keys speak of {', '.join(dict.fromkeys(words[:4]))}, none of a lens")
    return None


FORMAT = Format(
    name="sensor_cal",
    title="a calibration of another sensor (inertial, magnetic, radiometric or display)",
    suffixes=(".cal",),
    reference="https://www.argyllcms.com/doc/cal_format.html",
    sniff=sniff,
    refuses=(
        "it says nothing of focal length, principal point or distortion; ask whoever made the camera for its "
        "geometric calibration, or calibrate it from photographs of a board"
    ),
)
