"""``K_matrix.npy``: an intrinsic matrix by itself, as numpy saves an array.

A (3, 3) array of floats, fx s cx / 0 fy cy / 0 0 1, px. The file does not state the image size, the source of K or the
pixel origin. The matrices that calibrary writes count from the outer corner of the top-left pixel, as the image centre
(W/2, H/2) implies; one that came out of ``cv2.calibrateCamera`` counts from the pixel's centre and is read with
``origin=centre``.

Source: NEP 1, "A simple file format for NumPy arrays" (numpy.lib.format).
"""

from __future__ import annotations

import io
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calibrary.calibration import Calibration, CameraKey, Grade
from calibrary.errors import ParseError
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Native, Origin, Tangential
from calibrary.parsers.format import Capacity, Format, Option, ReadContext, Sniff, Sure, WriteContext
from calibrary.parsers.formats._npy import MAGIC, array
from calibrary.records import replace

__all__ = ["FORMAT"]

CONVENTION = Convention(
    origin=Origin.CORNER,
    tangential=Tangential.NONE,
    remarks=("K alone: the file contains no distortion and no image size",),
)
ORIGIN = Option(
    name="origin",
    values=("corner", "centre"),
    meaning="whether cx and cy count from the top-left pixel's outer corner or, as OpenCV's, from its centre",
)


def sniff(content: Content) -> Sniff | None:
    """A 3×3 array could be a rotation as well; the numbers of a K look like no other matrix."""
    if not content.data.startswith(MAGIC):
        return None
    try:
        K = _array(content.data)
    except ParseError:
        return None
    if not _looks_like_k(K):
        return None
    return Sniff(Sure.SHAPE, "it is a numpy file with a 3×3 matrix that has the form of a K")


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one K; how it came about is not known, so it is given the lowest grade that may reach a solver."""
    K = _array(data)
    if not np.isfinite(K).all():
        raise ParseError("the matrix contains NaN or infinity, expected nine finite numbers")
    if not _looks_like_k(K):
        raise ParseError(
            f"{K.tolist()} is not an intrinsic matrix, expected fx s cx / 0 fy cy / 0 0 1 with fx and fy in px"
        )
    size = context.size(None)
    origin, sentence = Origin.CORNER, "cx and cy count from the pixel corner"
    if context.option(ORIGIN.name) == "centre":
        origin, sentence = Origin.PIXEL_CENTRE, "cx and cy count from the pixel centre, as the caller says"
    native = Native(
        fx=float(K[0, 0]), fy=float(K[1, 1]), cx=float(K[0, 2]), cy=float(K[1, 2]), skew=float(K[0, 1])
    )
    return [
        Calibration(
            camera=CameraKey(image_size=size),
            intrinsics=replace(CONVENTION, origin=origin).intrinsics(native, size),
            grade=Grade.DERIVED,
            provenance=context.provenance(
                assumptions=(sentence, "a bare matrix does not say how it came about; taken as derived")
            ),
        )
    ]


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """What ``numpy.load`` gives back as the canonical K."""
    [calibration] = calibrations
    buffer = io.BytesIO()
    np.save(buffer, calibration.intrinsics.matrix, allow_pickle=False)
    return buffer.getvalue()


def _array(data: bytes) -> NDArray[np.float64]:
    """The (3, 3) array.

    Raises:
        ParseError: it is not such an array.
    """
    found = array(data)
    if found.shape != (3, 3):
        raise ParseError(f"the array has shape {found.shape}, expected (3, 3)")
    return found


def _looks_like_k(K: NDArray[np.float64]) -> bool:
    below = K[[1, 2, 2], [0, 0, 1]]
    return bool(np.isfinite(K).all() and not below.any() and K[2, 2] == 1.0 and K[0, 0] > 1 and K[1, 1] > 1)


FORMAT = Format(
    name="k_npy",
    title="K as a numpy array",
    suffixes=(".npy",),
    syntaxes=(Syntax.BINARY,),
    reference="https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    write=write,
    capacity=Capacity(models=(), skew=True),
    needs_image_size=True,
    options=(ORIGIN,),
)
