"""A 3×4 projection matrix by itself, as self-calibration and multi-view programs save it (``*.Pmat.cal``, ``.P``).

In the format's own words::

    p11 p12 p13 p14
    p21 p22 p23 p24
    p31 p32 p33 p34

with s·(u, v, 1) = P·(X, Y, Z, 1). P = K·[R | t] up to a factor, so K is the upper triangle of the decomposition M = K·R
of its left 3×3 part, made positive on the diagonal. It contains neither the lens distortion nor the image size. The
file does not state whether u and v count from the top-left pixel's centre or corner.

Source: R. Hartley and A. Zisserman, "Multiple View Geometry in Computer Vision", 2nd ed., section 6.2.4.
"""

from __future__ import annotations

import re

from calibrary.arrays import NDArray, np
from calibrary.calibration import Calibration, Grade, Origin
from calibrary.errors import ParseError
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Tangential
from calibrary.parsers.format import Format, Option, ReadContext, Sniff, Sure
from calibrary.parsers.formats._text_rows import text_of
from calibrary.records import replace

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    tangential=Tangential.NONE,
    remarks=("K comes from an RQ decomposition; the file contains no distortion and no image size",),
)
ORIGIN = Option(
    name="origin",
    values=("centre", "corner"),
    meaning="whether u and v count from the centre of the top-left pixel or from its outer corner",
)
LONGEST = 4000
SMALLEST_FOCAL_PX = 2.0
"""A pose by itself, [R | t], decomposes into a K with focal lengths of 1."""
SINGULAR = 1e-12

_NUMBER = re.compile(r"[+-]?[\d.]+(?:[eE][+-]?\d+)?", re.ASCII)


def sniff(content: Content) -> Sniff | None:
    """Three rows of four numbers."""
    if len(content.data) > LONGEST or len(content.lines) != 3:
        return None
    rows = [line.split() for line in content.lines]
    if all(len(row) == 4 and all(_NUMBER.fullmatch(part) for part in row) for row in rows):
        return Sniff(Sure.WEAK, "it is three rows of four numbers, as a projection matrix")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """K of the one camera; its pose is left alone."""
    rows = [row for row in text_of(data, most=LONGEST).splitlines() if row.strip()]
    if len(rows) != 3:
        raise ParseError(f"{len(rows)} rows of numbers, expected 3")
    P = np.array([strict.numbers(row, count=4) for row in rows])
    K = upper_triangle(P[:, :3])
    if not (K[0, 0] >= SMALLEST_FOCAL_PX and K[1, 1] >= SMALLEST_FOCAL_PX):
        raise ParseError(
            f"it decomposes into focal lengths of {K[0, 0]:.3g} and {K[1, 1]:.3g}, which are not in px: this is a "
            "pose or a normalised matrix, expected P = K·[R | t]"
        )
    size = context.size(None)
    corner = context.option(ORIGIN.name) == "corner"
    convention = replace(CONVENTION, origin=Origin.CORNER) if corner else CONVENTION
    native = Native(
        fx=float(K[0, 0]), fy=float(K[1, 1]), cx=float(K[0, 2]), cy=float(K[1, 2]), skew=float(K[0, 1])
    )
    assumed = () if context.option(ORIGIN.name) else ("u and v count from the centre of the top-left pixel",)
    return [
        context.calibration(
            convention.intrinsics(native, size),
            None,
            assumptions=(*assumed, "a bare matrix does not say how it came about; taken as derived"),
            grade=Grade.DERIVED,
            notes=("K was decomposed from a projection matrix; the pose in it was left alone",),
        )
    ]


def upper_triangle(M: NDArray[np.float64]) -> NDArray[np.float64]:
    """K of M = K·R with a positive diagonal and K[2, 2] = 1.

    Rows and columns in reverse turn RQ into numpy's QR. A sign of P as a whole, and a mirrored world, end up
    in R.

    Raises:
        ParseError: M is singular.
    """
    scale = float(np.abs(M).max())
    if not scale > 0 or np.linalg.svd(M / scale, compute_uv=False)[-1] < SINGULAR:
        raise ParseError("its left 3×3 part has no inverse, so it is not a camera at a finite place")
    reversed_rows = np.linalg.qr((M / scale)[::-1].T)[1]
    upper = reversed_rows.T[::-1, ::-1]
    upper = upper * np.sign(np.diag(upper))
    return np.asarray(upper / upper[2, 2], dtype=np.float64)


FORMAT = Format(
    name="projection_matrix",
    title="3×4 projection matrix",
    suffixes=(".cal", ".p", ".txt"),
    syntaxes=(Syntax.TEXT,),
    reference="https://github.com/strawlab/MultiCamSelfCal",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    needs_image_size=True,
    options=(ORIGIN,),
)
