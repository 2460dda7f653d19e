"""Cameras as numpy's arrays: K by itself, and an archive of OpenCV's."""

from __future__ import annotations

import io
import struct
import zipfile
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calibrary.calibration import Calibration
from calibrary.errors import ParseError
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Convention, Origin, Tangential
from calibrary.parsers.format import Capacity, Format, ReadContext, Sniff, Sure, UnknownLens, WriteContext
from calibrary.parsers.formats import hand_made, opencv_storage
from calibrary.parsers.formats._npy import array
from calibrary.parsers.formats._tree import NPY, names_of_arrays, tree_of
from calibrary.parsers.names import MATRIX, simplified
from calibrary.records import Json

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


def sniff_npy(content: Content) -> Sniff | None:
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


def read_npy(data: bytes, context: ReadContext) -> list[Calibration]:
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


def write_npy(calibrations: Sequence[Calibration], _context: WriteContext) -> bytes:
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


NPY_FORMAT = Format(
    name="k_npy",
    title="K as a numpy array",
    words="""\
``K_matrix.npy``: an intrinsic matrix by itself, as numpy saves an array.

A (3, 3) array of floats, fx s cx / 0 fy cy / 0 0 1, px. The file does not state the image size, the source of K or the
pixel origin. A matrix that came out of ``cv2.calibrateCamera``, as most do, counts from the centre of the top-left
pixel, and is read so; ``--pixel-origin corner`` reads another. The matrices that calibrary writes count from that
pixel's outer corner, as the image centre (W/2, H/2) implies, and say so: their header is 64 spaces longer than
``numpy.save`` makes it, which every reader of the format accepts and no other writer does.

Source: NEP 1, "A simple file format for NumPy arrays" (numpy.lib.format).
""",
    suffixes=(".npy",),
    syntaxes=(Syntax.BINARY,),
    reference="https://numpy.org/doc/stable/reference/generated/numpy.lib.format.html",
    convention=CONVENTION,
    sniff=sniff_npy,
    read=read_npy,
    write=write_npy,
    capacity=Capacity(models=(), skew=True, unknown_lens=UnknownLens.STATED),
    needs_image_size=True,
    options=hand_made.FORMAT.options,
)


OPENCV = (
    "the arrays are what OpenCV's functions return, so cx and cy count from the centre of the top-left pixel"
)


def sniff_npz(content: Content) -> Sniff | None:
    """A zip with an array under a name of the camera matrix."""
    names = names_of_arrays(content.data)
    found = next((name for name in names if MATRIX.fullmatch(simplified(name))), None)
    if found is None or any(name.startswith("world_mat_") for name in names):
        return None  # of NeuS, whose camera_mat_0 is no K
    return Sniff(Sure.MAGIC, f"it is a zip archive of numpy arrays with {found} among them")


def read_npz(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera, in the order of their matrices."""
    tree = tree_of(data, source=context.name)
    return hand_made.cameras(
        tree, context, prefix=opencv_storage.PREFIX, origin=Origin.PIXEL_CENTRE, why=OPENCV
    )


def write_npz(calibrations: Sequence[Calibration], context: WriteContext) -> bytes:
    """OpenCV's own names, and the image size beside them."""
    tree = opencv_storage.arranged(calibrations, context)
    size = [tree.pop("image_width"), tree.pop("image_height")]
    arrays: dict[str, Json] = {"image_size": size, **tree}
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, value in arrays.items():
            # A ZipInfo of its own has no date, so that the same camera is the same file.
            if (saved := _saved(value)) is not None:
                archive.writestr(zipfile.ZipInfo(f"{name}.npy"), saved)
    return buffer.getvalue()


def _saved(value: Json) -> bytes | None:
    """The array of a value; None for a table that is no matrix, and for lists of unequal length."""
    flat = value.get("data") if isinstance(value, dict) else None
    try:
        array = np.array(value if flat is None else flat)
        if isinstance(value, dict) and flat is not None:
            # A matrix of several channels has a third side.
            array = array.reshape(int(str(value["rows"])), int(str(value["cols"])), -1)
            array = array[:, :, 0] if array.shape[2] == 1 else array
        buffer = io.BytesIO()
        np.save(buffer, array, allow_pickle=False)
    except (KeyError, ValueError):
        return None
    return buffer.getvalue()


NPZ_FORMAT = Format(
    name="numpy_npz",
    title="OpenCV calibration as numpy arrays (.npz)",
    words="""\
A calibration as ``numpy.savez`` keeps it: a zip of arrays under the names that the script gave them.

In the words of OpenCV's Python tutorial::

    ret, mtx, dist, rvecs, tvecs = cv2.calibrateCamera(…)
    np.savez("calibration.npz", mtx=mtx, dist=dist, rvecs=rvecs, tvecs=tvecs)

No program defines the names, so they are read as all hand-made ones are (``hand_made``), as the result of
``cv2.calibrateCamera``. Poses, other arrays of more than 64 numbers, and arrays of Python objects are not read: nothing
is unpickled. Most files do not state the image size; ``image_size``, if present, is width and height.

Sources: numpy, ``numpy.savez`` and ``numpy.lib.format``; OpenCV, "Camera Calibration" of the Python tutorials.
""",
    suffixes=(".npz",),
    syntaxes=(Syntax.BINARY,),
    reference="https://numpy.org/doc/stable/reference/generated/numpy.savez.html",
    convention=opencv_storage.FORMAT.convention,
    sniff=sniff_npz,
    read=read_npz,
    write=write_npz,
    capacity=opencv_storage.FORMAT.capacity,
    states=opencv_storage.FORMAT.states,
    options=hand_made.FORMAT.options,
)

FORMATS = (
    NPY_FORMAT,
    NPZ_FORMAT,
)
