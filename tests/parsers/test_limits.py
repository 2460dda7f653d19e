"""How long a file may be: what is taken in, what a caller may raise, and what is looked up in place."""

from __future__ import annotations

import json
import sqlite3
import struct
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from calibrary import parsers
from calibrary.cli.main import main
from calibrary.errors import ParseError, UnknownFormatError
from calibrary.parsers.content import MAX_JSON_BYTES, Content
from calibrary.parsers.discovery import format_named
from calibrary.parsers.files import MAX_BYTES
from calibrary.parsers.xml import parse_xml

OPENSFM = (
    '[{"cameras": {"v2 acme one 4000 3000 brown 0.85": {"projection_type": "brown", "width": 4000, "height": 3000, '
    '"focal_x": 0.85, "focal_y": 0.85, "c_x": 0.0, "c_y": 0.0, "k1": 0.01, "k2": 0.0, "p1": 0.0, "p2": 0.0, '
    '"k3": 0.0}}, "shots": {}, "points": {"1": "%s"}}]'
)


@pytest.fixture
def database(tmp_path: Path) -> Path:
    """A COLMAP database whose other tables make it long."""
    path = tmp_path / "database.db"
    params = struct.pack("<8d", 3650.1, 3648.7, 2741.3, 1815.9, -0.0213, 0.0231, -0.00037, 0.00081)
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute(
            "CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY, model INTEGER, width INTEGER, height INTEGER, "
            "params BLOB, prior_focal_length INTEGER)"
        )
        connection.execute("CREATE TABLE descriptors (data BLOB)")
        connection.execute("INSERT INTO cameras VALUES (1, 4, 5472, 3648, ?, 1)", (params,))
        connection.execute("INSERT INTO descriptors VALUES (zeroblob(200000))")
        connection.commit()
    return path


def test_a_database_of_any_length_is_looked_into_where_it_lies(database: Path) -> None:
    before = sorted(database.parent.iterdir())
    assert parsers.identify(database, max_bytes=1000).format.name == "colmap_database"
    [in_place] = parsers.read(database, max_bytes=1000)
    [taken_in] = parsers.read(database)
    assert (in_place.intrinsics, in_place.distortion) == (taken_in.intrinsics, taken_in.distortion)
    assert in_place.provenance.sha256 is None
    assert sorted(database.parent.iterdir()) == before


def test_a_name_with_marks_of_an_address_is_the_files_own(database: Path) -> None:
    odd = database.rename(database.with_name("a?mode=rw#%41 b.db"))
    assert parsers.read(odd, max_bytes=1000)[0].intrinsics.fx == 3650.1


def test_a_long_database_with_a_journal_is_refused(database: Path) -> None:
    Path(f"{database}-wal").write_bytes(b"7\x7f\x06\x82" * 1000)
    with pytest.raises(ParseError, match="wal_checkpoint"):
        parsers.read(database, max_bytes=1000)


def test_a_long_database_cut_short_is_refused(database: Path) -> None:
    with database.open("r+b") as file:
        file.truncate(database.stat().st_size - 4096)
    with pytest.raises(ParseError, match="not the whole"):
        parsers.read(database, max_bytes=1000, format="colmap_database")


@pytest.mark.parametrize("record", [None, "opencv_storage"])
def test_another_long_file_is_refused(record: str | None, tmp_path: Path) -> None:
    (tmp_path / "a.yml").write_text("a: 1\n" * 1000)
    with pytest.raises(ParseError, match=r"longer than 1000 bytes.*--max-size-mib"):
        parsers.read(tmp_path / "a.yml", max_bytes=1000, format=record)
    with pytest.raises(ParseError, match=r"longer than 1000 bytes.*--max-size-mib"):
        parsers.identify(tmp_path / "a.yml", max_bytes=1000)


def test_a_raised_limit_lifts_that_of_json(tmp_path: Path) -> None:
    path = tmp_path / "reconstruction.json"
    path.write_text(OPENSFM % ("x" * MAX_JSON_BYTES))
    with pytest.raises(ParseError, match="raise --max-size-mib"):
        parsers.read(path)
    unknown = tmp_path / "unknown.json"
    unknown.write_text('{"x": "' + "x" * MAX_JSON_BYTES + '"}')
    with pytest.raises(UnknownFormatError, match="--max-size-mib"):
        parsers.read(unknown)
    [camera] = parsers.read(path, max_bytes=MAX_BYTES + 1)
    assert camera.intrinsics.fx == pytest.approx(3400)
    assert parsers.identify(path, max_bytes=MAX_BYTES + 1).format.name == "opensfm"


