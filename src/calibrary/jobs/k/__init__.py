"""Answer with the K of one image, one calibration file or one camera of a registry.

>>> from calibrary.jobs.k import k
>>> found = k("survey/DJI_0001.JPG")
>>> found.is_usable, found.intrinsics.fx
(True, 3659.5)
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.arguments import File, Place, Reading

if TYPE_CHECKING:
    from calibrary.jobs.k.run import OneK

__all__ = ["k"]


def k(
    what: File,
    *,
    registry: Place | Sequence[Place] | None = None,
    npy: File | None = None,
    reading: Reading | None = None,
) -> OneK:
    """Answer with one K, as extract judges an image, the file's reader a file, and the registry a KEY.

    Args:
        what: image, calibration file, or KEY of an entry.
        registry: a folder, or the address of a published registry; calibrary registry --help explains the default.
        npy: also write K to this file, as NumPy reads it; only one that may be used.
        reading: settings for a calibration file, and which camera of it.

    Raises:
        InputError: the file cannot be read, or has several cameras; or the KEY is of no known make and model.
        RegistryError: no entry answers, or several do.
    """
    from calibrary.atomic import write_files
    from calibrary.jobs.k.run import of_file, of_image, of_key
    from calibrary.parsers import is_image_file
    from calibrary.parsers.formats.numpy_arrays import matrix_file

    path = Path(what)
    if not path.exists():
        found = of_key(str(what), registry)
    elif is_image_file(path):
        found = of_image(path, registry)
    else:
        found = of_file(path, reading or Reading())
    if npy is not None and found.is_usable and found.calibration is not None:
        write_files({Path(npy): matrix_file(found.calibration)})
    return found
