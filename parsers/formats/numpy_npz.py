"""A calibration as ``numpy.savez`` keeps it: a zip of arrays under the names that the script gave them.

In the words of OpenCV's Python tutorial::

    ret, mtx, dist, rvecs, tvecs = cv2.calibrateCamera(…)
    np.savez("calibration.npz", mtx=mtx, dist=dist, rvecs=rvecs, tvecs=tvecs)

No program defines the names, so they are read as all hand-made ones are (``hand_made``), as the result of
``cv2.calibrateCamera``. Poses, other arrays of more than 64 numbers, and arrays of Python objects are not read: nothing
is unpickled. Most files do not state the image size; ``image_size``, if present, is width and height.

Sources: numpy, ``numpy.savez`` and ``numpy.lib.format``; OpenCV, "Camera Calibration" of the Python tutorials.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Sequence

import numpy as np

from calibrary.calibration import Calibration
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.convention import Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure, WriteContext
from calibrary.parsers.formats import hand_made, opencv_storage
from calibrary.parsers.formats._tree import names_of_arrays, tree_of
from calibrary.parsers.names import MATRIX, simplified
from calibrary.records import Json

OPENCV = (
    "the arrays are what OpenCV's functions return, so cx and cy count from the centre of the top-left pixel"
)


def sniff(content: Content) -> Sniff | None:
    """A zip with an array under a name of the camera matrix."""
    names = names_of_arrays(content.data)
    found = next((name for name in names if MATRIX.fullmatch(simplified(name))), None)
    if found is None or any(name.startswith("world_mat_") for name in names):
        return None  # of NeuS, whose camera_mat_0 is no K
    return Sniff(Sure.MAGIC, f"it is a zip archive of numpy arrays with {found} among them")


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera, in the order of their matrices."""
    tree = tree_of(data, source=context.name)
    return hand_made.cameras(
        tree, context, prefix=opencv_storage.PREFIX, origin=Origin.PIXEL_CENTRE, why=OPENCV
    )


def write(calibrations: Sequence[Calibration], context: WriteContext) -> bytes:
    """OpenCV's own names, and the image size beside them."""
    tree = opencv_storage.arranged(calibrations, context)
    size = [tree.pop("image_width"), tree.pop("image_height")]
    arrays: dict[str, Json] = {"image_size": size, **tree}
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as archive:
        for name, value in arrays.items():
            # A ZipInfo of its own has no date, so that the same camera is the same file.
            archive.writestr(zipfile.ZipInfo(f"{name}.npy"), _saved(value))
    return buffer.getvalue()


def _saved(value: Json) -> bytes:
    node = Node(value, source="")
    if "rows" in node:
        shape = node["rows"].whole(), node["cols"].whole()
        array = np.array(node["data"].numbers()).reshape(shape)
    else:
        array = np.array(value)
    buffer = io.BytesIO()
    np.save(buffer, array, allow_pickle=False)
    return buffer.getvalue()


FORMAT = Format(
    name="numpy_npz",
    title="OpenCV calibration as numpy arrays (.npz)",
    suffixes=(".npz",),
    syntaxes=(Syntax.BINARY,),
    reference="https://numpy.org/doc/stable/reference/generated/numpy.savez.html",
    convention=opencv_storage.FORMAT.convention,
    sniff=sniff,
    read=read,
    write=write,
    capacity=opencv_storage.FORMAT.capacity,
    states=opencv_storage.FORMAT.states,
    options=hand_made.FORMAT.options,
)
