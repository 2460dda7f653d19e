"""Write a calibration into copies of images, as the XMP tags that photogrammetry programs read.

>>> from calibrary.jobs.stamp import stamp
>>> report = stamp("survey/DJI_0001.JPG", "camera.xml", dry_run=True)
>>> [(one.outcome, one.max_error_px) for one in report.images]
[('stamped', 0.0)]
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

from msgspec import Meta

from calibrary.arguments import CalibrationLike, Folder, Place, Reading, paths
from calibrary.errors import UsageError
from calibrary.progress import Progress

if TYPE_CHECKING:
    from calibrary.jobs.stamp.run import StampReport

__all__ = ["TagSet", "stamp"]

TagSet: TypeAlias = Literal["camera", "dji"]
"""Tags that together state a calibration."""


def stamp(
    images: Folder | Sequence[Folder],
    calibration: CalibrationLike | None = None,
    out: Folder = "stamped",
    *,
    from_registry: bool = False,
    registry: Place | Sequence[Place] | None = None,
    reading: Reading | None = None,
    tags: Sequence[TagSet] = ("camera", "dji"),
    max_error_px: Annotated[float, Meta(ge=0)] = 0.05,
    force: bool = False,
    dry_run: bool = False,
    progress: Progress | None = None,
) -> StampReport:
    """Write K and distortion into copies of JPEGs and TIFFs; no pixel and no other tag changes.

    Args:
        images: images, or folders with all files below them.
        calibration: the camera's calibration file, or an entry of the registry.
        out: folder for the copies.
        from_registry: use the registry's entry for the camera and the day of each image.
        registry: the fleet's registry, a folder or https:// address; of several, the first that answers is used.
        reading: settings for the calibration file, and which camera to use.
        tags: a set of tags to write: camera is Pix4D's ``Camera:``, in mm, dji is ``drone-dji:DewarpData``, in px
            (default: all that hold the calibration).
        max_error_px: largest error of a projection that the tags may cause, anywhere in the image.
        force: replace existing files.
        dry_run: do everything except writing.
        progress: called with (images done, number of images, "images").

    Raises:
        UsageError: neither or both of ``calibration`` and ``from_registry`` are given.
        InputError: the calibration cannot be read, there is no image, or a file would be overwritten; nothing was
            written. An error of a single image is in the result.
        RegistryError: the registry, or its entry, cannot be read.
    """
    from calibrary.jobs.stamp.run import by_registry, one_camera, stamp_all

    if (calibration is None) is not from_registry:
        raise UsageError("expected --calibration FILE|KEY or --from-registry, one of them")
    return stamp_all(
        paths(images),
        one_camera(calibration, reading or Reading(), registry) if calibration else by_registry(registry),
        Path(out),
        tags=tuple(tags),
        max_error_px=max_error_px,
        force=force,
        dry_run=dry_run,
        progress=progress,
    )
