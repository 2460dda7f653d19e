"""Images with their lens's distortion removed, and the K that then holds."""

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
    """Remove lens distortion from images; the new K is written beside them.

    Args:
        images: an image, a folder with all below it, or a list of these.
        calibration: file of the camera that took them.
        out: folder for the pictures and their camera.
        reading: answers to what the calibration's file leaves open, and which camera of several.
        keep: "auto" keeps K, or widens the view where K would keep less than two thirds of the images' pixels, as
            far as it saves more than it leaves empty; "same" keeps K, "all" every pixel, "valid" leaves no pixel
            empty; or OpenCV's alpha, from valid (0) to all (1).
        size: (width, height) px; "same-focal" for as many as keep the focal length in px; None for the image's.
        max_angle_deg: of wide lenses, show so much off the axis.
        interpolation: "nearest", "linear", "cubic" or "lanczos".
        kind: "jpg", "png" or "tif"; None for the image's own.
        quality: of JPEGs, 1 … 100.
        mask: also write a mask of what is not empty.
        format: of the new camera's file.
        force: replace what is there already.
        progress: called with (images done, images in all, "images").

    Raises:
        InputError: the calibration cannot be used, there is no image, or a file would be overwritten; nothing was
            written. An image that cannot be read is one of the result.
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
