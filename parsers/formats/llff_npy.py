"""``poses_bounds.npy`` of LLFF, which NeRF and its descendants read: pose, size, focal length and depths of each image.

In the format's own words::

    N×17 numbers: a 3×5 matrix by rows, [R | t | (height, width, focal)], then the nearest and the farthest depth

One focal length for both axes, and the principal point in the middle of the image. COLMAP solved for it, mostly with a
radial distortion, which the file does not keep: the distortion is unknown.

Source: LLFF, README "Using your own poses without running COLMAP"; ``llff/poses/pose_utils.py``, ``save_poses``.
"""

from __future__ import annotations

import re

import numpy as np

from calibrary.calibration import Calibration, Grade
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, Tangential
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats import _npy
from calibrary.parsers.formats._one_camera import camera
from calibrary.quality import Quality
from calibrary.records import replace

CONVENTION = Convention(
    origin=Origin.IMAGE_CENTRE,
    tangential=Tangential.NONE,
    remarks=("one focal length, and the principal point in the middle of the image",),
)
COLUMNS = 17
HWF = (4, 9, 14)
"""Columns of height, width and focal length."""
MOST_IMAGES = 100_000
_SHAPE = re.compile(rb"'shape':\s*\(\d{1,9},\s*17\)")


def sniff(content: Content) -> Sniff | None:
    """A numpy file of rows of 17 numbers."""
    data = content.data
    if data.startswith(_npy.MAGIC) and _SHAPE.search(data[: _npy.LONGEST_HEADER]):
        return Sniff(Sure.SHAPE, "a numpy file with 17 columns, as LLFF's poses_bounds")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera that differs, in the order of the images."""
    rows = _npy.array(data)
    if rows.ndim != 2 or rows.shape[1] != COLUMNS or not 0 < len(rows) <= MOST_IMAGES:
        raise ParseError(f"an array of shape {rows.shape}, expected rows of {COLUMNS} numbers")
    views: dict[tuple[float, ...], int] = {}
    for row in rows[:, HWF].tolist():
        views[tuple(row)] = views.get(tuple(row), 0) + 1
    found = []
    for number, ((height, width, f), count) in enumerate(views.items(), start=1):
        if not np.isfinite(f):
            raise ParseError(f"the focal length is {f:g}, expected a number")
        item = camera(
            context,
            CONVENTION,
            Native(fx=f, fy=f, cx=0.0, cy=0.0),
            strict.image_size(width, height),
            None,
            name=f"camera {number}" if len(views) > 1 else None,
        )
        found.append(replace(item, grade=Grade.ADJUSTED, quality=Quality(views=count)))
    return found


FORMAT = Format(
    name="llff_npy",
    title="LLFF poses_bounds.npy",
    suffixes=(".npy",),
    syntaxes=(Syntax.BINARY,),
    reference="https://github.com/Fyusion/LLFF",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
)
