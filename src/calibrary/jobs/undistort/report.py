"""What undistorting images reports, as one JSON document (schemas/undistort-1.schema.json)."""

from __future__ import annotations

from typing import Annotated, TypeAlias

from calibrary.calibration import Calibration, ImageSize
from calibrary.parsers.format import Fidelity
from calibrary.records import Meta, Record

__all__ = ["UndistortReport", "UndistortedCamera", "UndistortedImage"]

Share: TypeAlias = Annotated[float, Meta(ge=0, le=1)]


class UndistortedCamera(Record):
    """The camera of the new pictures that came from images of one size.

    Attributes:
        file: name of the calibration file beside the pictures.
        format: of that file.
        verdict: how exactly it holds the calibration.
        dropped: what the format has no place for.
        image_size: of the images before; the new pictures' is in the calibration.
        calibration: of the new pictures.
        kept: part of the images' pixels that the new pictures show.
        empty: part of the new pictures that shows nothing.
        notes: what to know of it.
    """

    file: str
    format: str
    verdict: Fidelity
    dropped: tuple[str, ...]
    image_size: ImageSize
    calibration: Calibration
    kept: Share
    empty: Share
    notes: tuple[str, ...]


class UndistortedImage(Record):
    """One image.

    Attributes:
        file: its name.
        output: path below the output folder; None where the image was not undistorted.
        camera: the file, among cameras, that the picture is of.
        warnings: what speaks against undistorting it.
        error: why it was not undistorted; None where it was.
    """

    file: str
    output: str | None
    camera: str | None
    warnings: tuple[str, ...]
    error: str | None


class UndistortReport(Record, tag_field="schema", tag="calibrary/undistort-1"):
    """What ``calibrary undistort --json`` prints: the new cameras, and every image.

    Attributes:
        calibration: name of the file whose distortion was taken out.
        cameras: one for every size of image.
        images: in the order they were given.
    """

    calibration: str
    cameras: tuple[UndistortedCamera, ...]
    images: tuple[UndistortedImage, ...]
