"""COLMAP databases: every camera of pycolmap's, and hostile or broken files."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
import pycolmap
import pytest

from calibrary import parsers
from calibrary.calibration import Grade
from calibrary.errors import InputError, ParseError, UnknownFormatError
from tests.parsers.cameras import SIZE
from tests.parsers.formats.colmap_peer import WITH_K, peer, rays, read
from tests.parsers.samples import Sample


def database(folder: Path, items: Sequence[tuple[pycolmap.Camera, bool]]) -> bytes:
    """As pycolmap writes it."""
    path = folder / "database.db"
    with pycolmap.Database.open(path) as opened:
        for item, given in items:
            item.has_prior_focal_length = given
            opened.write_camera(item)
    return path.read_bytes()


def test_a_database_gives_every_camera_of_pycolmaps(tmp_path: Path) -> None:
    data = database(tmp_path, [(peer(model, index + 1), True) for index, model in enumerate(WITH_K)])
    found = read(data, "database.db")
    assert len(found) == len(WITH_K)
    for item, model in zip(found, WITH_K, strict=True):
        expected = np.asarray(peer(model).img_from_cam(rays()))
        np.testing.assert_allclose(item.project(rays()), expected, rtol=0, atol=1e-9)
        assert item.grade is Grade.ADJUSTED
        assert dict(item.extras)["colmap/prior_focal_length"] == "1"


@pytest.mark.parametrize("model", WITH_K)
@pytest.mark.parametrize(("given", "grade"), [(True, Grade.PRIOR), (False, Grade.SEED)])
def test_a_camera_that_nobody_adjusted_is_a_prior_or_a_guess(
    model: str, given: bool, grade: Grade, tmp_path: Path
) -> None:
    untouched = pycolmap.Camera.create_from_model_name(1, model, 3650.1, *SIZE)
    [item] = read(database(tmp_path, [(untouched, given)]), "database.db")
    assert item.grade is grade
    with pytest.raises(InputError, match="guess"):
        parsers.encode([item], "colmap_text")


def test_a_journal_beside_a_database_is_not_ignored(tmp_path: Path) -> None:
    database(tmp_path, [(peer("OPENCV"), True)])
    journal = tmp_path / "database.db-wal"
    journal.write_bytes(b"")
    assert len(parsers.read(tmp_path / "database.db")) == 1
    journal.write_bytes(b"7\x7f\x06\x82")
    with pytest.raises(ParseError, match="wal_checkpoint"):
        parsers.read(tmp_path / "database.db")


def sqlite(*statements: str) -> bytes:
    with closing(sqlite3.connect(":memory:")) as connection:
        for statement in statements:
            connection.execute(statement)
        connection.commit()
        return connection.serialize()


TABLE = "CREATE TABLE cameras (camera_id, model, width, height, params, prior_focal_length)"
PARAMS = struct.pack("<8d", 3650.1, 3648.7, 2741.3, 1815.9, -0.0213, 0.0231, -0.00037, 0.00081).hex()
SAMPLES = {
    "colmap_database": Sample(
        sqlite(
            "PRAGMA page_size = 512",
            TABLE,
            "INSERT INTO cameras VALUES (1, 4, 5472, 3648, x'" + PARAMS + "', 1)",  # noqa: S608  our own
        )
    )
}


@pytest.mark.parametrize(
    ("statements", "message"),
    [
        (["CREATE TABLE x (prior_focal_length)"], "no such table"),
        (["CREATE TABLE cameras (camera_id, prior_focal_length)"], "no such column"),
        ([TABLE, "INSERT INTO cameras VALUES ('1', 1, 9, 9, x'00', 1)"], "whole numbers"),
        ([TABLE, "INSERT INTO cameras VALUES (1, 1, 9, 9, x'00', 1)"], "not doubles"),
        ([TABLE, "INSERT INTO cameras VALUES (1, 1, 9, 9, zeroblob(24), 1)"], "3 parameters, expected 4"),
        ([TABLE, "INSERT INTO cameras VALUES (1, 1, 9, 9, zeroblob(32), 1)"], "focal lengths"),
        ([TABLE, "INSERT INTO cameras VALUES (1, 1, 9, 9, zeroblob(2000000), 1)"], "cannot be read"),
        ([TABLE, "INSERT INTO cameras VALUES (1, 0, 9, 9, x'" + "ff" * 24 + "', 1)"], "not finite"),
        ([TABLE], "no camera"),
        (
            [
                "CREATE VIEW cameras AS WITH RECURSIVE n(prior_focal_length) AS "
                "(SELECT 1 UNION ALL SELECT prior_focal_length + 1 FROM n) SELECT prior_focal_length AS camera_id, "
                "1 AS model, 1 AS width, 1 AS height, NULL AS params, prior_focal_length FROM n"
            ],
            "cannot be read",
        ),
    ],
)
def test_a_hostile_or_broken_database_is_refused(statements: list[str], message: str) -> None:
    with pytest.raises(ParseError, match=message):
        read(sqlite(*statements), "database.db")


def test_a_database_cut_short_is_refused_or_reads_the_same(tmp_path: Path) -> None:
    data = database(tmp_path, [(peer("OPENCV"), True)])
    whole = read(data, "database.db")
    for end in range(0, len(data), 977):
        try:
            part = read(data[:end], "database.db", format="colmap_database")
        except ParseError:
            continue
        assert [(item.intrinsics, item.distortion) for item in part] == [
            (item.intrinsics, item.distortion) for item in whole
        ]


def test_the_end_of_a_database_is_not_taken_for_zeros(tmp_path: Path) -> None:
    data = database(tmp_path, [(peer("OPENCV"), True)])
    for end in (len(data) - 1, len(data) - 4096, 99):
        with pytest.raises(ParseError, match=r"whole|header"):
            read(data[:end], "database.db", format="colmap_database")


def test_a_database_whose_damaged_schema_is_no_text_is_refused(tmp_path: Path) -> None:
    data = database(tmp_path, [(peer("OPENCV"), True)])
    with pytest.raises(ParseError, match="cannot be read"):
        read(data.replace(b"CREATE TABLE images", b"CREATE TA\xff\xff\xff images"), "database.db")


def test_a_database_of_another_program_is_not_claimed() -> None:
    with pytest.raises(UnknownFormatError):
        read(sqlite("CREATE TABLE cameras (camera_id, model)"), "database.db")
