"""How large each room of the product is, beside its budget in size.csv.

    python -m tests.house.size [--lower]

Counted are nodes of the syntax tree, without docstrings, so that comments, formatting and long names are free; lines,
functions, classes and files stand beside them. A room larger than its budget fails. ``--lower`` writes the sizes of
today wherever they are smaller than the budget, and takes out the rooms that are gone; a budget is raised, and a new
room is given one, by hand, with the reason in the commit.
"""

from __future__ import annotations

import argparse
import ast
import csv
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from tests.house.project import ROOMS, ROOT

BUDGET = Path(__file__).with_name("size.csv")
LIMITED = ("nodes", "lines")
"""What a budget is of: a function split in two, or a file, is no growth."""


class Size(NamedTuple):
    """What one room, or the product, comes to."""

    nodes: int = 0
    lines: int = 0
    functions: int = 0
    classes: int = 0
    files: int = 0

    def plus(self, other: Size) -> Size:
        """Both together."""
        return Size(*(a + b for a, b in zip(self, other, strict=True)))


def size_of_source(text: str) -> Size:
    """The size of one file's source."""
    nodes = functions = classes = 0
    tree = ast.parse(text)
    _drop_docstrings(tree)
    for node in ast.walk(tree):
        nodes += not isinstance(node, ast.expr_context)
        functions += isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        classes += isinstance(node, ast.ClassDef)
    return Size(nodes, text.count("\n"), functions, classes, 1)


def _drop_docstrings(tree: ast.Module) -> None:
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            node.body = [part for part in node.body if not _is_text(part)]


def _is_text(statement: ast.stmt) -> bool:
    match statement:
        case ast.Expr(value=ast.Constant(value=str())):
            return True
    return False


def sizes_by_room(root: Path = ROOT) -> dict[str, Size]:
    """The size of every room of a checkout, by its name, in alphabetical order."""
    sizes: dict[str, Size] = {}
    links = {root / "src" / "calibrary" / room for room in ROOMS}
    for base in ("src", *ROOMS):
        for path in sorted((root / base).rglob("*.py")):
            if links.isdisjoint(path.parents):
                room = _room(path.relative_to(root).parts)
                sizes[room] = sizes.get(room, Size()).plus(size_of_source(path.read_text("utf-8")))
    return dict(sorted(sizes.items()))


def _room(parts: tuple[str, ...]) -> str:
    """parsers/formats/x.py is of parsers/formats, src/calibrary/jobs/x/run.py of jobs/x, src/calibrary/x.py of core."""
    if parts[0] != "src":
        return "/".join(parts[: min(2, len(parts) - 1)])
    if parts[2] == "jobs":
        return "/".join(parts[2 : min(4, len(parts) - 1)])
    return parts[2] if len(parts) > 3 else "core"


def total(sizes: Mapping[str, Size]) -> Size:
    """All rooms together."""
    whole = Size()
    for size in sizes.values():
        whole = whole.plus(size)
    return whole


def read_budget(path: Path = BUDGET) -> dict[str, Size]:
    """The committed budget, by room."""
    with path.open(encoding="utf-8", newline="") as file:
        return {row["room"]: Size(int(row["nodes"]), int(row["lines"])) for row in csv.DictReader(file)}


def write_budget(budget: Mapping[str, Size], path: Path = BUDGET) -> None:
    """Write a budget, a row for each room."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("room", *LIMITED))
        writer.writerows((room, size.nodes, size.lines) for room, size in budget.items())


def lowered(budget: Mapping[str, Size], sizes: Mapping[str, Size]) -> dict[str, Size]:
    """The budget without what is gone, and with nothing in it that the sizes do not need."""
    return {
        room: Size(min(most.nodes, sizes[room].nodes), min(most.lines, sizes[room].lines))
        for room, most in budget.items()
        if room in sizes
    }


def excesses(budget: Mapping[str, Size], sizes: Mapping[str, Size]) -> list[str]:
    """A sentence for every room that is larger than it may be, or has no budget."""
    said = []
    for room, size in sizes.items():
        if room not in budget:
            said.append(
                f"{room} has no budget: its row of {BUDGET.name} would be {room},{size.nodes},{size.lines}"
            )
            continue
        grown = [
            f"{getattr(size, name)} {name} of {getattr(budget[room], name)}"
            for name in LIMITED
            if getattr(size, name) > getattr(budget[room], name)
        ]
        if grown:
            said.append(f"{room} is over its budget: {', '.join(grown)}")
    return said


def table(sizes: Mapping[str, Size], budget: Mapping[str, Size]) -> list[str]:
    """The lines of the table, the largest room first and the product last."""
    lines = [
        f"{'room':<24}{'nodes':>8}{'budget':>8}{'lines':>8}{'budget':>8}{'functions':>11}{'classes':>9}{'files':>7}"
    ]
    rows = sorted(sizes.items(), key=lambda row: -row[1].nodes)
    for room, size in (*rows, ("all", total(sizes))):
        most = total(budget) if room == "all" else budget.get(room, Size())
        figures = f"{size.nodes:>8}{most.nodes:>8}{size.lines:>8}{most.lines:>8}"
        lines.append(f"{room:<24}{figures}{size.functions:>11}{size.classes:>9}{size.files:>7}")
    return lines


def main() -> int:
    """Print the table; 1 where a room is over its budget."""
    reader = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    reader.add_argument("--lower", action="store_true", help="lower the budget to what the rooms need today")
    arguments = reader.parse_args()
    sizes, budget = sizes_by_room(), read_budget()
    if arguments.lower:
        budget = lowered(budget, sizes)
        write_budget(budget)
    over = excesses(budget, sizes)
    sys.stdout.write("\n".join([*table(sizes, budget), *over, ""]))
    return 1 if over else 0


if __name__ == "__main__":
    sys.exit(main())
