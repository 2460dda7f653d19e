"""Remove lens distortion from images, and write the K that applies to them.

>>> from calibrary.jobs.undistort import undistort
>>> undistort("survey", "camera.xml", keep="all").is_good
True
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from msgspec import Meta

from calibrary.arguments import File, Folder, FormatName, Reading, paths
from calibrary.image_size import ImageSize
from calibrary.progress import Progress

if TYPE_CHECKING:
    from calibrary.jobs.undistort.run import UndistortReport

__all__ = ["undistort"]


def undistort(
    images: Folder | Sequence[Folder],
    calibration: File,
    out: Folder = "undistorted",
    *,
    reading: Reading | None = None,
    keep: Literal["auto", "same", "all", "valid"] | Annotated[float, Meta(ge=0, le=1)] = "auto",
    size: Literal["same-focal"] | ImageSize | None = None,
    max_angle_deg: Annotated[float, Meta(gt=0, lt=90)] = 80.0,
    interpolation: Literal["nearest", "linear", "cubic", "lanczos"] = "cubic",
    kind: Literal["jpg", "png", "tif"] | None = None,
    quality: Annotated[int, Meta(ge=1, le=100)] = 95,
    mask: bool = False,
    to: FormatName = "opencv",
    force: bool = False,
    progress: Progress | None = None,
) -> UndistortReport:
    """Remove lens distortion from images, and write the new K beside them.

    Args:
        images: images, or folders with all files below them.
        calibration: the camera's calibration file.
        out: folder for the undistorted images and their calibration.
        reading: settings for the calibration file, and which camera to use.
        keep: what the new images show. auto keeps K; if K would keep less than two thirds of the pixels, it widens the
            view as far as this saves more pixels than it leaves empty. same keeps K, all keeps every pixel, valid
            leaves no pixel empty; a number is OpenCV's alpha, from valid (0) to all (1).
        size: size in px; same-focal for the size that keeps the focal length in px (default: that of the image).
        max_angle_deg: for wide lenses, largest angle off the axis that is shown; a plane ends before 90.
        interpolation: between pixels; nearest for masks and labels.
        kind: file type (default: that of the image).
        quality: quality of JPEGs.
        mask: also write a mask of the pixels that are not empty.
        to: format of the new calibration file, or the program that reads it.
        force: replace existing files.
        progress: called with (images done, number of images, "images").

    Raises:
        InputError: the calibration was not measured or has an unknown distortion, no K meets the request, there is no
            image, or a file would be overwritten; nothing was written. An image that cannot be read is reported in the
            result.
        MissingExtraError: OpenCV is not installed.
    """
    from calibrary.extras import CALIBRATE, require
    from calibrary.jobs.files import chosen
    from calibrary.jobs.undistort.run import NewCameras, undistort_all

    require(CALIBRATE, "undistort")
    cameras = NewCameras(
        calibration=chosen(Path(calibration), reading or Reading()),
        source=Path(calibration),
        out=Path(out),
        to=to,
        keep=keep,
        size=size,
        max_angle_deg=max_angle_deg,
        interpolation=interpolation,
        mask=mask,
        force=force,
    )
    return undistort_all(paths(images), cameras, kind=kind, quality=quality, progress=progress)
