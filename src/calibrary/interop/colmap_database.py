"""Writing of K into a COLMAP database that already contains images, as ``feature_extractor`` makes it.

The camera rows are changed in place, so that images, frames and rigs, which refer to cameras by number, stay
valid. The change is one transaction, and SQL that restores the old rows is kept.

Sources: COLMAP documentation, "Database Format" (tables cameras and images; prior_focal_length 1: the focal length is
known).
"""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Iterator, Mapping
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Final, TypeAlias

from msgspec import Struct

from calibrary.errors import InputError
from calibrary.interop.colmap import ColmapCamera, model_named
from calibrary.interrupts import interrupts_held

CAMERAS: Final = "SELECT camera_id, model, width, height, params, prior_focal_length FROM cameras"
UPDATE: Final = (
    "UPDATE cameras SET model = ?, width = ?, height = ?, params = ?, prior_focal_length = ? "
    "WHERE camera_id = ?"
)
PROGRAMS: Final = "SELECT type, name FROM sqlite_master WHERE type IN ('trigger', 'view') LIMIT 1"
BUSY_S = 5.0
STEPS: Final = 10_000
"""SQLite's instructions between two looks whether the job was interrupted."""

Row: TypeAlias = tuple[int, int, int, int, bytes, int]
"""camera_id, model, width, height, params, prior_focal_length."""


class DatabaseRows(Struct, frozen=True, kw_only=True):
    """The cameras and images of a database.

    Attributes:
        cameras: camera rows by number, in order.
        images: name and camera number of each image.
    """

    cameras: Mapping[int, Row]
    images: tuple[tuple[str, int], ...]


class DatabaseChange(Struct, frozen=True, kw_only=True):
    """A change to be written to a database.

    Attributes:
        path: of the database.
        before: the present rows of the cameras that will change.
        after: the same rows with the new parameters.
    """

    path: Path
    before: tuple[Row, ...]
    after: tuple[Row, ...]

    @property
    def restore(self) -> bytes:
        """SQL that restores the old camera rows: ``sqlite3 database.db < FILE``."""
        return f"BEGIN;\n{''.join(map(_restored, self.before))}COMMIT;\n".encode()


def read_database(path: Path) -> DatabaseRows:
    """Read the cameras of a database and the images that use them; writes nothing.

    Raises:
        InputError: the file does not exist, is not a COLMAP database, or contains triggers or views.
    """
    if not path.is_file():
        raise InputError("no such file; run 'colmap feature_extractor' first", source=str(path))
    try:
        with (
            closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as connection,
            _stoppable(connection, path),
        ):
            images = connection.execute("SELECT name, camera_id FROM images").fetchall()
            rows = connection.execute(f"{CAMERAS} ORDER BY camera_id").fetchall()
    except sqlite3.Error as error:
        raise InputError(f"cannot be read as a COLMAP database: {error}", source=str(path)) from None
    return DatabaseRows(cameras={row[0]: row for row in rows}, images=tuple(images))


def change_of(
    path: Path, stored: DatabaseRows, cameras: Mapping[int, ColmapCamera], *, known: bool = True
) -> DatabaseChange:
    """Prepare new parameters for some of a database's cameras.

    Args:
        path: of the database.
        stored: its present content.
        cameras: the new cameras by row number.
        known: whether the focal length is known; COLMAP refines an unknown one from the start.

    Raises:
        InputError: a row does not exist, or its image size differs from that of the new camera.
    """
    before, after = [], []
    for number, camera in sorted(cameras.items()):
        row = stored.cameras.get(number)
        if row is None:
            listed = ", ".join(map(str, list(stored.cameras)[:20])) or "none"
            raise InputError(f"it has no camera {number}; it has {listed}", source=str(path))
        if row[2:4] != (camera.width, camera.height):
            raise InputError(
                f"its camera {number} has images of {row[2]}×{row[3]}, and the calibration is of "
                f"{camera.width}×{camera.height}",
                source=str(path),
            )
        before.append(row)
        after.append((number, *_columns(camera), int(known)))
    return DatabaseChange(path=path, before=tuple(before), after=tuple(after))


def write_database(change: DatabaseChange) -> None:
    """Write all cameras or none.

    Raises:
        InputError: the database is locked, not writable, or was changed after reading; it stays unchanged.
    """
    try:
        with (
            closing(sqlite3.connect(change.path, timeout=BUSY_S, isolation_level=None)) as connection,
            _stoppable(connection, change.path),
            _transaction(connection),
        ):
            current = {row[0]: row for row in connection.execute(CAMERAS)}
            if any(current.get(row[0]) != row for row in change.before):
                raise InputError(
                    "another program changed its cameras meanwhile; try again", source=str(change.path)
                )
            connection.executemany(UPDATE, [(*row[1:], row[0]) for row in change.after])
    except sqlite3.Error as error:
        raise InputError(f"cannot be written: {error}; it is as it was", source=str(change.path)) from None


@contextmanager
def _stoppable(connection: sqlite3.Connection, path: Path) -> Iterator[None]:
    """Let Ctrl-C and SIGTERM end a statement, which Python hears only after it, and refuse what may have no end.

    COLMAP makes no triggers and no views; those of a hostile file run when a row is read or changed.

    Raises:
        InputError: the database contains a trigger or a view.
    """
    with interrupts_held() as arrived:
        connection.set_progress_handler(lambda: bool(arrived), STEPS)
        found = connection.execute(PROGRAMS).fetchone()
        if found is not None:
            kind, name = found
            raise InputError(
                f"it contains the {kind} {str(name)!r:.80}, which COLMAP does not make and which would run with every "
                f"change; look at it, and remove it with DROP {kind.upper()} if it is not needed",
                source=str(path),
            )
        yield


@contextmanager
def _transaction(connection: sqlite3.Connection) -> Iterator[None]:
    connection.execute("BEGIN IMMEDIATE")
    try:
        yield
    except BaseException:
        connection.execute("ROLLBACK")
        raise
    connection.execute("COMMIT")


def _columns(camera: ColmapCamera) -> tuple[int, int, int, bytes]:
    model = model_named(camera.model)
    if model is None:
        raise InputError(f"COLMAP has no model {camera.model!r}")
    return model.number, camera.width, camera.height, struct.pack(f"<{len(camera.params)}d", *camera.params)


def _restored(row: Row) -> str:
    number, model, width, height, params, prior = row
    values = f"model = {int(model)}, width = {int(width)}, height = {int(height)}, params = X'{bytes(params).hex()}'"
    flag = f"prior_focal_length = {int(prior)}"
    return f"UPDATE cameras SET {values}, {flag} WHERE camera_id = {int(number)};\n"  # noqa: S608  numbers only
