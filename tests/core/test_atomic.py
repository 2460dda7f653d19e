"""Files are written whole or not at all, in folders that are made for them."""

from __future__ import annotations

import logging
import os
import stat
import threading
from pathlib import Path

import pytest

from calibrary import atomic
from calibrary.atomic import check_folder, write_files
from calibrary.errors import InputError


def test_folders_are_made_and_nothing_else_is_left(tmp_path: Path) -> None:
    files = {tmp_path / "a/b/one": b"1", tmp_path / "a/two": b"2"}
    write_files(files)
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == files


def test_a_file_is_made_as_open_makes_one(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        write_files({tmp_path / "made": b""})
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "made").stat().st_mode) == 0o640


def test_what_cannot_all_be_written_is_not_begun(tmp_path: Path) -> None:
    (tmp_path / "one").write_bytes(b"before")
    (tmp_path / "taken").mkdir()
    with pytest.raises(InputError, match="is a directory; nothing was written"):
        write_files({tmp_path / "one": b"1", tmp_path / "new/two": b"2", tmp_path / "taken": b"3"})
    assert (tmp_path / "one").read_bytes() == b"before"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["one", "taken"]


def test_an_interruption_leaves_no_temporary_file_and_no_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stage = atomic._stage

    def interrupted(temporary: Path, content: bytes) -> None:
        stage(temporary, content)
        if content == b"2":
            raise KeyboardInterrupt

    monkeypatch.setattr(atomic, "_stage", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_files({tmp_path / "a/one": b"1", tmp_path / "b/c/two": b"2"})
    assert list(tmp_path.iterdir()) == []


def test_every_file_is_on_the_disk_before_any_takes_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken: list[int] = []
    monkeypatch.setattr(os, "fsync", lambda _: taken.append(len([*tmp_path.glob("[!.]*")])))
    write_files({tmp_path / f"{number}": b"1" for number in range(100)})
    assert taken == [0] * 100


def test_many_files_wait_for_the_disk_side_by_side(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Each waits for another: one after the other they would wait for ever.
    both = threading.Barrier(2, timeout=60)
    monkeypatch.setattr(os, "fsync", lambda _: both.wait())
    write_files({tmp_path / f"{number}": b"1" for number in range(100)})
    assert len([*tmp_path.iterdir()]) == 100


def test_a_disk_that_fails_names_the_file_and_changes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fsync(handle: int) -> None:
        if os.fstat(handle).st_size == 2:
            raise OSError(5, "Input/output error")

    monkeypatch.setattr(os, "fsync", fsync)
    with pytest.raises(InputError, match="Input/output error; nothing was written") as told:
        write_files({tmp_path / f"{number}": b"1" * (1 + (number == 40)) for number in range(100)})
    assert told.value.source == str(tmp_path / "40")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_absent_may_be_made(tmp_path: Path) -> None:
    check_folder(tmp_path / "a/b/file")
    assert list(tmp_path.iterdir()) == []


def test_a_file_in_the_place_of_a_folder_is_told_before_any_work(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="is a file; expected a folder") as printed:
        check_folder(tmp_path / "file/below/x", place="--out")
    assert printed.value.place == "--out"


def test_what_is_written_is_logged(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.INFO, logger="calibrary"):
        write_files({tmp_path / "one": b"12"})
    assert caplog.messages == [f"wrote {tmp_path / 'one'} (2 bytes)"]
