"""The check job: from images and calibration files to a verdict on each file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated

from msgspec import Struct

from calibrary.calibration import ImageSize
from calibrary.errors import InputError
from calibrary.jobs.exchange.argument import entry_file
from calibrary.jobs.exchange.layers import Place
from calibrary.jobs.extract import run as extract
from calibrary.jobs.extract.beside import ALTITUDE_M, CheckedFile, Rightness, check_candidates
from calibrary.jobs.extract.candidates import Candidates, read_candidates
from calibrary.jobs.extract.extraction import Extraction
from calibrary.jobs.images.folders import SkippedFile
from calibrary.parsers.files import MAX_BYTES
from calibrary.policy import FLEET, Policy
from calibrary.progress import Progress
from calibrary.records import Meta, Record
from calibrary.registry.entry_yaml import parse_entry
from calibrary.sfm.pixel_check import PixelCheck, PixelVerdict

__all__ = ["Check", "CheckReport", "CheckRequest", "check", "report_of"]


class CheckRequest(Struct, frozen=True, kw_only=True):
    """Arguments of a check.

    Attributes:
        images: a folder, or images and folders.
        files: calibration files; empty to check those in the folders of the images.
        policy: policy with the limits.
        registry: folder of a fleet registry, address of a published one, or several in order.
        recursive: whether to read sub-folders.
        workers: processes that read images; 0 for automatic.
        altitude_m: altitude above ground at which errors on the ground are stated.
        verify: whether to check each K also against the pixels of a dozen images per camera.
        format, image_size, options, max_bytes: what the calibration files do not state.
        progress: called with (images read, total, "images").
    """

    images: tuple[Path, ...]
    files: tuple[Path, ...] = ()
    policy: Policy = FLEET
    registry: Place | Sequence[Place] | None = None
    recursive: bool = False
    workers: int = 0
    altitude_m: float = ALTITUDE_M
    verify: bool = False
    format: str | None = None
    image_size: ImageSize | None = None
    options: Mapping[str, str] | None = None
    max_bytes: int = MAX_BYTES
    progress: Progress | None = None


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
    """

    policy: str
    files: tuple[CheckedFile, ...]
    not_read: tuple[SkippedFile, ...]
    exit_code: Annotated[int, Meta(ge=0, le=1)]
    by_pixels: tuple[CameraPixels, ...] = ()


class Check(Struct, frozen=True, kw_only=True):
    """Result of a check.

    Attributes:
        extraction: cameras and K extracted from the images.
        files: all files, once for each camera that they may belong to.
        not_read: files in the folders of the images that cannot be read.
    """

    extraction: Extraction
    files: tuple[CheckedFile, ...]
    not_read: tuple[SkippedFile, ...]

    @property
    def is_right(self) -> bool:
        """Whether every file is right for every camera that it may belong to, and no pixels contradict a K."""
        contradicted = any(one.pixels.verdict is PixelVerdict.CONTRADICTS for one in self.by_pixels)
        return all(one.verdict is Rightness.RIGHT for one in self.files) and not contradicted

    @property
    def by_pixels(self) -> tuple[CameraPixels, ...]:
        """K of each camera checked against the pixels; empty if not requested."""
        cameras = self.extraction.cameras
        return tuple(CameraPixels(camera=c.slug, pixels=c.pixels) for c in cameras if c.pixels is not None)


def check(request: CheckRequest) -> Check:
    """Check calibration files against the images.

    Raises:
        InputError: there is no image, a named file cannot be read, or there is no file to check.
        RegistryError: the registry cannot be read.
    """
    outcome = extract.run(
        extract.Request(
            images=request.images,
            policy=request.policy,
            registry=request.registry,
            recursive=request.recursive,
            workers=request.workers,
            verify=request.verify,
            progress=request.progress,
        )
    )
    not_read: list[tuple[str, str]] = []
    if request.files:
        found = [_read(path, request, outcome) for path in request.files]
    else:
        found, not_read = [*outcome.beside], [*outcome.beside_unread]
        if not found and not request.verify:
            raise InputError(
                "no calibration file is beside the images; name the one that is to be used",
                source=", ".join(map(str, request.images)),
            )
    checked = [
        one
        for candidates in found
        for one in check_candidates(candidates, outcome.cameras, request.policy, request.altitude_m)
    ]
    return Check(
        extraction=outcome,
        files=tuple(checked),
        not_read=tuple(SkippedFile(name=name, reason=reason) for name, reason in not_read),
    )


def _read(path: Path, request: CheckRequest, outcome: Extraction) -> Candidates:
    """Read a calibration file or the file of a registry entry."""
    is_file = path.is_file() and request.format is None
    if is_file and (data := entry_file(path)) is not None:
        entry = parse_entry(data, path.name, require_digest=False)
        return Candidates(label=str(path), calibrations=(entry.calibration,))
    return read_candidates(
        path,
        str(path),
        outcome.cameras,
        form=request.format,
        image_size=request.image_size,
        options=request.options,
        max_bytes=request.max_bytes,
    )


def report_of(found: Check) -> CheckReport:
    """Make the report of a check."""
    return CheckReport(
        policy=found.extraction.policy.name,
        files=found.files,
        not_read=found.not_read,
        exit_code=0 if found.is_right else 1,
        by_pixels=found.by_pixels,
    )
