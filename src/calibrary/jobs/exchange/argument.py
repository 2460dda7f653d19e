"""A calibration by the one argument that names it: a file of any format, an image, an entry's file, KEY@REV."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from calibrary import parsers
from calibrary.calibration import Calibration, ImageSize
from calibrary.errors import InputError, MissingTagError, RegistryError
from calibrary.parsers.files import MAX_BYTES
from calibrary.parsers.unsized import UnsizedCalibration
from calibrary.progress import stage
from calibrary.records import replace
from calibrary.registry.configuration import require_registry
from calibrary.registry.entry_yaml import LARGEST_ENTRY, parse_entry
from calibrary.registry.reader import RegistryReader

__all__ = ["Argument", "Reading", "choose", "entry_file", "read_argument", "read_arguments"]

ENTRY_MARK: Final = re.compile(rb"^schema:[ ]*\"?calibrary/entry-\d", re.MULTILINE)
LISTED: Final = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Argument:
    """A calibration and what to call it.

    Attributes:
        label: the file's name, or KEY@REV.
        calibration: what it holds.
    """

    label: str
    calibration: Calibration


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """What the user states of files that do not state it, and where the registry is.

    Attributes:
        registry: its folder, None for the default one.
        format: of files whose content does not settle it.
        image_size: (width, height) px, for files that do not say it.
        size_from_centre: whether twice the principal point is taken for a size that nothing states.
        options: answers to what only a file's owner knows.
        camera: which one of a file with several, from 1.
        max_bytes: the longest file that is read.
    """

    registry: Path | None = None
    format: str | None = None
    image_size: ImageSize | None = None
    size_from_centre: bool = False
    options: Mapping[str, str] | None = None
    camera: int | None = None
    max_bytes: int = MAX_BYTES

    def read(self, path: Path) -> Sequence[Calibration]:
        """Every camera in a file, whichever is chosen.

        Raises:
            InputError: the kinds that :func:`calibrary.parsers.read` lists.
        """
        with stage(f"read {path}"):
            return parsers.read(
                path,
                format=self.format,
                image_size=self.image_size,
                size_from_centre=self.size_from_centre,
                options=self.options,
                max_bytes=self.max_bytes,
            )

    def read_unsized(self, path: Path) -> list[Calibration | UnsizedCalibration]:
        """Every camera in a file that does not state its image size, as far as it is known without.

        Raises:
            InputError: the kinds that :func:`calibrary.parsers.read` lists.
        """
        return parsers.read_unsized(path, format=self.format, options=self.options, max_bytes=self.max_bytes)


def choose(
    cameras: Sequence[Calibration], number: int | None, *, source: str, how: str = "--camera N"
) -> Calibration:
    """One of a file's cameras.

    Args:
        cameras: all of them.
        number: which, from 1; None for the only one.
        source: the file's name, for messages.
        how: how to say which, for messages.

    Raises:
        InputError: there are several and no number, or none of that number.
    """
    if number is None and len(cameras) == 1:
        return cameras[0]
    more = f" and {len(cameras) - LISTED} more" if len(cameras) > LISTED else ""
    listed = "; ".join(f"{at} {item.camera}" for at, item in enumerate(cameras[:LISTED], start=1)) + more
    if number is None:
        raise InputError(f"holds {len(cameras)} cameras, choose one with {how}: {listed}", source=source)
    if not 1 <= number <= len(cameras):
        raise InputError(
            f"has no camera {number}; it holds {len(cameras)}, counted from 1, choose one with {how}: {listed}",
            source=source,
        )
    return cameras[number - 1]


def read_argument(text: str, reading: Reading) -> Argument:
    """The calibration that an argument names; a file of that name comes before an entry.

    Raises:
        MissingTagError: the file needs an image size.
        InputError: the file cannot be read, or holds several cameras and none was chosen.
        RegistryError: there is neither a file nor an entry of that name.
    """
    return _read(text, reading, reading.image_size)


def read_arguments(first: str, second: str, reading: Reading) -> tuple[Argument, Argument]:
    """Two calibrations of one camera; a file that states no image size is taken to be of the other's.

    Raises:
        MissingTagError: neither states an image size.
        InputError: as for :func:`read_argument`.
        RegistryError: as for :func:`read_argument`.
    """
    try:
        one = _read(first, reading, reading.image_size)
    except MissingTagError:
        two = _read(second, reading, reading.image_size)
        return _read(first, reading, two.calibration.intrinsics.image_size), two
    try:
        return one, _read(second, reading, reading.image_size)
    except MissingTagError:
        return one, _read(second, reading, one.calibration.intrinsics.image_size)


def _read(text: str, reading: Reading, image_size: ImageSize | None) -> Argument:
    path = Path(text)
    if not path.exists():
        return _entry(text, reading.registry)
    if not path.is_file():
        raise InputError("is not a regular file, expected one calibration file or image", source=text)
    if reading.format is None and (data := entry_file(path)) is not None:
        entry = parse_entry(data, path.name, require_digest=False)
        return Argument(label=text, calibration=entry.calibration)
    calibrations = replace(reading, image_size=image_size).read(path)
    number = 1 if reading.camera is None and _is_one_camera(calibrations) else reading.camera
    return Argument(label=text, calibration=choose(calibrations, number, source=text))


def _is_one_camera(calibrations: Sequence[Calibration]) -> bool:
    """Whether all have the same K and distortion: some programs list one camera under several names."""
    first = calibrations[0]
    return all(
        (one.intrinsics, one.distortion) == (first.intrinsics, first.distortion) for one in calibrations
    )


def _entry(text: str, registry: Path | None) -> Argument:
    looks_like_a_file = Path(text).suffix and "@" not in text
    try:
        stored = RegistryReader.open(require_registry(registry)).get(text)
    except RegistryError:
        if looks_like_a_file:
            raise InputError("no such file, and no such entry in a registry", source=text) from None
        raise
    rev = text.partition("@")[2]
    return Argument(
        label=f"{stored.id}@{rev or (stored.commit or '')[:12]}", calibration=stored.entry.calibration
    )


def entry_file(path: Path) -> bytes | None:
    """The bytes of a registry's entry, None of anything else."""
    if path.stat().st_size > LARGEST_ENTRY:
        return None
    data = path.read_bytes()
    return data if ENTRY_MARK.search(data) else None
