"""Files are opened only if they are files, read only where needed, and counted."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from calibrary.errors import InputError, ParseError
from calibrary.parsers.imagery import Source, open_source, read_metadata, read_source
from calibrary.parsers.imagery.source import FIRST_CHUNK, READ_BUDGET, Block
from tests.imagery import write_jpeg
from tests.parsers.imagery.build import source_of


def refused(path: Path) -> str:
    """How reading it fails; whatever blocks here hangs."""
    with pytest.raises(InputError) as caught:
        read_metadata(path)
    assert caught.value.source == path.name
    assert str(path.parent) not in str(caught.value)
    return caught.value.message


def test_a_pipe_is_refused_and_does_not_block(tmp_path: Path) -> None:
    pipe = tmp_path / "DJI_0001.JPG"
    os.mkfifo(pipe)
    assert "a pipe" in refused(pipe)


def test_a_directory_a_socket_and_a_device_are_refused(tmp_path: Path) -> None:
    folder = tmp_path / "folder.jpg"
    folder.mkdir()
    assert "a directory" in refused(folder)
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "s.jpg"))
        assert "a socket" in refused(tmp_path / "s.jpg")
    assert "a device" in refused(Path("/dev/zero"))


def test_a_symlink_to_an_image_is_followed_and_a_loop_is_refused(tmp_path: Path) -> None:
    real = write_jpeg(tmp_path / "real.jpg", (40, 30))
    (tmp_path / "link.jpg").symlink_to(real)
    assert read_metadata(tmp_path / "link.jpg").size == (40, 30)
    loop = tmp_path / "loop.jpg"
    loop.symlink_to(loop)
    assert "cannot be opened" in refused(loop)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    assert "No such file" in refused(tmp_path / "gone.jpg")


def test_a_name_with_nul_is_an_input_error() -> None:
    with pytest.raises(InputError, match="cannot be opened"):
        read_metadata("a\0b.jpg")


def test_control_characters_of_a_name_stay_out_of_messages(tmp_path: Path) -> None:
    path = tmp_path / "a\x1b[2J\n.jpg"
    path.write_bytes(b"")
    with pytest.raises(ParseError) as caught:
        read_metadata(path)
    assert str(caught.value).startswith("a�[2J�.jpg: ")


def test_a_path_may_be_a_string(tmp_path: Path) -> None:
    assert read_metadata(str(write_jpeg(tmp_path / "a.jpg", (40, 30)))).size == (40, 30)


def test_bytes_are_read_where_they_are_asked_and_counted() -> None:
    data = bytes(range(256)) * 1024
    source = source_of(data)
    assert source.bytes_read == FIRST_CHUNK
    assert source.read(10, 20) == data[10:30]
    assert source.bytes_read == FIRST_CHUNK
    assert source.read(100_000, 20) == data[100_000:100_020]
    assert source.read(100_020, 20) == data[100_020:100_040]
    assert source.bytes_read == FIRST_CHUNK + 4096
    assert source.read(200_000, 4, ahead=64) == data[200_000:200_004]
    assert source.bytes_read == FIRST_CHUNK + 4096 + 64
    assert source.read(FIRST_CHUNK - 2, 4) == data[FIRST_CHUNK - 2 : FIRST_CHUNK + 2]


def test_past_the_end_there_are_fewer_bytes_or_none() -> None:
    data = bytes(100_000)
    source = source_of(data)
    assert source.read(99_990, 100) == bytes(10)
    assert source.read(100_000, 1) == b""
    assert source.read(1 << 63, 1) == b""
    assert source_of(b"").read(0, 4) == b""


def test_the_budget_ends_reading() -> None:
    source = source_of(bytes(READ_BUDGET + FIRST_CHUNK))
    with pytest.raises(ParseError, match="16 MiB"):
        source.read(100, READ_BUDGET)


def test_a_block_ends_where_it_ends() -> None:
    block = source_of(bytes(range(100))).block(10, 20)
    assert block.read(5, 3) == bytes([15, 16, 17])
    assert block.read(18, 10) == bytes([28, 29])
    assert block.read(25, 1) == b""
    assert Block.of(b"abcdef", "x").read(2, 2) == b"cd"
    assert source_of(b"abc").block(1, 1000).length == 2
    assert source_of(b"abc").block(50).length == 0


def test_the_file_is_closed_whatever_happens(tmp_path: Path) -> None:
    path = write_jpeg(tmp_path / "a.jpg", (40, 30))
    before = len(list(Path("/proc/self/fd").iterdir()))
    read_metadata(path)
    path.write_bytes(b"no image")
    with pytest.raises(ParseError):
        read_metadata(path)
    assert len(list(Path("/proc/self/fd").iterdir())) == before


def test_a_failing_disk_is_an_input_error() -> None:
    class Failing:
        def seek(self, offset: int) -> int:
            return offset

        def read(self, size: int) -> bytes:
            raise OSError(5, "Input/output error", f"/secret/place/{size}")

    with pytest.raises(InputError) as caught:
        Source(Failing(), name="a.jpg", size=10)  # type: ignore[arg-type]  # two methods are all it uses
    assert str(caught.value) == "a.jpg: cannot be read: Input/output error"


def test_metadata_that_an_open_source_gives_tells_what_it_took(tmp_path: Path) -> None:
    path = write_jpeg(tmp_path / "a.jpg", (5472, 3648))
    with open_source(path) as source:
        assert read_source(source).size == (5472, 3648)
        assert source.bytes_read == min(path.stat().st_size, FIRST_CHUNK)
