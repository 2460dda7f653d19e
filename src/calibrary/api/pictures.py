"""Undistortion of images, and the K of the undistorted images."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from calibrary.extras import CALIBRATE, require
from calibrary.jobs.exchange.reading import Reading, choose
from calibrary.jobs.undistort.run import ALPHAS, AUTO, Size, Undistortion, UndistortRequest
from calibrary.jobs.undistort.run import undistort as run
from calibrary.progress import Progress

__all__ = ["Undistortion", "undistort"]


def undistort(
    images: str | Path | Sequence[str | Path],
    calibration: str | Path,
    out: str | Path = "undistorted",
    *,
    reading: Reading | None = None,
    keep: Literal["auto", "same", "all", "valid"] | float = "auto",
    size: Size = None,
    max_angle_deg: float = 80.0,
    interpolation: str = "cubic",
    kind: str | None = None,
    quality: int = 95,
    mask: bool = False,
    format: str = "opencv_storage",  # noqa: A002  as in calibrary.read
    force: bool = False,
    progress: Progress | None = None,
) -> Undistortion:
    """Remove lens distortion from images, and write the new K with them.

    Args:
        images: an image, a folder with all files below it, or a list of these.
        calibration: calibration file of the camera.
        out: folder for the undistorted images and their calibration.
        reading: settings for the calibration file, and which camera to use.
        keep: "auto" keeps K; if K would keep less than two thirds of the pixels, it widens the view as far as this
            saves more pixels than it leaves empty. "same" keeps K, "all" keeps every pixel, "valid" leaves no pixel
            empty; a number is OpenCV's alpha, from valid (0) to all (1).
        size: (width, height) px; "same-focal" for the size that keeps the focal length in px; None for the size of the
            image.
        max_angle_deg: for wide lenses, largest angle from the axis that is shown, in degrees.
        interpolation: "nearest", "linear", "cubic" or "lanczos".
        kind: "jpg", "png" or "tif"; None for the image's own.
        quality: JPEG quality, 1 … 100.
        mask: also write a mask of the non-empty pixels.
        format: format of the new calibration file.
        force: replace existing files.
        progress: called with (images done, number of images, "images").

    Raises:
        InputError: the calibration cannot be used, there is no image, or a file would be overwritten; nothing was
            written. An image that cannot be read is reported in the result.
        MissingExtraError: OpenCV is not installed.

    >>> from calibrary.api.pictures import undistort
    >>> undistort("survey", "camera.xml").is_good
    True
    """
    require(CALIBRATE, "undistort")
    source = Path(calibration)
    reading = reading or Reading()
    camera = choose(reading.read(source), reading.camera, source=source.name)
    given = [images] if isinstance(images, str | Path) else images
    request = UndistortRequest(
        images=tuple(map(Path, given)),
        calibration=camera,
        source=source,
        out=Path(out),
        alpha=ALPHAS.get(keep) if isinstance(keep, str) else keep,
        widens=keep == AUTO,
        size=size,
        max_angle_deg=max_angle_deg,
        interpolation=interpolation,
        kind=kind,
        quality=quality,
        mask=mask,
        format=format,
        force=force,
    )
    return run(request, progress)
