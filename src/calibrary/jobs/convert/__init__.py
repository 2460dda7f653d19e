"""Convert calibration files to another program's format, and report what was lost.

>>> from calibrary.jobs.convert import convert
>>> [written] = convert("camera.xml", "camera.yaml", to="opencv_storage").files
>>> written.verdict, written.max_px
(<Fidelity.EXACT: 'exact'>, 0.0)
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from msgspec import Meta

from calibrary.arguments import File, FormatName, Reading, paths
from calibrary.errors import UsageError
from calibrary.image_size import ImageSize, Part
from calibrary.progress import Progress

if TYPE_CHECKING:
    from calibrary.calibration import Calibration
    from calibrary.jobs.convert.run import ConvertReport

__all__ = ["convert"]


def convert(
    sources: File | Sequence[File],
    output: File,
    *,
    to: FormatName | None = None,
    into: Literal["all"] | Sequence[Annotated[int, Meta(ge=0)]] | None = None,
    max_error_px: Annotated[float, Meta(ge=0)] | None = None,
    crop: Annotated[Part, Meta(title="X,Y,W,H")] | None = None,
    scale_to: ImageSize | None = None,
    drop_distortion: bool = False,
    allow_prior: bool = False,
    force: bool = False,
    reading: Reading | None = None,
    progress: Progress | None = None,
) -> ConvertReport:
    """Write calibrations in another program's format, and report how exactly it represents them.

    Args:
        sources: calibration files or images; also folders with all files below them, and patterns such as
            ``rigs/*.yaml``.
        output: file to write; a folder for more than one source, with a file for each.
        to: the output's format, or the program that reads it (default: by the output's name).
        into: cameras of a COLMAP database that get the calibration, or all (default: the only possible ones).
        max_error_px: largest difference in px that may remain anywhere in the image (default: 0.05).
        crop: write the K of this part of the image, counted from the top-left corner.
        scale_to: write the K of the image resized to this size; with crop, of the part.
        drop_distortion: write K alone if the format has no place for a distortion, and an unknown distortion as none if
            the format always states one.
        allow_prior: write a K that was not measured, such as another program's default.
        force: write a K that cannot belong to a camera.
        reading: settings for the sources, and which camera to convert (default: all).
        progress: called with (files done, number of files, "files").

    Returns:
        The result for each file. Of one source, an error is raised; of several, it is in the result.

    Raises:
        UsageError: several sources and no format, or ``into`` for another file than a database.
        InputError: the format is unknown, a source cannot be read, its K is implausible, or the output cannot be
            written.
        FrameError: the image has no such part, or the size has another aspect ratio.
        UnsupportedModelError: the format cannot represent the calibration, or would lose its distortion.
    """
    from functools import partial

    from calibrary import parsers
    from calibrary.jobs.convert.run import convert_files, convert_one

    encode = partial(
        parsers.encode, max_error_px=max_error_px, drop_distortion=drop_distortion, allow_prior=allow_prior
    )
    reframed = partial(_reframed, crop=crop, scale_to=scale_to)
    given, place, reading = paths(sources), Path(output), reading or Reading()
    is_pattern = "*" in str(given[0]) and not given[0].exists()
    if len(given) == 1 and not (is_pattern or given[0].is_dir() or place.is_dir()):
        return convert_one(
            given[0],
            place,
            reading,
            to=to,
            into=into,
            encode=encode,
            reframed=reframed,
            force=force,
        )
    if into is not None:
        raise UsageError("--into takes one file; give one IN and the database")
    if to is None:
        raise UsageError("several files are converted into one format; say which with --to FORMAT")
    return convert_files(
        given,
        place,
        reading,
        to=to,
        encode=encode,
        reframed=reframed,
        force=force,
        progress=progress,
    )


def _reframed(camera: Calibration, crop: Part | None, scale_to: ImageSize | None) -> Calibration:
    """The camera of a part of the image, or of the resized image."""
    part = camera.cropped(crop) if crop is not None else camera
    return part.scaled(scale_to) if scale_to is not None else part
