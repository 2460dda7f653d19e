"""Images inside zip and tar files."""

from __future__ import annotations

import tarfile
import zipfile
from pathlib import Path
from typing import Literal

import pytest

from calibrary.cli.main import main
from calibrary.errors import InputError
from calibrary.jobs.extract.report import ExtractReport, encode
from calibrary.jobs.extract.run import run
from calibrary.jobs.images.places import members
from calibrary.records import to_json
from tests.jobs.extract.fleet import DEWARP, NOBODY, P4R, gate, picture


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    for number in range(6):
        tags = P4R if number % 3 else NOBODY
        picture(tmp_path / f"im/day/{number}.jpg", dewarp=DEWARP if number % 2 else None, **tags)
    (tmp_path / "im/day/broken.jpg").write_bytes(b"no image")
    (tmp_path / "im/day/.hidden.jpg").write_bytes(b"no image")
    return tmp_path / "im"


def zipped(folder: Path, path: Path, method: int) -> Path:
    with zipfile.ZipFile(path, "w", method) as archive:
        for one in sorted(folder.rglob("*")):
            archive.write(one, one.relative_to(folder))
    return path


def tarred(folder: Path, path: Path, mode: Literal["w", "w:gz"] = "w") -> Path:
    with tarfile.open(path, mode) as archive:
        archive.add(folder, "")
    return path


def document(outcome: ExtractReport) -> bytes:
    return encode(to_json(outcome)).replace(b'"./', b'"')


@pytest.mark.parametrize("kind", ["stored", "deflated", "tar"])
@pytest.mark.parametrize("scheme", [False, True])
def test_the_report_is_that_of_the_folder(flight: Path, tmp_path: Path, kind: str, scheme: bool) -> None:
    if kind == "tar":
        path = tarred(flight, tmp_path / "flight.tar")
    else:
        method = zipfile.ZIP_STORED if kind == "stored" else zipfile.ZIP_DEFLATED
        path = zipped(flight, tmp_path / "flight.zip", method)
    given = f"{path.suffix[1:]}://{path}" if scheme else path
    assert document(run(given, workers=2)) == document(gate(flight, recursive=True))


def test_the_command_reads_an_archive(flight: Path, tmp_path: Path) -> None:
    path = zipped(flight, tmp_path / "flight.zip", zipfile.ZIP_DEFLATED)
    assert main(["extract", str(path), "--dry-run"]) == 1
    assert main(["extract", f"zip://{path}", "--dry-run"]) == 1


def test_an_archive_in_a_list_has_its_name_before_those_in_it(flight: Path, tmp_path: Path) -> None:
    path = zipped(flight, tmp_path / "flight.zip", zipfile.ZIP_STORED)
    outcome = run(lines=[str(path), str(path)])
    assert outcome.images == 7
    assert outcome.rejected[0].name == f"{path}/day/broken.jpg"


def test_what_is_no_archive_is_told(tmp_path: Path, flight: Path) -> None:
    (tmp_path / "a.zip").write_bytes(b"no zip")
    with pytest.raises(InputError, match="not a zip file"):
        list(members("zip", tmp_path / "a.zip"))
    with pytest.raises(InputError, match="compressed one has to be unpacked"):
        list(members("tar", tarred(flight, tmp_path / "a.tar", "w:gz")))
    with pytest.raises(InputError, match="No such file"):
        list(members("zip", tmp_path / "gone.zip"))


def test_a_damaged_image_in_an_archive_is_a_row(flight: Path, tmp_path: Path) -> None:
    path = zipped(flight, tmp_path / "flight.zip", zipfile.ZIP_DEFLATED)
    data = bytearray(path.read_bytes())
    with zipfile.ZipFile(path) as archive:
        at = archive.getinfo("day/1.jpg").header_offset
    data[at + 60 : at + 90] = bytes(30)
    path.write_bytes(data)
    reasons = {row.name: row.reason for row in run(path).rejected}
    assert "damaged in its archive" in reasons["day/1.jpg"]
    assert set(reasons) == {"day/1.jpg", "day/broken.jpg"}


@pytest.mark.parametrize("name", ["a.tar.gz", "a.tgz"])
def test_a_compressed_tar_file_is_refused_with_what_to_do(tmp_path: Path, flight: Path, name: str) -> None:
    with pytest.raises(InputError, match="compressed one has to be unpacked first, or made a zip file"):
        run(tarred(flight, tmp_path / name, "w:gz"))
