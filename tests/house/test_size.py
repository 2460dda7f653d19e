"""No room grows past its budget: what is added takes room from something else, or says why in the budget's commit."""

from __future__ import annotations

from pathlib import Path

from tests.house.size import Size, excesses, lowered, read_budget, size_of_source, sizes_by_room, write_budget


def test_no_room_is_over_its_budget() -> None:
    over = excesses(read_budget(), sizes_by_room())
    assert not over, (
        "; ".join(over) + " (make size shows all rooms, tests/house/size.py says how a budget changes)"
    )


def test_text_and_format_cost_no_nodes() -> None:
    short = "def f(a):\n    return a + 1\n"
    told = '"""Text."""\n\n\ndef f(\n    a,\n):\n    """More text."""\n    # why\n    return a + 1\n'
    assert size_of_source(told).nodes == size_of_source(short).nodes


def test_what_is_defined_is_counted() -> None:
    source = "class A:\n    def f(self): ...\n    async def g(self): ...\n"
    assert size_of_source(source)[1:] == (3, 2, 1, 1)


def test_a_room_is_the_folder_of_its_subject(tmp_path: Path) -> None:
    for name in (
        "src/calibrary/a.py",
        "src/calibrary/jobs/x/deep/a.py",
        "src/calibrary/cli/a.py",
        "parsers/a.py",
        "parsers/formats/a.py",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("a = 1\n")
    assert list(sizes_by_room(tmp_path)) == ["cli", "core", "jobs/x", "parsers", "parsers/formats"]


def test_a_link_to_a_room_is_not_counted_twice(tmp_path: Path) -> None:
    (tmp_path / "calib").mkdir()
    (tmp_path / "calib/a.py").write_text("a = 1\n")
    (tmp_path / "src/calibrary").mkdir(parents=True)
    (tmp_path / "src/calibrary/calib").symlink_to("../../calib")
    assert list(sizes_by_room(tmp_path)) == ["calib"]


def test_a_larger_room_is_told_with_what_grew() -> None:
    assert excesses({"calib": Size(10, 5)}, {"calib": Size(11, 5)}) == [
        "calib is over its budget: 11 nodes of 10"
    ]


def test_a_room_without_a_budget_is_told_with_its_row() -> None:
    assert excesses({}, {"survey": Size(9, 3, 2, 1, 1)}) == [
        "survey has no budget: its row of size.csv would be survey,9,3"
    ]


def test_a_budget_is_lowered_and_never_raised() -> None:
    budget = {"calib": Size(10, 10), "gone": Size(3, 3), "registry": Size(10, 10)}
    assert lowered(budget, {"calib": Size(8, 12), "registry": Size(10, 10)}) == {
        "calib": Size(8, 10),
        "registry": Size(10, 10),
    }


def test_a_written_budget_is_read_back(tmp_path: Path) -> None:
    budget = {"calib": Size(1, 2)}
    write_budget(budget, tmp_path / "size.csv")
    assert read_budget(tmp_path / "size.csv") == budget
