"""``intrinsics.txt`` of NSVF, SRN, DeepVoxels and pixelNeRF scenes.

In the format's own words::

    1111.111 400 400 0.            f cx cy 0, or fx fy cx cy
    0. 0. 0.                       the scene's centre
    0.                             near plane, absent in some
    1.                             scale
    800 800                        height width

The scenes are rendered or undistorted, so there is no distortion. Where cx and cy count from is not stated; half the
image's side, which most files have, is the middle counted from the corner.

Source: scene-representation-networks, ``util.py``, ``parse_intrinsics``; NSVF, ``fairnr/data/data_utils.py``.
"""

from __future__ import annotations

from calibrary.calibration import Calibration
from calibrary.distortion import NoDistortion
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, Tangential
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats._one_camera import ORIGIN, camera, chosen_origin
from calibrary.parsers.formats._text_rows import rows_of
from calibrary.records import replace

CONVENTION = Convention(
    origin=Origin.CORNER,
    tangential=Tangential.NONE,
    remarks=("height comes before width", "the origin is not stated"),
)
SHAPES = ((4, 3, 1, 1, 2), (4, 3, 1, 2), (4, 3, 1, 1, 2, 1), (4, 3, 1, 2, 1))
"""How many numbers each line has; the last may say which way the poses go."""
MOST = 4096


def sniff(content: Content) -> Sniff | None:
    """Lines of four, three, one and two numbers."""
    if not 4 <= len(content.lines) <= 6:
        return None
    try:
        shape = tuple(len(strict.numbers(line)) for line in content.lines)
    except ParseError:
        return None
    return Sniff(Sure.SHAPE, f"lines of {', '.join(map(str, shape))} numbers") if shape in SHAPES else None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one camera."""
    rows = [strict.numbers(row) for row in rows_of(data, most=MOST) if row.strip()]
    shape = tuple(map(len, rows))
    if shape not in SHAPES:
        listed = ", ".join(map(str, shape))
        raise ParseError(f"lines of {listed or 'no'} numbers, expected 4, 3, 1, (1,) 2")
    first, second, third, fourth = rows[0]
    fx, fy, cx, cy = (first, first, second, third) if fourth == 0 else (first, second, third, fourth)
    height, width = rows[shape.index(2)]
    origin, sentence = chosen_origin(context, Origin.CORNER)
    return [
        camera(
            context,
            replace(CONVENTION, origin=origin),
            Native(fx=fx, fy=fy, cx=cx, cy=cy),
            strict.image_size(width, height),
            NoDistortion(),
            assumptions=(sentence,),
        )
    ]


FORMAT = Format(
    name="nsvf_intrinsics",
    title="NSVF, SRN and DeepVoxels intrinsics.txt",
    suffixes=(".txt",),
    syntaxes=(Syntax.TEXT,),
    reference="https://github.com/facebookresearch/NSVF",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    options=(ORIGIN,),
)
