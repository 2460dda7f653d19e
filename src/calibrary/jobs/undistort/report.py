"""JSON document of an undistortion (schemas/undistort-1.schema.json)."""

from __future__ import annotations

from typing import Annotated, TypeAlias

from calibrary.calibration import Calibration, ImageSize
from calibrary.parsers.format import Fidelity
from calibrary.records import Meta, Record

__all__ = ["UndistortReport", "UndistortedCamera", "UndistortedImage"]

Share: TypeAlias = Annotated[float, Meta(ge=0, le=1)]


class UndistortedCamera(Record):
    """Camera of the undistorted images that were made from images of one size.

    Attributes:
        file: name of the calibration file in the output folder.
        format: of that file.
        verdict: how exactly it represents the calibration.
        dropped: what the format cannot represent.
        image_size: of the original images; that of the undistorted images is in the calibration.
        calibration: of the undistorted images.
        kept: fraction of the original pixels that the undistorted images show.
        empty: fraction of the undistorted images without content.
        notes: remarks.
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
        file: file name.
        output: path relative to the output folder; None if the image was not undistorted.
        camera: ``file`` of its camera in ``cameras``.
        warnings: objections to undistorting it.
        error: why it was not undistorted; None if it was.
    """

    file: str
    output: str | None
    camera: str | None
    warnings: tuple[str, ...]
    error: str | None


class UndistortReport(Record, tag_field="schema", tag="calibrary/undistort-1"):
    """Output of ``calibrary undistort --json``: the new cameras, and all images.

    Attributes:
        calibration: name of the calibration file that was used.
        cameras: one for each image size.
        images: in the given order.
    """

    calibration: str
    cameras: tuple[UndistortedCamera, ...]
    images: tuple[UndistortedImage, ...]

    @property
    def is_good(self) -> bool:
        """Whether every image was undistorted."""
        return all(one.error is None for one in self.images)
