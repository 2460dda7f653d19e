"""Mutation testing: does a test notice when one operator of the product is wrong?

    make mutants                                   40 mutants of every room
    make mutants ARGS="registry --count 200 --seed 7"

A mutant is the product with one comparison, arithmetic operator, ``and``/``or`` or ``not`` changed, drawn with a seed.
It is run against the tests of its room that reach its line (coverage.py says which), the quickest first, and is
*killed* by the first that fails. A survivor is a place that no test watches, or a change without effect: the latter are
listed, with the reason, in mutants-equivalent.txt beside this file, by file, function and change, so that a line may
move.

The tests run in copies of the tree below build/mutants; the checkout is not touched. mutmut and cosmic-ray do not fit:
the one rewrites a package in place and loses the links between the rooms, the other runs all tests on every mutant.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import shutil
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[1]
WORK = ROOT / "build" / "mutants"
EQUIVALENT = Path(__file__).with_name("mutants-equivalent.txt")

CORE = ("records", "distortion", "interop")
ROOMS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "calib": (("calib",), ("tests/calib",)),
    "parsers": (("parsers",), ("tests/parsers", "tests/imagery")),
    "registry": (("registry",), ("tests/registry", "tests/cli/registry")),
    "sfm": (("src/calibrary/sfm",), ("tests/sfm",)),
    "evidence": (
        ("src/calibrary/evidence", "src/calibrary/catalogue"),
        ("tests/evidence", "tests/imagery", "tests/jobs/extract"),
    ),
    "core": (
        ("src/calibrary/*.py", *(f"src/calibrary/{name}" for name in CORE)),
        (
            "tests/core",
            "tests/records",
            "tests/interop",
            "tests/schemas",
            "tests/test_dates.py",
            "tests/test_probability.py",
        ),
    ),
    "jobs": (("src/calibrary/jobs",), ("tests/jobs", "tests/cli")),
    "cli": (("src/calibrary/cli",), ("tests/cli", "tests/jobs/onboard")),
}
"""Where a room's code is, and the tests of its own; what people see of jobs and registries is tested at commands."""

SWAPS: dict[type[ast.AST], tuple[str, ...]] = {
    ast.Lt: ("<=", ">"),
    ast.LtE: ("<", ">"),
    ast.Gt: (">=", "<"),
    ast.GtE: (">", "<"),
    ast.Eq: ("!=",),
    ast.NotEq: ("==",),
    ast.Is: ("is not",),
    ast.IsNot: ("is",),
    ast.In: ("not in",),
    ast.NotIn: ("in",),
    ast.And: ("or",),
    ast.Or: ("and",),
    ast.Add: ("-",),
    ast.Sub: ("+",),
    ast.Mult: ("/",),
    ast.Div: ("*",),
    ast.FloorDiv: ("*",),
    ast.Mod: ("*",),
    ast.Pow: ("*",),
}
MOST_SECONDS = 60.0
"""Of tests that one mutant is run against; by the first run's durations."""


class Mutant(NamedTuple):
    """One change of one file."""

    path: str
    line: int
    function: str
    start: int
    end: int
    new: str
    shown: str

    @property
    def key(self) -> str:
        """The line of mutants-equivalent.txt, without the reason."""
        return f"{self.path} {self.function}: {self.shown}"


