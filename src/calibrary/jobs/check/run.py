"""The check job: from images and calibration files to a verdict on each file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

from calibrary.arguments import Reading
from calibrary.errors import InputError
from calibrary.jobs.extract.calibration_files import (
    CalibrationsOfFile,
    CheckedFile,
    Rightness,
    check_candidates,
    read_candidates,
)
from calibrary.jobs.extract.report import ExtractReport
from calibrary.jobs.images.folders import SkippedFile
from calibrary.records import Meta, Record
from calibrary.registry.entry_yaml import entry_file, parse_entry
from calibrary.sfm.pixel_check import PixelCheck, PixelVerdict


class CameraPixels(Record):
    """Check of the K from the images or the registry against the pixels.

    Attributes:
        camera: name of the camera in file names.
        pixels: result of the check.
    """

    camera: str
    pixels: PixelCheck


class CheckReport(Record, tag_field="schema", tag="calibrary/check-1"):
    """Output of ``calibrary check --json``.

    Attributes:
        policy: name of the policy with the limits.
        files: all calibration files, once for each camera that they may belong to.
        not_read: files in the folders of the images that look like calibrations but cannot be read.
        exit_code: 0 if every file is right for every camera that it may belong to, and no pixels contradict a
            K.
        by_pixels: K of each camera checked against the pixels; empty if not requested.

    >>> calibrary.check("survey", "camera.xml").is_right
    True
    """

    policy: str
    files: tuple[CheckedFile, ...]
    not_read: tuple[SkippedFile, ...]
    exit_code: Annotated[int, Meta(ge=0, le=1)]
    by_pixels: tuple[CameraPixels, ...] = ()

    @property
    def is_right(self) -> bool:
        """Whether every file is right for every camera that it may belong to, and no pixels contradict a K."""
        return self.exit_code == 0


def check_files(
    files: Sequence[Path], images: ExtractReport, reading: Reading, altitude_m: float, *, needed: bool
) -> CheckReport:
    """Compare calibration files with the K of the images.

    Args:
        files: empty for those beside the images.
        images: what was found in the images.
        reading: what the files do not state themselves.
        altitude_m: altitude above ground at which errors on the ground are stated.
        needed: whether there must be a file.

    Raises:
        InputError: a file cannot be read, or there is none.
    """
    not_read: Sequence[tuple[str, str]] = ()
    if files:
        found: Sequence[CalibrationsOfFile] = [_read(path, reading, images) for path in files]
    else:
        found, not_read = images.calibration_files, images.unreadable_files
        if not found and needed:
            raise InputError(
                "no calibration file is beside the images; name the one that is to be used",
                source=", ".join(images.places),
            )
    checked = [
        one
        for candidates in found
        for one in check_candidates(candidates, images.judged, images.limits, altitude_m)
    ]
    by_pixels = [
        CameraPixels(camera=camera.slug, pixels=camera.pixels)
        for camera in images.judged
        if camera.pixels is not None
    ]
    is_right = all(one.verdict is Rightness.RIGHT for one in checked) and not any(
        one.pixels.verdict is PixelVerdict.CONTRADICTS for one in by_pixels
    )
    return CheckReport(
        policy=images.policy,
        files=tuple(checked),
        not_read=tuple(SkippedFile(name=name, reason=reason) for name, reason in not_read),
        exit_code=0 if is_right else 1,
        by_pixels=tuple(by_pixels),
    )


def _read(path: Path, reading: Reading, images: ExtractReport) -> CalibrationsOfFile:
    """Read a calibration file or the file of a registry entry."""
    is_file = path.is_file() and reading.format is None
    if is_file and (data := entry_file(path)) is not None:
        entry = parse_entry(data, path.name, require_digest=False)
        return CalibrationsOfFile(label=str(path), calibrations=(entry.calibration,))
    return read_candidates(path, str(path), images.judged, reading)
