"""Writing of calibrations into copies of images, as tags that cameras use."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from calibrary.arguments import Reading
from calibrary.calibration import Calibration
from calibrary.errors import InputError, UnknownCameraError
from calibrary.jobs.exchange.argument import Argument, read_argument
from calibrary.jobs.exchange.resolve import LayeredView
from calibrary.jobs.stamp.report import StampReport
from calibrary.jobs.stamp.run import StampRequest
from calibrary.jobs.stamp.run import stamp as run
from calibrary.jobs.stamp.tags import TagSet
from calibrary.parsers.fit import DEFAULT_MAX_ERROR_PX
from calibrary.progress import Progress

__all__ = ["StampReport", "stamp"]


def stamp(
    images: str | Path | Sequence[str | Path],
    calibration: str | Path | Calibration | None = None,
    out: str | Path = "stamped",
    *,
    registry: LayeredView | None = None,
    entry_of: Path | None = None,
    reading: Reading | None = None,
    tags: Sequence[str] = ("camera", "dji"),
    max_error_px: float = DEFAULT_MAX_ERROR_PX,
    force: bool = False,
    dry_run: bool = False,
    progress: Progress | None = None,
) -> StampReport:
    """Write a calibration into copies of JPEGs and TIFFs as XMP tags; no pixel and no other tag changes.

    Args:
        images: an image, a folder with all files below it, or a list of these.
        calibration: calibration of the camera: an object, a file, or the KEY of an entry.
        out: folder for the copies.
        registry: instead of ``calibration``: the entry that applies to the camera and the day of each image.
        entry_of: the registry of that entry; by default the one that is found.
        reading: settings for the calibration file, and which camera to use.
        tags: "camera" for Pix4D's ``Camera:``, "dji" for ``drone-dji:DewarpData``; tags that cannot represent the
            calibration are omitted, but at least one must.
        max_error_px: largest allowed error of a projection by the tags in px, anywhere in the image.
        force: replace existing files.
        dry_run: do everything except writing.
        progress: called with (images done, number of images, "images").

    Raises:
        InputError: the calibration cannot be read, there is no image, or a file would be overwritten; nothing was
            written. Errors of single images are in the result.

    >>> from calibrary.api.stamps import stamp
    >>> report = stamp("survey/DJI_0001.JPG", "camera.xml", dry_run=True)
    >>> [(one.outcome, one.max_error_px) for one in report.images]
    [('stamped', 0.0)]
    """
    if (calibration is None) == (registry is None):
        raise InputError("expected a calibration or a registry, one of them")
    given = [images] if isinstance(images, str | Path) else images
    return run(
        StampRequest(
            images=tuple(map(Path, given)),
            camera=_camera(calibration, registry, entry_of, reading or Reading()),
            out=Path(out),
            tag_sets=tuple(map(TagSet, tags)),
            max_error_px=max_error_px,
            force=force,
            dry_run=dry_run,
        ),
        progress,
    )


def _camera(
    calibration: str | Path | Calibration | None,
    registry: LayeredView | None,
    entry_of: Path | None,
    reading: Reading,
) -> Callable[[Path], Argument]:
    """Return a function that selects the calibration for an image."""
    if registry is None:
        if isinstance(calibration, Calibration):
            used = Argument(label=str(calibration.camera), calibration=calibration)
        else:
            used = read_argument(str(calibration), reading, entry_of)
        return lambda _: used

    def resolved(image: Path) -> Argument:
        answer = registry.resolve(image)
        if answer.calibration is None:
            reasons = "; ".join(f"{one.path}: {one.reason}" for one in answer.near[:1])
            raise UnknownCameraError(f"no entry for {answer.camera}" + (f" ({reasons})" if reasons else ""))
        if answer.entry is None:
            raise UnknownCameraError(f"no entry for {answer.camera} but the catalogue's")
        return Argument(label=answer.entry.id, calibration=answer.calibration)

    return resolved
