"""Check of calibration files against the images of a flight, before processing."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

from msgspec import Struct

from calibrary.arguments import PolicyLike, Reading
from calibrary.jobs.check import run as job
from calibrary.jobs.extract.beside import CheckedFile
from calibrary.jobs.extract.extraction import CameraReport
from calibrary.policy import FLEET
from calibrary.policy_file import policy_of
from calibrary.progress import Progress
from calibrary.records import Json, to_json

__all__ = ["CheckResult", "check"]

PathLike: TypeAlias = str | Path


class CheckResult(Struct, frozen=True):
    """Verdicts on calibration files.

    Attributes:
        found: complete result, as the command line shows it.
    """

    found: job.Check

    @property
    def is_right(self) -> bool:
        """Whether every file is right for every camera that it may belong to."""
        return self.found.is_right

    @property
    def files(self) -> tuple[CheckedFile, ...]:
        """Every file for each camera that it may belong to: ``verdict``, ``message``, and the size of the error."""
        return self.found.files

    @property
    def cameras(self) -> tuple[CameraReport, ...]:
        """Cameras found in the images, as in :func:`calibrary.extract`."""
        return self.found.extraction.cameras

    def to_dict(self) -> dict[str, Json]:
        """Return the result as plain data for JSON (schemas/check-1.schema.json)."""
        return to_json(job.report_of(self.found))


def check(
    images: PathLike | Sequence[PathLike],
    files: PathLike | Sequence[PathLike] = (),
    *,
    policy: PolicyLike = FLEET,
    registry: PathLike | Sequence[PathLike] | None = None,
    recursive: bool = False,
    workers: int = 0,
    altitude_m: float = 100.0,
    verify: bool = False,
    reading: Reading | None = None,
    progress: Progress | None = None,
) -> CheckResult:
    """Check whether calibration files are right for these images; if not, report the size of the error.

    Args:
        images: a folder, an image, or a list of images and folders.
        files: calibration files of any format; by default those in the folders of the images.
        policy: policy with the limits: a policy, "fleet", "source" or a policy file.
        registry: the fleet's registry: its folder, or the address of a published one; of several, the first that has a
            matching entry is used.
        recursive: include sub-folders.
        workers: number of processes that read images; 0 chooses it automatically.
        altitude_m: height above ground in m, used to state the effect on a map.
        verify: also compare each K with the pixels of a dozen images of the camera.
        reading: settings for the files.
        progress: called with (images read, number of images, "images").

    Raises:
        InputError: there is no image, a named file cannot be read, or there is no file to check.
        RegistryError: the registry cannot be read.

    >>> result = calibrary.check("survey", "camera.xml")
    >>> result.is_right
    True
    """
    said = reading or Reading()
    return CheckResult(
        job.check(
            job.CheckRequest(
                images=_paths(images),
                files=_paths(files),
                policy=policy_of(policy),
                registry=registry,
                recursive=recursive,
                workers=workers,
                altitude_m=altitude_m,
                verify=verify,
                format=said.format,
                image_size=said.image_size,
                options=said.set,
                max_bytes=said.max_bytes,
                progress=progress,
            )
        )
    )


def _paths(given: PathLike | Sequence[PathLike]) -> tuple[Path, ...]:
    return tuple(Path(path) for path in ([given] if isinstance(given, str | Path) else given))
