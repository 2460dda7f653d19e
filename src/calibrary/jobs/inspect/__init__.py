"""Show what calibration files and images are, how they were recognised, and what they contain.

>>> from calibrary.jobs.inspect import inspect
>>> [(one.format, len(one.calibrations)) for one in inspect(["camera.xml", "survey/DJI_0001.JPG"]).files]
[('agisoft_xml', 1), ('image', 1)]
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from calibrary.arguments import File, Reading, paths
from calibrary.progress import Progress

if TYPE_CHECKING:
    from calibrary.jobs.inspect.run import InspectFilesReport
    from calibrary.parsers.unsized import UnsizedCalibration as UnsizedCalibration  # one of the result

__all__ = ["inspect"]


def inspect(
    files: File | Sequence[File],
    *,
    tags: bool = False,
    reading: Reading | None = None,
    progress: Progress | None = None,
) -> InspectFilesReport:
    """Identify files and list their content.

    Args:
        files: files, and folders with all files below them.
        tags: list the EXIF tags of images, as exifread reads them, instead of calibrations; positions, serial numbers,
            people's names, thumbnails, binary values, and tags without a known name are left out.
        reading: settings for the files.
        progress: called with (files done, number of files, "files").

    Returns:
        Each file; one that cannot be read is there with its error.

    Raises:
        InputError: a folder cannot be read.
    """
    from calibrary.jobs.inspect.run import inspect_files

    return inspect_files(paths(files), reading or Reading(), tags=tags, progress=progress)
