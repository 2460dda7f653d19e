"""Writing of calibrations into the cameras of an existing COLMAP database."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final, TypeAlias

from calibrary import parsers
from calibrary.atomic import write_files
from calibrary.calibration import Calibration
from calibrary.errors import InputError
from calibrary.interop.colmap_database import (
    DatabaseChange,
    DatabaseRows,
    change_of,
    read_database,
    write_database,
)
from calibrary.parsers.format import WriteVerdict

__all__ = ["DATABASE", "Encode", "Into", "write_into_database"]

DATABASE: Final = "colmap_database"
FILE_FORMAT: Final = "colmap_binary"
"""Format with the same camera models as the database; used to measure how exactly they represent a calibration."""
MODEL: Final = "colmap/model"
LISTED: Final = 12

Encode: TypeAlias = Callable[..., tuple[bytes, WriteVerdict]]
Into = Sequence[int] | str | None
"""Camera numbers in the database, "all", or None to choose them if the choice is unambiguous."""


def write_into_database(
    calibrations: Sequence[Calibration],
    path: Path,
    *,
    into: Into = None,
    encode: Encode = parsers.encode,
) -> tuple[WriteVerdict, DatabaseChange, Path]:
    """Replace models and parameters of cameras in a database; the images keep their cameras.

    Args:
        calibrations: one for all chosen cameras, or one for each.
        path: of the database, which contains images.
        into: the chosen cameras.
        encode: :func:`calibrary.parsers.encode` on the caller's terms; the focal length of a K that was not measured is
            marked as unknown.

    Returns:
        How exactly COLMAP represents the calibrations, the change, and the SQL file next to the database that
        restores the old rows.

    Raises:
        InputError: the database does not exist or is locked, the choice of cameras is ambiguous, an image size
            differs, or a K was not measured.
        UnsupportedModelError: no COLMAP model is close enough.
    """
    stored = read_database(path)
    data, verdict = encode(calibrations, FILE_FORMAT)
    copies = parsers.decode(data, name=path.name, format=FILE_FORMAT)
    held = [item.to_colmap(dict(item.extras).get(MODEL)) for item in copies]
    known = all(item.grade.is_metric for item in calibrations)
    numbers = _numbers(calibrations, stored, into, path)
    change = change_of(path, stored, {number: held[index] for number, index in numbers.items()}, known=known)
    backup = _free(path)
    write_files({backup: change.restore})
    try:
        write_database(change)
    except InputError:
        backup.unlink(missing_ok=True)
        raise
    return verdict, change, backup


def _numbers(
    calibrations: Sequence[Calibration], stored: DatabaseRows, into: Into, path: Path
) -> Mapping[int, int]:
    """Index of the calibration for each camera number of the database."""
    if isinstance(into, str):
        chosen: Sequence[int] | None = tuple(stored.cameras)
    else:
        chosen = into
    if chosen is not None:
        if len(calibrations) == 1:
            return dict.fromkeys(chosen, 0)
        if len(chosen) != len(calibrations):
            raise InputError(
                f"there are {len(calibrations)} calibrations for {len(chosen)} cameras; choose one with --camera N",
                source=str(path),
            )
        return {number: index for index, number in enumerate(chosen)}
    own = [_own_number(item) for item in calibrations]
    if len(own) > 1 and all(number in stored.cameras for number in own):
        return {number: index for index, number in enumerate(own) if number is not None}
    found: dict[int, int] = {}
    for index, item in enumerate(calibrations):
        size = item.intrinsics.image_size
        fitting = [number for number, row in stored.cameras.items() if row[2:4] == size]
        if len(fitting) != 1 or fitting[0] in found:
            raise InputError(_which(item, fitting, stored), source=str(path))
        found[fitting[0]] = index
    return found


def _own_number(item: Calibration) -> int | None:
    """The number of a camera in a COLMAP file with several cameras."""
    number = item.camera.sub_camera or ""
    return int(number) if number.isdecimal() and item.provenance.tag == f"camera {number}" else None


def _which(item: Calibration, fitting: Sequence[int], stored: DatabaseRows) -> str:
    width, height = item.intrinsics.image_size
    if not fitting:
        sizes = ", ".join(dict.fromkeys(f"{row[2]}×{row[3]}" for row in stored.cameras.values())) or "none"
        return f"none of its cameras has images of {width}×{height}, as the calibration; it has {sizes}"
    listed = ", ".join(map(str, fitting[:LISTED])) + (", …" if len(fitting) > LISTED else "")
    return (
        f"{len(fitting)} of its cameras ({listed}) have images of {width}×{height}; say which get this K with "
        "--into N,N,…, or --into all where one camera took all images"
    )


def _free(path: Path) -> Path:
    """An unused file name for the SQL that restores the old rows."""
    names = (f"{path.name}.before{number}.sql" for number in ("", *(f"-{n}" for n in range(2, 10_000))))
    return next(place for name in names if not (place := path.with_name(name)).exists())
