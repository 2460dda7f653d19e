"""``K_matrix.npy``: an intrinsic matrix by itself, as numpy saves an array.

A (3, 3) array of floats, fx s cx / 0 fy cy / 0 0 1, px. The file does not state the image size, the source of K or the
pixel origin. A matrix that came out of ``cv2.calibrateCamera``, as most do, counts from the centre of the top-left
pixel, and is read so; ``--pixel-origin corner`` reads another. The matrices that calibrary writes count from that
pixel's outer corner, as the image centre (W/2, H/2) implies, and say so: their header is 64 spaces longer than
``numpy.save`` makes it, which every reader of the format accepts and no other writer does.

Source: NEP 1, "A simple file format for NumPy arrays" (numpy.lib.format).
"""

from __future__ import annotations

import io
import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calibrary.calibration import Calibration
from calibrary.errors import ParseError
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Origin, Tangential
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, UnknownLens, WriteContext
from calibrary.parsers.formats import hand_made
from calibrary.parsers.formats._npy import array
from calibrary.parsers.formats._tree import NPY, tree_of

CONVENTION = Convention(
    origin=Origin.PIXEL_CENTRE,
    tangential=Tangential.NONE,
    remarks=(
        "K alone: the file contains no distortion and no image size",
        "a file of calibrary's own counts from the outer corner of the top-left pixel",
    ),
)
LENGTH_AT, HEADER_AT = 8, 10
OURS = "cx and cy count from the pixel corner: the file is one of calibrary's own"
MARK_BYTES = 64
"""By which the header is longer than needed, in a file of ours; a header is a multiple of that long."""


def sniff(content: Content) -> Sniff | None:
    """A 3×3 array could be a rotation as well; the numbers of a K look like no other matrix."""
    if not content.data.startswith(NPY):
        return None
    try:
        K = array(content.data)
    except ParseError:
        return None
    if not _looks_like_k(K):
        return None
    return Sniff(Sure.SHAPE, "it is a numpy file with a 3×3 matrix that has the form of a K")


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """The one K; how it came about is not known, so it is given the lowest grade that may reach a solver."""
    K = array(data)
    if K.shape != (3, 3):
        raise ParseError(f"the array has shape {K.shape}, expected (3, 3)")
    if not _looks_like_k(K):
        raise ParseError(
            f"{K.tolist()} is not an intrinsic matrix, expected fx s cx / 0 fy cy / 0 0 1 with fx and fy in px"
        )
    origin, why = (Origin.CORNER, OURS) if is_ours(data) else (None, None)
    tree = tree_of(data, source=context.name)
    return hand_made.cameras(tree, context, prefix="k_npy/", origin=origin, why=why)


def write(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
    """What ``numpy.load`` gives back as the canonical K."""
    [calibration] = calibrations
    return matrix_file(calibration)


def matrix_file(calibration: Calibration) -> bytes:
    """The canonical K as a numpy file that says who wrote it."""
    buffer = io.BytesIO()
    np.save(buffer, calibration.intrinsics.matrix, allow_pickle=False)
    made = buffer.getvalue()
    [length] = struct.unpack_from("<H", made, LENGTH_AT)
    header = made[HEADER_AT : HEADER_AT + length - 1] + b" " * MARK_BYTES + b"\n"
    return made[:LENGTH_AT] + struct.pack("<H", len(header)) + header + made[HEADER_AT + length :]


def is_ours(data: bytes) -> bool:
    """Whether calibrary wrote the file: its header is longer than it need be."""
    end = data.find(b"\n", HEADER_AT)
    spaces = end - len(data[:end].rstrip(b" ")) if end > 0 else 0
    return MARK_BYTES <= spaces < 2 * MARK_BYTES and (end + 1) % MARK_BYTES == 0


def _looks_like_k(K: NDArray[np.float64]) -> bool:
    if K.shape != (3, 3) or not np.isfinite(K).all() or K[2, 2] != 1.0:
        return False
    return bool(not K[[1, 2, 2], [0, 0, 1]].any() and K[0, 0] > 1 and K[1, 1] > 1)


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
    capacity=Capacity(models=(), skew=True, unknown_lens=UnknownLens.STATED),
    needs_image_size=True,
    options=hand_made.FORMAT.options,
)
