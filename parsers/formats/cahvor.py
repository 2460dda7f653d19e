"""JPL's CAHV, CAHVOR and CAHVORE: a camera as four to seven vectors of the world.

In the format's own words::

    Dimensions = 1024 768
    Model = CAHVOR = perspective, distortion
    C = …    A = …    H = …    V = …    O = …    R = …
    Hs = …   Hc = …   Vs = …   Vc = …   Theta = …

The vectors hold position and orientation together with the image, and the lens of CAHVOR bends rays about an
axis O of its own, which is not the one that K is about.

Source: D. Gennery, "Generalized camera calibration including fish-eye lenses", IJCV 68 (2006).
"""

from __future__ import annotations

import re

from calibrary.parsers.content import Content
from calibrary.parsers.format import Format, Sniff, Sure

__all__ = ["FORMAT"]

NEAR_TOP = 100

_MODEL = re.compile(r"Model\s*=\s*(CAHV(?:OR)?E?)\b")


def sniff(content: Content) -> Sniff | None:
    """The line that names the model."""
    found = next((match for line in content.lines[:NEAR_TOP] if (match := _MODEL.match(line))), None)
    return Sniff(Sure.MAGIC, f"it holds Model = {found[1]}") if found else None


FORMAT = Format(
    name="cahvor",
    title="a CAHV, CAHVOR or CAHVORE camera",
    suffixes=(".cahvor", ".cahv", ".cahvore", ".cal"),
    reference="https://mrcal.secretsauce.net/mrcal-from-cahvor.html",
    sniff=sniff,
    refuses=(
        "its vectors mix the lens with the pose, and its lens has an axis of its own, which no other program's "
        "model has; convert it with mrcal-from-cahvor, then to one of OpenCV's models with "
        "mrcal-convert-lensmodel, and read that"
    ),
)
