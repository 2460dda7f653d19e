"""A calibration by the one argument that names it: a file of any format, an image, an entry's file, KEY@REV."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from calibrary import parsers
from calibrary.calibration import Calibration, ImageSize
from calibrary.errors import InputError, MissingTagError, RegistryError
from calibrary.registry.configuration import require_registry
from calibrary.registry.entry_yaml import LARGEST_ENTRY, parse_entry
from calibrary.registry.registry import Registry

__all__ = ["Argument", "Reading", "entry_file", "read_argument", "read_arguments"]

ENTRY_MARK: Final = b"calibrary/entry-"


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
        options: answers to what only a file's owner knows.
        camera: which one of a file with several, from 1.
    """

    registry: Path | None = None
    format: str | None = None
    image_size: ImageSize | None = None
    options: Mapping[str, str] | None = None
    camera: int | None = None


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
    calibrations = parsers.read(path, format=reading.format, image_size=image_size, options=reading.options)
    return Argument(label=text, calibration=_chosen(calibrations, reading.camera, text))


def _entry(text: str, registry: Path | None) -> Argument:
    looks_like_a_file = Path(text).suffix and "@" not in text
    try:
        stored = Registry.open(require_registry(registry)).get(text)
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
    if path.suffix not in {".yaml", ".yml"} or path.stat().st_size > LARGEST_ENTRY:
        return None
    data = path.read_bytes()
    return data if ENTRY_MARK in data else None


def _chosen(calibrations: Sequence[Calibration], camera: int | None, source: str) -> Calibration:
    if camera is None and len(calibrations) == 1:
        return calibrations[0]
    names = ", ".join(f"{at} {item.camera}" for at, item in enumerate(calibrations[:8], start=1))
    if camera is None:
        raise InputError(
            f"contains {len(calibrations)} cameras; choose one with --camera: {names}", source=source
        )
    if not 1 <= camera <= len(calibrations):
        raise InputError(f"has no camera {camera}, found {len(calibrations)}: {names}", source=source)
    return calibrations[camera - 1]
