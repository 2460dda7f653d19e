"""Key-value calibration sheets, as calibrary writes them: one key to a line, its unit in its name.

In the format's own words::

    # Camera calibration: one key to a line, its unit in its name.
    model = X-20
    calibrated by = A. Laboratory
    date = 2019-05-14
    distortion_model = brown
    k1 = -0.1131
    principal_point_origin = corner
    image_width_px = 5472
    fx_px = 3650.1

Sheets of other people are read as all that is made by hand (``hand_made``), which knows many more words, and lengths in
mm with the pitch of the pixels.

Source: none but the sheets; photogrammetric usage and OpenCV's documentation for the names.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from calibrary.calibration import Calibration, Quality
from calibrary.distortion import BrownConrady, KannalaBrandt, NoDistortion, Rational
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Origin
from calibrary.parsers.format import (
    STATED,
    Capacity,
    Format,
    ReadContext,
    Sniff,
    Sure,
    UnknownLens,
    WriteContext,
)
from calibrary.parsers.formats import hand_made
from calibrary.parsers.formats._json_text import restored
from calibrary.parsers.formats._tree import tree_of

HEADING = "# Camera calibration: one key to a line, its unit in its name."
CONVENTION = Convention(
    origin=Origin.CORNER,
    remarks=("pixels or millimetres, as each key states", "principal_point_origin and y_axis are followed"),
)
PREFIX = "keyed_text/"
COMMENT = re.compile(r"\s(?:#|;|//|%).*")
CAMERA = ("make", "model", "sub_camera", "lens", "firmware", "capture_mode")


def sniff(content: Content) -> Sniff | None:
    """The first line that calibrary writes."""
    return Sniff(Sure.MAGIC, "it begins as calibrary's sheets do") if content.first_line == HEADING else None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera of the sheet."""
    return hand_made.cameras(tree_of(data, source=context.name), context, prefix=PREFIX)


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """Pixels from the corner; K comes last, so that a sheet cut short lacks it."""
    [item] = calibrations
    native, quality, lens = CONVENTION.native(item.intrinsics), item.quality or Quality(), item.distortion
    known: list[tuple[str, object]] = [(name, getattr(item.camera, name)) for name in CAMERA]
    known += [(name, getattr(item.provenance, name)) for name in STATED]
    known += [("grade", item.grade.value), ("rms_px", quality.rms_px)]
    known += [("points", quality.points), ("views", quality.views)]
    known += [
        (key.removeprefix(PREFIX), restored(text)) for key, text in item.extras if key.startswith(PREFIX)
    ]
    known += [] if lens is None else [("distortion_model", lens.model), *lens.coefficients.items()]
    known += [("principal_point_origin", "corner"), ("y_axis", "down")]
    known += zip(("image_width_px", "image_height_px"), item.intrinsics.image_size, strict=True)
    known += [("skew_px", native.skew or None)]
    known += [(f"{name}_px", getattr(native, name)) for name in ("fx", "fy", "cx", "cy")]
    rows = [f"{key} = {value}" for key, value in known if value is not None]
    body = "".join(
        f"{row}\n"
        for row in rows
        if row.isprintable() and row == COMMENT.sub("", row).strip() and "=  " not in row
    )
    return f"{HEADING}\n{body}".encode()


FORMAT = Format(
    name="keyed_text",
    title="Key-value calibration sheet",
    suffixes=(".cal", ".txt"),
    syntaxes=(Syntax.TEXT,),
    reference="https://docs.opencv.org/4.x/d9/d0c/group__calib3d.html",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(
        models=(NoDistortion, BrownConrady, Rational, KannalaBrandt),
        skew=True,
        unknown_lens=UnknownLens.STATED,
    ),
    states=STATED,
    options=hand_made.FORMAT.options,
)
