"""COLMAP's ``database.db``: SQLite, with the cameras of the images before they were reconstructed.

In the format's own words::

    CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY, model INTEGER, width INTEGER, height INTEGER,
                          params BLOB, prior_focal_length INTEGER)

``params`` contains little-endian doubles, those of ``cameras.txt``. ``prior_focal_length`` is 1 where the focal
length was given or comes from EXIF, and 0 where COLMAP guessed 1.2 × the longer side. So an untouched camera is
a prior at most; one with a lens or an off-centre principal point was given or adjusted, whatever the flag says,
which scripts that fill databases often leave at 0.

``calibrary convert CAMERA.xml database.db`` changes cameras of a database that has its images: model, parameters and
``prior_focal_length`` of their rows, in one transaction, with SQL beside it that puts back what was there.

calibrary reads only this table, from a copy in memory or, if the file is too large for that, from the file opened for
reading only. Changes in another program's journal are not in the file yet, so a journal beside the file is refused.

Source: COLMAP documentation, "Database Format".
"""

from __future__ import annotations

import math
import sqlite3
import struct
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import TypeAlias

from calibrary.calibration import Calibration, Grade
from calibrary.distortion import FieldOfView, NoDistortion, exact
from calibrary.errors import ParseError, UnsupportedModelError
from calibrary.interop.colmap import PANORAMAS, model_numbered
from calibrary.parsers import text as strict
from calibrary.parsers.content import Content, Syntax
from calibrary.parsers.files import read_head
from calibrary.parsers.format import Format, ReadContext, Sniff, Sure
from calibrary.parsers.formats.colmap import CONVENTION, MAX_CAMERAS, StoredCamera, cameras
from calibrary.records import replace

MAGIC = b"SQLite format 3\0"
HEADER_BYTES = 100
LARGEST_PAGE = 65_536
SCHEMA_BYTES = 64 * 1024
"""Where the definitions of the tables stand."""
QUERY = "SELECT camera_id, model, width, height, params, prior_focal_length FROM cameras ORDER BY camera_id LIMIT ?"
LONGEST_VALUE = 1024 * 1024
STEPS = 10_000
LONGEST_QUERY = 5_000
"""In units of STEPS instructions; reading 1 000 000 cameras takes some thousand."""
INITIAL_OMEGA = 0.01

Row: TypeAlias = tuple[object, ...]


def sniff(content: Content) -> Sniff | None:
    """SQLite's mark, and a column that only COLMAP's table has."""
    if content.data.startswith(MAGIC) and b"prior_focal_length" in content.data[:SCHEMA_BYTES]:
        return Sniff(Sure.MAGIC, "SQLite with a column prior_focal_length")
    return None


def read(data: bytes, context: ReadContext) -> list[Calibration]:
    """Every camera, by its id."""
    _refuse_journal(context)
    _refuse_a_part(data, len(data), context.name)
    # COLMAP journals ahead (bytes 18 and 19 are 2), which a database in memory cannot.
    plain = b"".join([data[:18], b"\1\1", data[20:]])

    def opened() -> sqlite3.Connection:
        connection = sqlite3.connect(":memory:")
        connection.deserialize(plain)
        return connection

    return _calibrations(_rows(opened, context.name), context)


def read_in_place(path: Path, context: ReadContext) -> list[Calibration]:
    """The same of a database of any length: features and matches fill it by the gigabyte."""
    _refuse_journal(context)
    _refuse_a_part(read_head(path, HEADER_BYTES), path.stat().st_size, context.name)
    # Immutable: SQLite neither looks for a journal nor locks, so nothing is made beside the file.
    address = f"{path.resolve().as_uri()}?mode=ro&immutable=1"
    return _calibrations(_rows(lambda: sqlite3.connect(address, uri=True), context.name), context)


def _calibrations(rows: list[Row], context: ReadContext) -> list[Calibration]:
    flags = {row[0]: bool(row[5]) for row in rows}
    found = cameras([_camera(row, context.name) for row in rows], context, grade=Grade.ADJUSTED)
    return [_graded(item, given=flags[int((item.provenance.tag or "").split()[-1])]) for item in found]


def _graded(item: Calibration, *, given: bool) -> Calibration:
    extras = (*item.extras, ("colmap/prior_focal_length", str(int(given))))
    if not _is_untouched(item):
        assumption = "the database's numbers were given or adjusted: they are not those COLMAP starts from"
        provenance = replace(item.provenance, assumptions=(*item.provenance.assumptions, assumption))
        return replace(item, provenance=provenance, extras=extras)
    if given:
        note = "only the focal length is known, from EXIF or because it was given; the rest is COLMAP's start"
        return replace(item, grade=Grade.PRIOR, notes=(*item.notes, note), extras=extras)
    note = "this is what COLMAP starts from when it knows nothing of a camera"
    return replace(item, grade=Grade.SEED, notes=(*item.notes, note), extras=extras)


