"""Check whether the K that is about to be used is right for the images of a flight.

>>> from calibrary.jobs.check import check
>>> check("survey", "camera.xml").is_right
True
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

from msgspec import Meta

from calibrary.arguments import File, Folder, Place, PolicyLike, Reading, Workers, paths
from calibrary.policy import FLEET
from calibrary.progress import Progress

if TYPE_CHECKING:
    from calibrary.jobs.check.run import CheckReport

__all__ = ["check"]


def check(
    images: Folder | Sequence[Folder],
    files: File | Sequence[File] = (),
    *,
    recursive: bool = False,
    registry: Place | Sequence[Place] | None = None,
    altitude_m: Annotated[float, Meta(gt=0)] = 100.0,
    verify: bool = False,
    policy: PolicyLike = FLEET,
    workers: Workers = 0,
    reading: Reading | None = None,
    progress: Progress | None = None,
) -> CheckReport:
    """Check whether calibration files are right for these images; if not, state the size of the error.

    Args:
        images: folder of images, or an image.
        files: calibration files of any format (default: those beside the images).
        recursive: include sub-folders.
        registry: the fleet's registry, a folder or https:// address; of several, the first that answers is used.
        altitude_m: flying height above ground, for lengths on the ground.
        verify: also compare each K with the pixels of a dozen images: agrees, contradicts or cannot tell (needs
            calibrary[sfm]; up to a minute a camera).
        policy: the limits: an included policy, or a file.
        workers: number of processes that read images; 0 chooses it.
        reading: settings for the files.
        progress: called with (images read, number of images, "images").

    Raises:
        InputError: there is no image, a named file cannot be read, or there is no file to check.
        RegistryError: the registry cannot be read.
    """
    from calibrary.jobs.check.run import check_files
    from calibrary.jobs.extract.run import run
    from calibrary.policy_file import policy_of
    from calibrary.registry.places import registries

    outcome = run(
        *paths(images),
        policy=policy_of(policy),
        registry=registries(registry),
        recursive=recursive,
        workers=workers,
        verify=verify,
        progress=progress,
    )
    return check_files(paths(files), outcome, reading or Reading(), altitude_m, needed=not verify)
