"""A calibration from K, a lens and an image size, as in most formats of robotics and vision."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn

from calibrary.calibration import Calibration, ImageSize
from calibrary.distortion import Distortion
from calibrary.errors import UnsupportedModelError
from calibrary.parsers import text as strict
from calibrary.parsers.convention import Convention, Native, Origin
from calibrary.parsers.document import Node
from calibrary.parsers.format import Option, ReadContext
from calibrary.parsers.formats import _file_storage as storage

ORIGIN_UNKNOWN = "the file does not say how its numbers came about; they were taken as derived"

ORIGIN = Option(
    name="origin",
    values=("corner", "centre"),
    meaning="whether cx and cy count from the top-left pixel's outer corner or, as OpenCV's, from its centre",
)


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
    """Make the calibration; assumptions are also added as notes.

    Args:
        context: context of the reader.
        convention: of the numbers of K.
        native: the numbers of K.
        size: (width, height) px stated by the file, or None.
        distortion: the lens, None if the file does not state it.
        name: of the camera, if the file has several.
        tag: key in the file; None for the name.
        assumptions: assumptions that were made.

    Raises:
        MissingTagError: neither the file nor the caller states the image size.
        ParseError: the numbers are not a valid K.
    """
    settled = context.size(size)
    return context.calibration(
        convention.intrinsics(native, settled),
        distortion,
        name=name,
        tag=tag or name,
        assumptions=tuple(assumptions),
        notes=tuple(assumptions),
    )


def chosen_origin(context: ReadContext, usual: Origin) -> tuple[Origin, str]:
    """Where the principal point counts from, as the caller says or as is usual, and that in words."""
    asked = context.option(ORIGIN.name)
    if asked is None:
        taken = f"{usual.value} was taken, unless --pixel-origin says otherwise"
        return usual, f"the file does not say where cx and cy count from; {taken}"
    origin = Origin.CORNER if asked == "corner" else Origin.PIXEL_CENTRE
    return origin, f"cx and cy count from {origin.value}, as the caller says"


def native_of(node: Node, *, transposed: bool = False) -> Native:
    """Read the numbers of K from a 3×3 matrix: rows, one flat list, or OpenCV's own.

    Args:
        node: the matrix.
        transposed: whether the principal point is in the last row, as in MATLAB's IntrinsicMatrix.

    Raises:
        ParseError: it is not a camera matrix.
    """
    rows = storage.matrix(node, 3, 3)
    rows = tuple(zip(*rows, strict=True)) if transposed else rows
    return Native.of_matrix(rows, place=node.place, source=node.source)


def size_of(node: Node) -> ImageSize:
    """(width, height) in px from a list of the two.

    Raises:
        ParseError: it is not an image size.
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