class _Finder(ast.NodeVisitor):
    """Collects every change of one file; an operator is searched for between its operands."""

    def __init__(self, path: str, source: str) -> None:
        self.path, self.lines, self.data = path, source.splitlines(keepends=True), source.encode()
        self.starts = [0]
        for line in self.lines:
            self.starts.append(self.starts[-1] + len(line.encode()))
        self.functions: list[str] = []
        self.found: list[Mutant] = []

    def visit(self, node: ast.AST) -> None:
        """Leave out what does nothing at run time: annotations and texts."""
        named = isinstance(node, ast.FunctionDef | ast.ClassDef)
        self.functions += [node.name] if isinstance(node, ast.FunctionDef | ast.ClassDef) else []
        super().visit(node)
        for name, value in ast.iter_fields(node):
            if name not in {"annotation", "returns"} and not isinstance(node, ast.JoinedStr):
                for child in value if isinstance(value, list) else [value]:
                    if isinstance(child, ast.AST):
                        self.visit(child)
        if named:
            self.functions.pop()

    def generic_visit(self, node: ast.AST) -> None:
        """The children are visited by :meth:`visit`."""

    def visit_Compare(self, node: ast.Compare) -> None:
        """``a < b <= c`` has two."""
        operands = [node.left, *node.comparators]
        for left, right, kind in zip(operands, operands[1:], node.ops, strict=False):
            self._between(left, right, kind)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        """Not the joining and formatting of texts."""
        if not any(
            isinstance(one, ast.Constant) and isinstance(one.value, str) for one in (node.left, node.right)
        ):
            self._between(node.left, node.right, node.op)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        """``a and b and c`` has two."""
        for left, right in zip(node.values, node.values[1:], strict=False):
            self._between(left, right, node.op)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        """``not`` is dropped."""
        if isinstance(node.op, ast.Not):
            self._add(self._start(node), self._start(node.operand), "", "not dropped")

    def _start(self, node: ast.expr) -> int:
        return self.starts[node.lineno - 1] + node.col_offset

    def _between(self, left: ast.expr, right: ast.expr, kind: ast.AST) -> None:
        low = self.starts[(left.end_lineno or 1) - 1] + (left.end_col_offset or 0)
        gap = self.data[low : self._start(right)]
        word = gap.strip(b"() \n\t\\")
        if word and b"#" not in gap:
            begin = low + gap.index(word)
            for new in SWAPS.get(type(kind), ()):
                self._add(begin, begin + len(word), new, f"{word.decode()} -> {new}")

    def _add(self, begin: int, end: int, new: str, what: str) -> None:
        line = self.data[:begin].count(b"\n") + 1
        shown = f"{what} in `{' '.join(self.lines[line - 1].split())}`"
        self.found.append(Mutant(self.path, line, ".".join(self.functions), begin, end, new, shown))


def mutants_of(path: str, source: str) -> list[Mutant]:
    """Every change of a file."""
    finder = _Finder(path, source)
    finder.visit(ast.parse(source))
    return finder.found


class Recorder:
    """A pytest plugin of the first run: tells coverage.py which test runs, and how long each took."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        """Lines from here on, set-up included, are of this test."""
        import coverage  # noqa: PLC0415  installed for make mutants alone

        if (running := coverage.Coverage.current()) is not None:
            running.switch_context(nodeid)

    def pytest_runtest_logreport(self, report: Any) -> None:
        """Add up set-up, call and tear-down."""
        self.seconds[report.nodeid] = self.seconds.get(report.nodeid, 0.0) + report.duration

    def pytest_sessionfinish(self) -> None:
        """Write the durations beside the coverage."""
        Path(os.environ["MUTANTS_SECONDS"]).write_text(json.dumps(self.seconds))


def pytest_configure(config: Any) -> None:
    """Register the recorder; this module is named with ``-p`` in the first run only."""
    config.pluginmanager.register(Recorder())


def copy_tree(place: Path) -> None:
    """The files that git tracks or would, with the links between the rooms."""
    shutil.rmtree(place, ignore_errors=True)
    listed = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        check=True,
    )
    for name in filter(None, listed.stdout.decode().split("\0")):
        if (ROOT / name).exists() or (ROOT / name).is_symlink():
            (place / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, place / name, follow_symlinks=False)


def run_pytest(
    place: Path, arguments: Sequence[str], *, show: bool = False, seconds: float | None = None, **more: str
) -> int:
    """Run pytest in a copy, in silence unless ``show``; a time-out counts as a failure."""
    environment = os.environ | {
        "PYTHONPATH": f"{place / 'src'}{os.pathsep}{place}",
        "OPENBLAS_NUM_THREADS": "1",
        **more,
    }
    try:
        done = subprocess.run(
            [sys.executable, *arguments],
            cwd=place,
            env=environment,
            timeout=seconds,
            check=False,
            capture_output=not show,
        )
    except subprocess.TimeoutExpired:
        return 1
    return done.returncode


def reached(room: str) -> tuple[dict[tuple[str, int], set[str]], dict[str, float]]:
    """The tests that reach each line of a room's code, and the seconds of each test."""
    from coverage import CoverageData  # noqa: PLC0415  as above

    place = WORK / "first"
    copy_tree(place)
    data, seconds = WORK / f"{room}.coverage", WORK / f"{room}.json"
    sources = ",".join(str(place / one.partition("*")[0]) for one in ROOMS[room][0])
    arguments = ["-m", "coverage", "run", f"--data-file={data}", f"--source={sources}", "-m", "pytest", "-q"]
    arguments += ["-p", "benchmarks.mutants", "-p", "no:cacheprovider", "-p", "no:xdist", *ROOMS[room][1]]
    if run_pytest(place, arguments, show=True, MUTANTS_SECONDS=str(seconds)) != 0:
        sys.exit(f"the tests of {room} fail without a mutant, as pytest says above")
    found: dict[tuple[str, int], set[str]] = {}
    measured = CoverageData(str(data))
    measured.read()
    for file in measured.measured_files():
        name = Path(file).relative_to(place).as_posix()
        for line, contexts in measured.contexts_by_lineno(file).items():
            found[name, line] = {one for one in contexts if one}
    return found, json.loads(seconds.read_text())