def many(record: str, count: int) -> bytes:
    """As many cameras as a collection with one for every image has, all different."""
    if record == "colmap_binary":
        row = struct.Struct("<IiQQ4d")
        rows = (
            row.pack(index, 1, 4000, 3000, 3000.0 + index, 3000.0, 2000.0, 1500.0)
            for index in range(1, count + 1)
        )
        return struct.pack("<Q", count) + b"".join(rows)
    if record == "colmap_text":
        return b"".join(
            b"%d PINHOLE 4000 3000 %d 3000 2000 1500\n" % (index, 3000 + index) for index in range(count)
        )
    matrix = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    frames = [
        {
            "fl_x": 3000.0 + index,
            "w": 4000,
            "h": 3000,
            "file_path": f"{index}.jpg",
            "transform_matrix": matrix,
        }
        for index in range(count)
    ]
    return json.dumps({"frames": frames}).encode()


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("record", "count"), [("colmap_binary", 20_001), ("colmap_text", 20_001), ("transforms_json", 10_001)]
)
def test_a_collection_may_have_a_camera_for_every_image(record: str, count: int) -> None:
    found = parsers.decode(many(record, count), name="cameras")
    assert len({item.intrinsics.fx for item in found}) == count


def test_more_than_a_million_cameras_are_refused_with_that_reason() -> None:
    data = (
        struct.pack("<Q", 1_000_001) + struct.pack("<IiQQ3d", 1, 0, 4000, 3000, 3000, 2000, 1500) * 1_000_001
    )
    assert format_named("colmap_binary").sniff(Content(data, "cameras.bin")) is not None
    with pytest.raises(ParseError, match="states 1000001 cameras; at most 1000000 are read"):
        parsers.decode(data, name="cameras.bin")


def test_inspect_identifies_as_long_a_file_as_it_reads(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "reconstruction.json"
    path.write_text(OPENSFM % ("x" * MAX_JSON_BYTES))
    assert main(["inspect", str(path)]) == 3
    assert "raise --max-size-mib" in " ".join(capsys.readouterr().out.split())
    assert main(["inspect", str(path), "--max-size-mib", "65"]) == 0
    assert "OpenSfM" in capsys.readouterr().out


DENSEST = """
from calibrary.errors import ParseError
from calibrary.parsers.xml import ATTRIBUTE_BYTES, MAX_BYTES, MAX_TREE_BYTES, NODE_BYTES, parse_xml

def peak_mib():
    status = open("/proc/self/status").read().splitlines()
    return int(next(line for line in status if line.startswith("VmHWM")).split()[1]) / 1024

parse_xml(b"<a/>", source="a.xml")
before = peak_mib()
for unit, cost in (
    (b"<a/>x", 2 * NODE_BYTES), (b'<a b="" c=""/>', 2 * (NODE_BYTES + ATTRIBUTE_BYTES)), (b"<a>x</a>", 3 * NODE_BYTES)
):
    most = MAX_TREE_BYTES // cost - 2
    root = parse_xml(b"<r>%s</r>" % (unit * most), source="a.xml")
    assert len(root) == most
    del root
    try:
        parse_xml(b"<r>%s</r>" % (unit * (MAX_BYTES // len(unit) - 2)), source="a.xml")
    except ParseError as error:
        assert "tags" in str(error)
print(peak_mib() - before)
"""


@pytest.mark.thorough
@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="only Linux tells a process's peak")
def test_the_densest_xml_that_is_read_takes_less_than_512_mib() -> None:
    done = subprocess.run([sys.executable, "-c", DENSEST], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) < 512 - 64


@pytest.mark.parametrize(
    ("declared", "encoding"), [("IBM037", "cp037"), ("UTF-7", "utf-7"), ("IBM1047", "latin-1")]
)
def test_long_xml_whose_tags_cannot_be_counted_is_refused(declared: str, encoding: str) -> None:
    text = f'<?xml version="1.0" encoding="{declared}"?><r>{"<a/>x" * 500_000}</r>'
    with pytest.raises(ParseError, match="unusual encoding"):
        parse_xml(text.encode(encoding), source="a.xml")


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "iso-8859-15", "windows-1252", "shift_jis"])
def test_ordinary_encodings_are_counted(encoding: str) -> None:
    text = f'<?xml version="1.0" encoding="{encoding}"?><r>{"<a>1</a>" * 300_000}</r>'
    assert len(parse_xml(text.encode(encoding), source="a.xml")) == 300_000
