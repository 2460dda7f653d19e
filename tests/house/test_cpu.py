"""No test is dear without a reason: the table names what exists, and what is neither cheap nor listed fails."""

from __future__ import annotations

import csv

import pytest

from tests.cpu import DEAR, FACTOR, USUAL_S, by_room, complaint
from tests.house.project import ROOT

with DEAR.open(encoding="utf-8", newline="") as file:
    ROWS = [*csv.DictReader(file)]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row["name"])
def test_a_row_names_what_is_there_and_says_why(row: dict[str, str]) -> None:
    place, *names = row["name"].partition("[")[0].split("::")
    sources = [ROOT / place] if place.endswith(".py") else [*(ROOT / place).glob("*.py")]
    text = "".join(path.read_text(encoding="utf-8") for path in sources)
    assert sources
    assert all(f"def {name}(" in text or f"class {name}" in text for name in names)
    assert float(row["seconds"]) > USUAL_S
    assert len(row["reason"].split()) > 2


def test_each_is_listed_once_and_in_order() -> None:
    names = [row["name"] for row in ROWS]
    assert names == sorted(set(names))


def test_what_is_not_listed_may_take_a_second_and_fails_beyond_four() -> None:
    assert complaint({}, FACTOR * USUAL_S, "tests/a.py::test_b") is None
    said = complaint({}, FACTOR * USUAL_S + 0.1, "tests/a.py::test_b")
    assert said is not None
    assert said.startswith("tests/a.py::test_b took 4.1 s of CPU and may take 1: ")


def test_a_test_is_listed_before_its_file() -> None:
    dear = {"tests/a.py": 2.0, "tests/a.py::test_b": 5.0}
    names = ("tests/a.py::test_b[1]", "tests/a.py::test_b", "tests/a.py")
    assert complaint(dear, 9.0, *names) is None
    assert complaint(dear, 9.0, "tests/a.py::test_c", "tests/a.py") is not None


def test_rooms_are_told_the_dearest_first() -> None:
    costs = [
        ("tests/jobs/x/test_a.py::b", 3.0),
        ("tests/sfm/test_a.py::b", 4.0),
        ("tests/jobs/y/test_a.py::b", 2.0),
    ]
    assert by_room(costs) == "9 s of CPU: jobs 5, sfm 4"
