"""One camera out of a K, a lens and an image size: what most formats of robotics and vision come down to."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn

from calibrary.calibration import Calibration, CameraKey, Grade, ImageSize
from calibrary.distortion import Distortion, KannalaBrandt
from calibrary.errors import UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.convention import Convention, Native
from calibrary.parsers.document import Node
from calibrary.parsers.format import ReadContext
from calibrary.parsers.formats import _file_storage as storage
from calibrary.parsers.formats._opencv_lens import COUNTS, lens

__all__ = ["ORIGIN_UNKNOWN", "camera", "fisheye", "native_of", "opencv_lens", "refuse_model", "size_of"]

ORIGIN_UNKNOWN = "the file does not say how its numbers came about; they were taken as derived"


def camera(
    context: ReadContext,
    convention: Convention,
    native: Native,
    size: ImageSize | None,
    distortion: Distortion | None,
    *,
    name: str | None = None,
    tag: str | None = None,
    assumptions: Sequence[str] = (),
) -> Calibration:
    """The calibration; what had to be assumed is a note as well.

    Args:
        context: what the reader was given.
        convention: how K's numbers count.
        native: K's numbers.
        size: (width, height) px as the file states it, None where it does not.
        distortion: the lens, None where the file has no word about it.
        name: the camera's, where the file has several.
        tag: the key inside the file; the name when None.
        assumptions: what the file leaves open.

    Raises:
        MissingTagError: neither the file nor the caller states the image size.
        ParseError: the numbers make no K.
    """
    settled = context.size(size)
    return Calibration(
        camera=CameraKey(image_size=settled, sub_camera=name),
        intrinsics=convention.intrinsics(native, settled),
        distortion=distortion,
        grade=Grade.CALIBRATED,
        provenance=context.provenance(tag=tag or name, assumptions=tuple(assumptions)),
        notes=tuple(assumptions),
    )


def native_of(node: Node, *, transposed: bool = False) -> Native:
    """K's numbers from a 3×3 matrix: rows, one flat list, or OpenCV's own.

    Args:
        node: the matrix.
        transposed: whether the principal point stands in the last row, as in MATLAB's IntrinsicMatrix.

    Raises:
        ParseError: it is not a camera matrix.
    """
    rows = storage.matrix(node, 3, 3)
    rows = tuple(zip(*rows, strict=True)) if transposed else rows
    return Native.of_matrix(rows, place=node.place, source=node.source)


def opencv_lens(node: Node, counts: Sequence[int] = COUNTS) -> Distortion:
    """OpenCV's distortion vector, whose length is its model; all zero means no distortion.

    Raises:
        ParseError: its length is none of ``counts``.
    """
    values = storage.numbers(node)
    strict.check_count(len(values), counts, place=node.place)
    return lens(values)


def fisheye(values: Sequence[float]) -> KannalaBrandt:
    """cv2.fisheye's model, of its four coefficients in order."""
    return KannalaBrandt(**dict(zip(KannalaBrandt.names(), values, strict=True)))


def size_of(node: Node) -> ImageSize:
    """(width, height) px out of a list of the two.

    Raises:
        ParseError: it is none.
    """
    width, height = node.numbers(2)
    return strict.image_size(width, height, place=node.place)


def refuse_model(found: str, expected: Sequence[str], *, place: str | None = None) -> NoReturn:
    """Refuse a camera or distortion model.

    Raises:
        UnsupportedModelError: always.
    """
    raise UnsupportedModelError(
        f"the model is {strict.shown(found)}, which has no counterpart here; expected {', '.join(expected)}",
        place=place,
    )
