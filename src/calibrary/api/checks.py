"""Whether the K that someone is about to use is right for the images of a flight."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TypeAlias

from msgspec import Struct

from calibrary.api.limits import PolicyLike, policy_of
from calibrary.jobs.check import run as job
from calibrary.jobs.exchange.reading import Reading
from calibrary.jobs.extract.beside import CheckedFile
from calibrary.jobs.extract.extraction import CameraReport
from calibrary.policy import FLEET
from calibrary.progress import Progress
from calibrary.records import Json, to_json

__all__ = ["CheckResult", "check"]

PathLike: TypeAlias = str | Path


class CheckResult(Struct, frozen=True):
    """A verdict on each calibration file.

    Attributes:
        found: all of it, as the command line shows it.
    """

    found: job.Check

    @property
    def is_right(self) -> bool:
        """Whether every file is right for every camera that it can be of."""
        return self.found.is_right

    @property
    def files(self) -> tuple[CheckedFile, ...]:
        """Every file for each camera that it can be of: ``verdict``, ``message``, and by how much it is off."""
        return self.found.files

    @property
    def cameras(self) -> tuple[CameraReport, ...]:
        """What the images say of their cameras, as of :func:`calibrary.extract`."""
        return self.found.extraction.cameras

    def to_dict(self) -> dict[str, Json]:
        """The result as plain data for JSON (schemas/check-1.schema.json)."""
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
    """Say of a K that is about to be used whether it is right for these images, and else by how much it is off.

    Args:
        images: a folder, an image, or a list of images and folders.
        files: calibration files of any format; none to check those that lie with the images.
        policy: policy with the limits: a policy, "fleet", "source" or a policy file.
        registry: the fleet's registry: its folder, or the address of a published one; of several the first that
            answers is used.
        recursive: go into sub-folders.
        workers: processes that read images; 0 decides by itself.
        altitude_m: height above ground, for what the difference does to a map.
        verify: hold the K's against the pixels of a dozen images of each camera as well.
        reading: answers to what the files leave open.
        progress: called with (images read, images in all, "images").

    Raises:
        InputError: there is no image, a file that was named cannot be read, or there is none to check.
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
                options=said.options,
                max_bytes=said.max_bytes,
                progress=progress,
            )
        )
    )


def _paths(given: PathLike | Sequence[PathLike]) -> tuple[Path, ...]:
    return tuple(Path(path) for path in ([given] if isinstance(given, str | Path) else given))
