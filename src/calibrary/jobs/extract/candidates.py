"""The calibration files that are beside the images."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path, PurePath
from typing import Final

from msgspec import Struct

from calibrary import parsers
from calibrary.calibration import Calibration, ImageSize
from calibrary.errors import CalibraryError, InputError, MissingTagError, UnknownFormatError
from calibrary.jobs.extract.cameras import Camera
from calibrary.jobs.extract.extraction import CameraReport
from calibrary.parsers.files import MAX_BYTES
from calibrary.parsers.format import Sure

__all__ = ["Candidates", "find_candidates", "may_be_calibration", "read_candidates", "size_of"]

USUAL: Final = frozenset(
    {".xml", ".yml", ".yaml", ".json", ".cal", ".txt", ".cam", ".opt", ".ini", ".toml", ".npy"}
)
"""Names under which a file that cannot be read is reported; under any other name its content has to claim it."""
LARGEST: Final = 4 << 20
LARGEST_OF_ANY_NAME: Final = 256 << 10
"""A file under another name; flight logs and the like, which are longer, are not opened."""
MOST_OF_A_NAME: Final = 50
"""More files of one unusual suffix are what a camera or a program writes for each image."""
SEED: Final = re.compile(r".*_(seed|unproven)(\..+)?\.npy")
"""What extract itself calls no valid K."""

CENTRED: Final = 0.1
"""How far from the middle of its frame the principal point of a K without an image size may lie."""


class Candidates(Struct, frozen=True, kw_only=True):
    """The calibrations of one file.

    Attributes:
        label: the file's name.
        calibrations: its cameras.
        states_size: whether it states the size of its images, which are the cameras' own else.
    """

    label: str
    calibrations: tuple[Calibration, ...]
    states_size: bool = True


def may_be_calibration(entry: os.DirEntry[str]) -> bool:
    """Whether a file beside the images is worth a look: by its name, or because it is short."""
    if _suffix(entry.name) in USUAL:
        return True
    try:
        return entry.stat().st_size <= LARGEST_OF_ANY_NAME
    except OSError:
        return False


def find_candidates(
    paths: Sequence[Path], root: Path, cameras: Sequence[CameraReport | Camera]
) -> tuple[list[Candidates], list[tuple[str, str]]]:
    """Every calibration file that lies with the images, and those that could not be read, with the reason.

    Args:
        paths: the files beside the images that may be such.
        root: names are relative to it.
        cameras: of the images.
    """
    found: list[Candidates] = []
    unreadable: list[tuple[str, str]] = []
    for path in _calibration_files(paths):
        name = path.relative_to(root).as_posix()
        try:
            found.append(read_candidates(path, name, cameras, max_bytes=LARGEST))
        except UnknownFormatError:
            continue
        except (CalibraryError, OSError) as error:
            unreadable.append((name, str(error)))
    return found, unreadable


def _calibration_files(paths: Sequence[Path]) -> Iterator[Path]:
    """What may be a calibration by its name, and what is one by its content whatever its name."""
    counts = Counter(_suffix(path.name) for path in paths)
    for path in paths:
        suffix = _suffix(path.name)
        if SEED.fullmatch(path.name):
            continue
        if suffix in USUAL or (counts[suffix] <= MOST_OF_A_NAME and _is_claimed(path)):
            yield path


def _suffix(name: str) -> str:
    return PurePath(name).suffix.lower()


def _is_claimed(path: Path) -> bool:
    """Whether a format claims a file by more than its shape."""
    try:
        found = parsers.identify(path)
    except InputError:
        return False
    return found.sniff.sure is not Sure.WEAK and found.format.read is not None


def read_candidates(
    path: Path,
    label: str,
    cameras: Sequence[CameraReport | Camera],
    *,
    form: str | None = None,
    image_size: ImageSize | None = None,
    options: Mapping[str, str] | None = None,
    max_bytes: int = MAX_BYTES,
) -> Candidates:
    """Read a calibration file; one that states no image size is taken to be of the images' sizes.

    Args:
        path: of the file.
        label: what to call it.
        cameras: of the images.
        form: format of a file whose content does not settle it.
        image_size: (width, height) px, for a file that does not say it.
        options: answers to what only the file's owner knows.
        max_bytes: the longest file that is read.

    Raises:
        InputError: the file cannot be read.
    """

    def read(size: ImageSize | None) -> Sequence[Calibration]:
        return parsers.read(path, format=form, image_size=size, options=options, max_bytes=max_bytes)

    try:
        return Candidates(label=label, calibrations=tuple(read(image_size)))
    except MissingTagError:
        sizes = dict.fromkeys(size_of(camera) for camera in cameras)
        found = [one for size in sizes for one in read(size)]
        if not found:
            raise
        centred = [one for one in found if _is_centred(one)]
        return Candidates(label=label, calibrations=tuple(centred or found), states_size=False)


def size_of(camera: CameraReport | Camera) -> ImageSize:
    """Width and height in px of a camera's images."""
    one = camera.camera if isinstance(camera, CameraReport) else camera
    return one.states[0].metadata.size


def _is_centred(calibration: Calibration) -> bool:
    K = calibration.intrinsics
    width, height = K.image_size
    return abs(K.cx / width - 0.5) < CENTRED and abs(K.cy / height - 0.5) < CENTRED
