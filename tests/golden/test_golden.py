"""Entries, a lock and reports as an earlier calibrary wrote them: the same numbers are read, the same bytes written.

Beside each entry's YAML stands what was read from it: the path, the digest and the JSON form of its calibration. The
files were written once and are not made anew; a change that breaks one of them breaks the registries that people keep.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from calibrary.cli.main import main
from calibrary.distortion import MODELS
from calibrary.records import to_json
from calibrary.registry.entry import digest
from calibrary.registry.entry_yaml import entry_yaml, parse_entry
from calibrary.registry.locking import lock_yaml, parse_lock, pin_of

HERE = Path(__file__).parent
ENTRIES = sorted((HERE / "entries").glob("*.yaml"))
LOCK = HERE / "calibrary.lock"


def _kept(path: Path) -> dict[str, Any]:
    kept: dict[str, Any] = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    return kept


def _is_within(old: Any, new: Any) -> bool:
    """Whether everything that was said is still said; new fields may stand beside it."""
    if isinstance(old, dict):
        return isinstance(new, dict) and all(
            name in new and _is_within(value, new[name]) for name, value in old.items()
        )
    return bool(old == new)


def test_there_is_an_entry_of_every_distortion_model() -> None:
    assert {path.stem for path in ENTRIES} == {*MODELS, "unknown"}


@pytest.mark.parametrize("path", ENTRIES, ids=lambda path: path.stem)
class TestEntry:
    def test_reads_to_the_same_numbers(self, path: Path) -> None:
        entry = parse_entry(path.read_bytes(), path.name)
        assert _is_within(_kept(path)["calibration"], to_json(entry.calibration))

    def test_has_the_same_digest_and_place(self, path: Path) -> None:
        entry = parse_entry(path.read_bytes(), path.name)
        assert digest(entry.calibration, entry.sensor) == _kept(path)["digest"]
        assert entry.path == _kept(path)["path"]

    def test_is_written_again_byte_for_byte(self, path: Path) -> None:
        assert entry_yaml(parse_entry(path.read_bytes(), path.name)) == path.read_bytes()


class TestLock:
    def test_is_written_again_byte_for_byte(self) -> None:
        assert lock_yaml(parse_lock(LOCK.read_bytes(), LOCK.name)) == LOCK.read_bytes()

    def test_pins_the_entries_beside_it(self) -> None:
        pins = {pin.path: pin for pin in parse_lock(LOCK.read_bytes(), LOCK.name).pins}
        found = [pin_of(_kept(path)["path"], path.read_bytes()) for path in ENTRIES if path.stem != "unknown"]
        assert {pin.path: pin for pin in found} == pins


def test_the_demo_flight_gets_the_same_verdicts_and_numbers(
    demo_flight: tuple[Path, object], capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["extract", "--image-dir", str(demo_flight[0]), "--recursive", "--json", "--dry-run"]
    old = json.loads((HERE / "reports" / "extract.json").read_text(encoding="utf-8"))
    assert main(command) == old["exit_code"]
    new = json.loads(capsys.readouterr().out)
    assert len(new["cameras"]) == len(old["cameras"])
    assert all(_is_within(was, now) for was, now in zip(old["cameras"], new["cameras"], strict=True))
