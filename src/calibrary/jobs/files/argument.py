"""Reading of a calibration from a command line argument: a file of any format, an image, an entry's file, KEY@REV."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from msgspec import Struct

from calibrary.arguments import Place, Reading
from calibrary.calibration import Calibration, ImageSize
from calibrary.errors import InputError, MissingTagError, RegistryError
from calibrary.jobs.files import choose, file_of, read_file
from calibrary.records import replace
from calibrary.registry.entry import noted
from calibrary.registry.entry_yaml import entry_file, parse_entry
from calibrary.registry.places import one_registry
from calibrary.registry.registry import Registry

__all__ = ["Argument", "read_argument", "read_arguments"]


class Argument(Struct, frozen=True, kw_only=True):
    """A calibration and its label.

    Attributes:
        label: file name, or KEY@REV.
        calibration: the calibration.
    """

    label: str
    calibration: Calibration


def read_argument(
    given: str | Path, reading: Reading, registry: Place | Sequence[Place] | None = None
) -> Argument:
    """Read the calibration that an argument names; a file takes precedence over an entry.

    Raises:
        MissingTagError: the file needs an image size.
        InputError: the file cannot be read, or contains several cameras and none is chosen.
        RegistryError: neither a file nor an entry has that name.
    """
    return _read(given, reading, registry, reading.image_size)


def read_arguments(
    first: Calibration | str | Path,
    second: Calibration | str | Path,
    reading: Reading,
    registry: Place | Sequence[Place] | None = None,
) -> tuple[Argument, Argument]:
    """Read two calibrations of one camera; a file without an image size gets that of the other.

    Raises:
        MissingTagError: neither states an image size.
        InputError: as for :func:`read_argument`. ``reading.camera`` may name two, "cam0,cam1", one for each.
        RegistryError: as for :func:`read_argument`.
    """
    a, b = _labelled("a", first), _labelled("b", second)
    size = reading.image_size
    of_a, of_b = reading, reading
    if isinstance(reading.camera, str) and "," in reading.camera:
        left, _, right = (part.strip() for part in reading.camera.partition(","))
        of_a, of_b = replace(reading, camera=left), replace(reading, camera=right)
    try:
        one = _read(a, of_a, registry, size)
    except MissingTagError:
        two = _read(b, of_b, registry, size)
        return _read(a, of_a, registry, two.calibration.intrinsics.image_size), two
    try:
        return one, _read(b, of_b, registry, size)
    except MissingTagError:
        return one, _read(b, of_b, registry, one.calibration.intrinsics.image_size)


def _labelled(label: str, given: Calibration | str | Path) -> Argument | str | Path:
    return Argument(label=label, calibration=given) if isinstance(given, Calibration) else given


def _read(
    given: Argument | str | Path,
    reading: Reading,
    registry: Place | Sequence[Place] | None,
    image_size: ImageSize | None,
) -> Argument:
    if isinstance(given, Argument):
        return given
    text, path = str(given), Path(given)
    if not path.exists():
        return _entry(text, registry)
    if not path.is_file() and (inside := file_of(path)) is not None:
        path = inside
    if not path.is_file():
        raise InputError("is not a regular file, expected one calibration file or image", source=text)
    if reading.format is None and (data := entry_file(path)) is not None:
        entry = parse_entry(data, path.name, require_digest=False)
        return Argument(label=text, calibration=noted(entry))
    calibrations = read_file(path, replace(reading, image_size=image_size))
    number = 1 if reading.camera is None and _is_one_camera(calibrations) else reading.camera
    return Argument(label=text, calibration=choose(calibrations, number, source=text))


def _is_one_camera(calibrations: Sequence[Calibration]) -> bool:
    """Whether all have equal K and distortion, because some programs list a camera under several names."""
    first = calibrations[0]
    return all(
        (one.intrinsics, one.distortion) == (first.intrinsics, first.distortion) for one in calibrations
    )


def _entry(text: str, registry: Place | Sequence[Place] | None) -> Argument:
    looks_like_a_file = Path(text).suffix and "@" not in text
    try:
        stored = Registry.open(one_registry(registry)).get(text)
    except RegistryError:
        if looks_like_a_file:
            raise InputError("no such file, and no such entry in a registry", source=text) from None
        raise
    rev = text.partition("@")[2]
    return Argument(label=f"{stored.id}@{rev or (stored.commit or '')[:12]}", calibration=noted(stored.entry))
