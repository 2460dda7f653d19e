"""The calibration files in the folders of the images."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path, PurePath
from typing import Final

from msgspec import Struct

from calibrary import parsers
from calibrary.arguments import Reading
from calibrary.calibration import Calibration, ImageSize
from calibrary.errors import CalibraryError, InputError, MissingTagError, UnknownFormatError
from calibrary.jobs.exchange.reading import choose, read_file
from calibrary.jobs.extract.cameras import Camera
from calibrary.jobs.extract.extraction import CameraReport
from calibrary.parsers.format import Sure
from calibrary.records import replace

__all__ = ["Candidates", "find_candidates", "may_be_calibration", "read_candidates", "size_of"]

USUAL: Final = frozenset(
    {".xml", ".yml", ".yaml", ".json", ".cal", ".txt", ".cam", ".opt", ".ini", ".toml", ".npy"}
)
"""Suffixes of calibration files: an unreadable one is reported. Any other file is one only if its content shows it."""
LARGEST_MIB: Final = 4
LARGEST_OF_ANY_NAME: Final = 256 << 10
"""Files with another suffix that are larger than this many bytes are not opened, such as flight logs."""
MOST_OF_A_NAME: Final = 50
"""More files than this with one unusual suffix are files that a camera or program writes for each image."""
SEED: Final = re.compile(r".*_(seed|unproven)(\..+)?\.npy")
"""Names of files that extract itself writes for a K that is not valid."""

CENTRED: Final = 0.1
"""Largest distance of the principal point from the image centre, as a fraction, for a K without an image size."""


class Candidates(Struct, frozen=True, kw_only=True):
    """The calibrations of one file.

    Attributes:
        label: file name.
        calibrations: its cameras.
        states_size: whether the file states image sizes; otherwise those of the images' cameras are used.
    """

    label: str
    calibrations: tuple[Calibration, ...]
    states_size: bool = True


def may_be_calibration(entry: os.DirEntry[str]) -> bool:
    """Whether a file may be a calibration, by its suffix or because it is small."""
    if _suffix(entry.name) in USUAL:
        return True
    try:
        return entry.stat().st_size <= LARGEST_OF_ANY_NAME
    except OSError:
        return False


def find_candidates(
    paths: Sequence[Path], root: Path, cameras: Sequence[CameraReport | Camera]
) -> tuple[list[Candidates], list[tuple[str, str]]]:
    """Read all calibration files in the folders of the images; also returns the unreadable ones, with the reason.

    Args:
        paths: candidate files in the folders of the images.
        root: folder that names are relative to.
        cameras: of the images.
    """
    found: list[Candidates] = []
    unreadable: list[tuple[str, str]] = []
    for path in _calibration_files(paths):
        name = path.relative_to(root).as_posix()
        try:
            found.append(read_candidates(path, name, cameras, Reading(max_size_mib=LARGEST_MIB)))
        except UnknownFormatError:
            continue
        except (CalibraryError, OSError) as error:
            unreadable.append((name, str(error)))
    return found, unreadable


def _calibration_files(paths: Sequence[Path]) -> Iterator[Path]:
    """The files that may be calibrations by suffix, and those that are by content."""
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
    """Whether a format recognises a file by more than its layout."""
    try:
        found = parsers.identify(path)
    except InputError:
        return False
    return found.sniff.sure is not Sure.WEAK and found.format.read is not None


def read_candidates(
    path: Path, label: str, cameras: Sequence[CameraReport | Camera], reading: Reading
) -> Candidates:
    """Read a calibration file; if it states no image size, those of the images are used.

    Args:
        path: of the file.
        label: name of the file in messages.
        cameras: of the images.
        reading: what the file does not state itself.

    Raises:
        InputError: the file cannot be read.
    """

    def read(size: ImageSize | None) -> Sequence[Calibration]:
        found = read_file(path, replace(reading, image_size=size))
        return found if reading.camera is None else [choose(found, reading.camera, source=label)]

    try:
        return Candidates(label=label, calibrations=tuple(read(reading.image_size)))
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