def _is_untouched(item: Calibration) -> bool:
    """Whether all but the focal length is as COLMAP initialises a camera."""
    K, lens = item.intrinsics, item.distortion
    width, height = K.image_size
    if (K.cx, K.cy) != (width / 2, height / 2) or K.fx != K.fy or lens is None:
        return False
    initial_fov = isinstance(lens, FieldOfView) and lens.omega == INITIAL_OMEGA
    return initial_fov or exact(lens, NoDistortion) is not None or not any(lens.coefficients.values())


def _camera(row: Row, source: str) -> StoredCamera:
    number, model, width, height, blob, _flag = row
    place = f"camera {number!r:.20}"
    if not (
        isinstance(number, int)
        and isinstance(model, int)
        and isinstance(width, int)
        and isinstance(height, int)
        and isinstance(blob, bytes)
    ):
        raise ParseError("its row is not four whole numbers and a blob", source=source, place=place)
    known = model_numbered(model)
    if known is None and model not in PANORAMAS:
        raise UnsupportedModelError(f"COLMAP's model {model} is not known here", source=source, place=place)
    if len(blob) % 8:
        raise ParseError(f"{len(blob)} bytes of parameters are not doubles", source=source, place=place)
    parameters = struct.unpack(f"<{len(blob) // 8}d", blob)
    if not all(map(math.isfinite, parameters)):
        raise ParseError("a parameter is not finite", source=source, place=place)
    return StoredCamera(
        number=number,
        model=known or PANORAMAS[model][0],
        width=width,
        height=height,
        parameters=parameters,
        place=place,
    )


def _rows(opened: Callable[[], sqlite3.Connection], source: str) -> list[Row]:
    """The table of cameras.

    Raises:
        ParseError: SQLite cannot read it, it has no such table, or there is no end to it.
    """
    try:
        with closing(opened()) as connection:
            rows = list(_bounded(connection))
    # UnicodeError: a broken name in a message of SQLite's own.
    except (sqlite3.Error, UnicodeError, OverflowError, MemoryError) as error:
        raise ParseError(f"its cameras cannot be read as COLMAP's: {error}", source=source) from None
    if len(rows) > MAX_CAMERAS:
        raise ParseError(f"there are over {MAX_CAMERAS} cameras", source=source)
    return rows


def _refuse_a_part(head: bytes, length: int, source: str) -> None:
    """SQLite takes what is missing at the end of a file for zeros, and a lens cut off for none.

    Raises:
        ParseError: it is not a database, or not as long as its header says (SQLite, "Database File Format", 1.3).
    """
    if not head.startswith(MAGIC):
        raise ParseError("this is not an SQLite database", source=source)
    if len(head) < HEADER_BYTES:
        raise ParseError(f"{length} bytes, the header alone has {HEADER_BYTES}", source=source)
    [page_bytes] = struct.unpack_from(">H", head, 16)
    page_bytes = LARGEST_PAGE if page_bytes == 1 else page_bytes
    changes, pages = struct.unpack_from(">II", head, 24)
    [counted_at] = struct.unpack_from(">I", head, 92)
    # A program older than SQLite 3.7.0 does not keep the number of pages up to date.
    wanted = pages * page_bytes if changes == counted_at else 0
    if length < wanted or length % (page_bytes or 1):
        raise ParseError(
            f"{length} bytes are not the whole of it, {pages} pages of {page_bytes} bytes; copy it again "
            "while no program has it open",
            source=source,
        )


def _bounded(connection: sqlite3.Connection) -> Iterator[Row]:
    """The rows, by a query that can neither run on nor touch anything but the one table."""
    connection.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LONGEST_VALUE)
    connection.execute("PRAGMA trusted_schema = OFF")
    left = LONGEST_QUERY

    def stop() -> bool:
        nonlocal left
        left -= 1
        return left < 0

    def permitted(action: int, table: str | None, *_rest: object) -> int:
        allowed = action == sqlite3.SQLITE_SELECT or (action == sqlite3.SQLITE_READ and table == "cameras")
        return sqlite3.SQLITE_OK if allowed else sqlite3.SQLITE_DENY

    connection.set_progress_handler(stop, STEPS)
    connection.set_authorizer(permitted)
    yield from connection.execute(QUERY, (MAX_CAMERAS + 1,))


def _refuse_journal(context: ReadContext) -> None:
    name = f"{context.name}-wal"
    try:
        journal = context.companion(name)
    except ParseError:  # a journal longer than what is read
        journal = name.encode()
    if journal:  # an empty one has been written back
        raise ParseError(
            f"part of it is still in {strict.shown(name)}; close the program that has it open, or write it back "
            "with `sqlite3 FILE 'PRAGMA wal_checkpoint(TRUNCATE)'`",
            source=context.name,
        )


FORMAT = Format(
    name="colmap_database",
    title="COLMAP database",
    suffixes=(".db",),
    syntaxes=(Syntax.BINARY,),
    reference="https://colmap.github.io/database.html",
    convention=CONVENTION,
    sniff=sniff,
    read=read,
    read_in_place=read_in_place,
    updated=True,
)
