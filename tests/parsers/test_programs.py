"""Formats by the name of the program that reads them: one table, which every command takes."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrary import parsers
from calibrary.parsers.discovery import PROGRAMS, format_named, known_formats
from tests.workshop import CAMERA


@pytest.mark.parametrize("program", PROGRAMS)
class TestProgram:
    def test_is_no_format_itself(self, program: str) -> None:
        assert program not in known_formats()

    def test_stands_for_formats_that_are_written(self, program: str) -> None:
        records = [known_formats()[name] for name in PROGRAMS[program]]
        assert records[0].write is not None
        assert all(record.write is not None or record.updated for record in records)

    def test_gets_the_format_of_the_suffix_or_the_usual_one(self, program: str) -> None:
        usual, *others = PROGRAMS[program]
        assert format_named(program).name == format_named(program, "camera.unheard").name == usual
        taken = set(known_formats()[usual].suffixes)
        for name in others:
            own = [suffix for suffix in known_formats()[name].suffixes if suffix not in taken]
            assert own, f"no file name says that {program} gets {name}"
            assert format_named(program, Path(f"camera{own[0].upper()}")).name == name
            taken.update(own)


def test_the_table_is_in_order() -> None:
    assert list(PROGRAMS) == sorted(PROGRAMS)


@pytest.mark.parametrize("name", ["cameras.txt", "cameras.bin"])
def test_what_is_written_for_a_program_is_read_for_it(tmp_path: Path, name: str) -> None:
    verdict = parsers.write([CAMERA], tmp_path / name, "colmap")
    assert verdict.outcome == "exact"
    [copy] = parsers.read(tmp_path / name, format="colmap")
    assert copy.intrinsics == CAMERA.intrinsics
