"""K written into a COLMAP database that already has its images, as ``feature_extractor`` left it.

Each image of the database has a camera; those of the images of one calibrated camera get its model and parameters. The
rows are changed in place, so that frames and rigs, which refer to cameras by number, hold. All of it is one
transaction, and the rows as they were are kept as SQL that puts them back.

Sources: COLMAP documentation, "Database Format" (tables cameras and images; prior_focal_length 1: the focal length is
known).
"""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from calibrary.errors import InputError
from calibrary.interop.colmap import ColmapCamera, model_named

__all__ = ["RESTORE", "DatabaseCamera", "DatabaseChange", "plan_database", "write_database"]

RESTORE = "colmap.database-before.sql"
UPDATE = "UPDATE cameras SET model = ?, width = ?, height = ?, params = ?, prior_focal_length = 1 WHERE camera_id = ?"
BUSY_S = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class DatabaseCamera:
    """A camera for the database.

    Attributes:
        slug: its name in messages.
        camera: as COLMAP takes it; None where it has no K that may be used.
        names: its images, relative to the image directory.
    """

    slug: str
    camera: ColmapCamera | None
    names: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class DatabaseChange:
    """What is to be written into a database.

    Attributes:
        path: of the database.
        updates: the new parameters by the number of each camera.
        restore: SQL that puts the cameras back as they were.
    """

    path: Path
    updates: tuple[tuple[int, ColmapCamera], ...]
    restore: bytes


def plan_database(path: Path, cameras: Sequence[DatabaseCamera]) -> DatabaseChange:
    """Find each camera's rows; nothing is written.

    Raises:
        InputError: the file is no COLMAP database, has none of the images, or one of its cameras is of images that
            are of several cameras here.
    """
    if not path.is_file():
        raise InputError("no such file; run 'colmap feature_extractor' first", source=str(path))
    try:
        with closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as connection:
            images = connection.execute("SELECT name, camera_id FROM images").fetchall()
            rows = connection.execute(
                "SELECT camera_id, model, width, height, params, prior_focal_length FROM cameras"
            ).fetchall()
    except sqlite3.Error as error:
        raise InputError(f"cannot be read as a COLMAP database: {error}", source=str(path)) from None
    owner = {name: camera for camera in cameras for name in camera.names}
    owners: dict[int, dict[str, DatabaseCamera | None]] = {}
    for name, number in images:
        camera = owner.get(name)
        owners.setdefault(number, {})[camera.slug if camera is not None else ""] = camera
    stored = {row[0]: row for row in rows}
    updates: list[tuple[int, ColmapCamera]] = []
    for number, found in sorted(owners.items()):
        usable = [one for one in found.values() if one is not None and one.camera is not None]
        if not usable or number not in stored:
            continue
        if len(found) > 1:
            names = " and ".join(sorted(slug or "images that are not here" for slug in found))
            raise InputError(
                f"its camera {number} is that of the images of {names}; extract features with one run a camera, as "
                "colmap.sh does, or with --ImageReader.single_camera 0",
                source=str(path),
            )
        new = usable[0].camera
        assert new is not None  # noqa: S101  see usable
        size = tuple(stored[number][2:4])
        if size != (new.width, new.height):
            raise InputError(
                f"its camera {number} has images of {size[0]}×{size[1]}, and {usable[0].slug} of "
                f"{new.width}×{new.height}",
                source=str(path),
            )
        updates.append((number, new))
    if not updates:
        raise InputError("it has none of these images under their names here", source=str(path))
    restore = "".join(map(_restored, (stored[number] for number, _ in updates)))
    return DatabaseChange(path=path, updates=tuple(updates), restore=f"BEGIN;\n{restore}COMMIT;\n".encode())


def write_database(change: DatabaseChange) -> None:
    """Write all cameras, or none.

    Raises:
        InputError: the database is locked or cannot be written; it is as it was.
    """
    rows = [(*_row(camera), number) for number, camera in change.updates]
    try:
        with closing(sqlite3.connect(change.path, timeout=BUSY_S, isolation_level=None)) as connection:
            connection.execute("BEGIN IMMEDIATE")
            try:
                connection.executemany(UPDATE, rows)
            except BaseException:
                connection.execute("ROLLBACK")
                raise
            connection.execute("COMMIT")
    except sqlite3.Error as error:
        raise InputError(f"cannot be written: {error}; it is as it was", source=str(change.path)) from None


def _row(camera: ColmapCamera) -> tuple[int, int, int, bytes]:
    model = model_named(camera.model)
    assert model is not None  # noqa: S101  to_colmap names COLMAP's models only
    return model.number, camera.width, camera.height, struct.pack(f"<{len(camera.params)}d", *camera.params)


def _restored(row: tuple[int, int, int, int, bytes, int]) -> str:
    number, model, width, height, params, prior = row
    values = f"model = {int(model)}, width = {int(width)}, height = {int(height)}, params = X'{bytes(params).hex()}'"
    flag = f"prior_focal_length = {int(prior)}"
    return f"UPDATE cameras SET {values}, {flag} WHERE camera_id = {int(number)};\n"  # noqa: S608  numbers only