def survives(mutant: Mutant, tests: Sequence[str], place: Path, seconds: float) -> bool:
    """Whether every test passes with the mutant in a copy of the tree."""
    file = place / mutant.path
    data = file.read_bytes()
    file.write_bytes(data[: mutant.start] + mutant.new.encode() + data[mutant.end :])
    try:
        arguments = ["-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", *tests]
        return run_pytest(place, arguments, seconds=20 + 5 * seconds) == 0
    finally:
        file.write_bytes(data)


def of_room(room: str, count: int, seed: int, jobs: int) -> tuple[int, list[Mutant]]:
    """Draw a room's mutants and run them; returns how many were killed, and the survivors that are not listed."""
    listed = {line.partition("  # ")[0].strip() for line in EQUIVALENT.read_text().splitlines()}
    lines, seconds = reached(room)
    files = sorted(
        {f for one in ROOMS[room][0] for f in (ROOT.glob(one) if "*" in one else (ROOT / one).rglob("*.py"))}
    )
    every = [m for file in files for m in mutants_of(file.relative_to(ROOT).as_posix(), file.read_text())]
    drawn = random.Random(seed).sample(  # noqa: S311  not for secrets
        [one for one in every if one.key not in listed], min(count, len(every))
    )
    of_file: dict[str, set[str]] = {}
    for (name, _), tests in lines.items():
        of_file.setdefault(name, set()).update(tests)
    places: SimpleQueue[Path] = SimpleQueue()
    for number in range(jobs):
        copy_tree(WORK / f"copy{number}")
        places.put(WORK / f"copy{number}")

    def judged(mutant: Mutant) -> Mutant | None:
        chosen, spent = [], 0.0
        # What runs when a module is loaded runs before any test: those that use the module notice it.
        reaching = lines.get((mutant.path, mutant.line)) or of_file.get(mutant.path, set())
        for test in sorted(reaching, key=lambda one: seconds.get(one, 0.0)):
            spent += seconds.get(test, 0.0)
            if spent > MOST_SECONDS:
                break
            chosen.append(test)
        place = places.get()
        try:
            lives = not chosen or survives(mutant, chosen, place, spent)
        finally:
            places.put(place)
        what = "survived" if lives else "killed"
        print(f"{what:9}{mutant.path}:{mutant.line}  {mutant.shown}  ({len(chosen)} tests)", flush=True)
        return mutant if lives else None

    with ThreadPoolExecutor(jobs) as pool:
        left = [one for one in pool.map(judged, drawn) if one is not None]
    return len(drawn) - len(left), left


def main() -> None:
    """Draw, run and print; exits with 1 where fewer than nine tenths are killed."""
    parser = argparse.ArgumentParser(description="mutation testing of the product, by room")
    parser.add_argument("rooms", nargs="*", choices=[[], *ROOMS], help="default: all")
    parser.add_argument("--count", type=int, default=40, help="mutants of each room (default: 40)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    given = parser.parse_args()
    WORK.mkdir(parents=True, exist_ok=True)
    begun, killed, left = time.perf_counter(), 0, list[Mutant]()
    for room in given.rooms or ROOMS:
        dead, lives = of_room(room, given.count, given.seed, given.jobs)
        print(f"{room}: {dead} of {dead + len(lives)} killed\n", flush=True)
        killed, left = killed + dead, left + lives
    for one in left:
        print(f"survivor  {one.path}:{one.line}\n  {one.key}")
    total = killed + len(left)
    print(f"{killed} of {total} mutants killed, seed {given.seed}, in {time.perf_counter() - begun:.0f} s")
    sys.exit(0 if killed >= 0.9 * total else 1)


if __name__ == "__main__":
    main()
