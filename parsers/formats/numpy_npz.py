"""A calibration as ``numpy.savez`` keeps it: a zip of arrays under the names that the script gave them.

In the words of OpenCV's Python tutorial::

    ret, mtx, dist, rvecs, tvecs = cv2.calibrateCamera(…)
    np.savez("calibration.npz", mtx=mtx, dist=dist, rvecs=rvecs, tvecs=tvecs)

No program defines the names, so calibrary knows all those of OpenCV's files (``parsers.names``): camera_matrix and
dist_coeffs, K and D, mtx and dist, each with left, right or a number for one of several. calibrary reads them as the
result of ``cv2.calibrateCamera``. It does not read poses, other arrays of more than 64 numbers, or arrays of Python
objects: nothing is unpickled. Most files do not state the image size; ``image_size``, if present, is width and height.

Sources: numpy, ``numpy.savez`` and ``numpy.lib.format``; OpenCV, "Camera Calibration" of the Python tutorials.
"""

from __future__ import annotations

import io
import re
import zipfile
import zlib
from collections.abc import Sequence

import numpy as np

from calibrary.calibration import Calibration
from calibrary.errors import ParseError
from calibrary.parsers.content import HEAD_BYTES, Content, Syntax
from calibrary.parsers.convention import Origin
from calibrary.parsers.document import Node, accounted
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure, WriteContext
from calibrary.parsers.formats import _npy, opencv_storage
from calibrary.parsers.formats._file_storage import LONGEST_VECTOR
from calibrary.parsers.formats.pinhole_json import ORIGIN, chosen_origin
from calibrary.parsers.names import MATRIX, VECTOR, simplified
from calibrary.parsers.text import shown
from calibrary.records import Json, replace

OPENCV = (
    "the arrays are what OpenCV's functions return, so cx and cy count from the centre of the top-left pixel"
)
LOCAL_HEADER = b"PK\x03\x04"
CENTRAL_HEADER = b"PK\x01\x02"
MAX_MEMBERS = 1000
LONGEST_MEMBER = LONGEST_VECTOR * 8 + 8192
"""A vector and its header; a longer array is none of a camera's."""
METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_NAME = re.compile(rb"PK[\x03\x01][\x04\x02][\x00-\xff]{24,42}?([A-Za-z][\w.-]{0,60})\.npy")


def sniff(content: Content) -> Sniff | None:
    """A zip with an array under a name of the camera matrix."""
    names = names_of(content)
    found = next((name for name in names if MATRIX.fullmatch(simplified(name))), None)
    if any(name.startswith("world_mat_") for name in names):
        return None  # of NeuS, whose camera_mat_0 is no K
    return (
        Sniff(Sure.MAGIC, f"it is a zip archive of numpy arrays with {found} among them") if found else None
    )


def names_of(content: Content) -> list[str]:
    """Names of the arrays at both ends of a zip; empty for another file."""
    data = content.data
    if not data.startswith(LOCAL_HEADER):
        return []
    return [match.decode() for match in _NAME.findall(data[:HEAD_BYTES] + data[-HEAD_BYTES:])]


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera, in the order of their matrices."""
    convention, sentence = opencv_storage.FORMAT.convention, OPENCV
    origin, said = chosen_origin(context, Origin.PIXEL_CENTRE)
    if context.option(ORIGIN.name) is not None:
        sentence = said
    found = []
    for item in opencv_storage.cameras(Node(arrays(data), source=context.name), context):
        K = item.intrinsics
        if convention is not None and origin is not convention.origin:
            K = replace(convention, origin=origin).intrinsics(convention.native(K), K.image_size)
        made = replace(item.provenance, assumptions=(sentence,))
        found.append(replace(item, intrinsics=K, provenance=made))
    return found


def write(calibrations: Sequence[Calibration], context: WriteContext) -> bytes:
    """OpenCV's own names, and the image size beside them."""
    tree = opencv_storage.tree_of(calibrations, context)
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


@accounted
def arrays(data: bytes) -> dict[str, Json]:
    """Every short array of numbers, as lists, by its name; texts of ours beside them."""
    if not data.startswith(LOCAL_HEADER):
        raise ParseError("it does not begin as a zip archive")
    members = data.count(CENTRAL_HEADER)
    if members > MAX_MEMBERS:
        raise ParseError(f"the archive lists {members} arrays; at most {MAX_MEMBERS} are read")
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            return _lists(archive)
    except ParseError:
        raise
    except (
        zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, OSError, OverflowError, RuntimeError, ValueError
    ) as error:  # fmt: skip
        raise ParseError(f"the zip archive is damaged: {shown(str(error), 80)}") from None


def _lists(archive: zipfile.ZipFile) -> dict[str, Json]:
    found: dict[str, Json] = {}
    too_long: list[str] = []
    for item in archive.infolist():
        name, dot, suffix = item.filename.rpartition(".")
        if not dot or suffix != "npy":
            continue
        if item.file_size > LONGEST_MEMBER:
            too_long.append(name)
            continue
        if name in found:
            raise ParseError("it is a duplicate key", place=shown(name))
        if item.flag_bits & 1 or item.compress_type not in METHODS:
            raise ParseError("the array is encrypted, or packed in an unusual way", place=name)
        with archive.open(item) as file:
            value = _value(file.read(LONGEST_MEMBER + 1), name)
        if value is not None:
            found[name] = value
    matrices = [[name for name in names if MATRIX.fullmatch(simplified(name))] for names in (found, too_long)]
    if matrices[1] and not matrices[0]:
        raise ParseError(
            "the array is longer than any camera's, so it is no camera matrix", place=matrices[1][0]
        )
    return found


def _value(data: bytes, name: str) -> Json:
    """An array as lists or a number, None where it is text, objects or too long for a camera's."""
    text = _npy.text(data)
    if text is not None:
        return text
    if not _npy.is_numeric(data):
        if _npy.is_of_objects(data) and any(kind.fullmatch(simplified(name)) for kind in (MATRIX, VECTOR)):
            raise ParseError(
                "it is an array of Python objects, which is not opened because that runs whatever program is in it; "
                "where you trust the file, save the array again as numbers: numpy.array(…, dtype=float)",
                place=name,
            )
        return None
    array = _npy.array(data, place=name)
    if array.size > LONGEST_VECTOR:
        return None
    value: Json = array.tolist()
    return value


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
    options=(*opencv_storage.FORMAT.options, ORIGIN),
)
