"""The fuzzer's targets: there is one for every reader, they take any bytes, and they do not hide what breaks."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from calibrary import parsers

# It is run from the project's folder, and is no part of what is installed.
sys.path.append(str(Path(__file__).parents[2]))

from fuzz import replay
from fuzz.target import IDENTIFY, IMAGE, target_named, targets
from tests.parsers.samples import exported
from tests.parsers.test_contract import written

SAMPLES = {name: sample.data for name, sample in exported().items()} | {
    record.name: written(record, f"camera{record.suffixes[0]}")
    for record in parsers.formats()
    if record.write is not None
}


def test_every_reader_is_fuzzed() -> None:
    assert set(targets()) == {IDENTIFY, IMAGE} | {item.name for item in parsers.formats() if item.read}


@pytest.mark.parametrize("name", targets())
def test_a_target_takes_anything(name: str) -> None:
    target = target_named(name)
    sample = SAMPLES.get(name, b"\xff\xd8\xff\xe1\0\x10Exif\0\0II*\0")
    for data in (b"", b"\0", b"noise\n", sample, sample[:-1], sample[::-1]):
        target(data)


@pytest.mark.parametrize("name", [IDENTIFY, "kitti"])
def test_a_target_lets_a_fault_through(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_arguments: object, **_named: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("fuzz.target.read_content", broken)
    with pytest.raises(ZeroDivisionError):
        target_named(name)(SAMPLES["kitti"])


@pytest.mark.parametrize(("fails", "code"), [(False, 0), (True, 1)])
def test_a_replay_tells_by_its_exit_code(
    fails: bool,
    code: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def target(_data: bytes) -> None:
        if fails:
            raise KeyError("k1")

    path = tmp_path / "found"
    path.write_bytes(b"x")
    monkeypatch.setattr(replay, "target_named", lambda _name: target)
    monkeypatch.setattr("sys.argv", ["replay", "kitti", str(path)])
    assert replay.main() == code
    assert ("KeyError" in capsys.readouterr().err) == fails
