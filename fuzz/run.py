"""Fuzz every reader, judge what is found, and say how to see it again.

    python -m fuzz.run [--seconds S] [--until S] [--target NAME,NAME] [--jobs N] [--folder DIR] [--samples DIR]

In the project's folder; ``make fuzz`` does it. The corpus stays in the folder (build/fuzz) and grows from run to
run, as do the findings and the table of CPU time spent on each reader, so that a run can be stopped and started
again at any time. Exit code 1 when there is a finding, 2 when a fuzzer could not run.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from fuzz.seeds import write_dictionary, write_samples, write_seeds
from fuzz.target import MAX_GROWTH_MIB, targets

ROOT = Path(__file__).parents[1]
FOLDER = Path("build") / "fuzz"
LONGEST_INPUT = 16 * 1024
HANG_SECONDS = 20
"""libFuzzer ends an input that takes longer; whether two seconds are kept is for the replay to say."""
OVERDUE_SECONDS = 300
"""How much longer than asked a fuzzer may take on a machine that is busy with other work."""
OWN_MIB = 512
"""What the fuzzer itself, the instrumented code and the corpus may hold, beside what an input may."""

_DONE = re.compile(r"Done (\d+) runs in (\d+) second")
_COVERED = re.compile(r"\bcov: (\d+)")
NICE = ("nice", "-n", "19") if os.name == "posix" else ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """What became of one reader.

    Attributes:
        target: its name.
        runs: how many inputs it was fed.
        cpu_s: the CPU time they took, in seconds, the fuzzer's own included.
        covered: how many edges of the code they reached.
        findings: the inputs that break a promise, each confirmed without the fuzzer.
        log: the fuzzer's own words, where it ended before its time; empty otherwise.
    """

    target: str
    runs: int
    cpu_s: float
    covered: int
    findings: tuple[Path, ...]
    log: str


def fuzz(target: str, folder: Path, seconds: int) -> Result:
    """Run one reader in a process of its own."""
    corpus, findings = folder / "corpus" / target, folder / "findings" / target
    words, tally = folder / f"{target}.dict", findings.with_suffix(".tally")
    corpus.mkdir(parents=True, exist_ok=True)
    findings.mkdir(parents=True, exist_ok=True)
    tally.write_text("0 0")
    write_dictionary(corpus, words)
    flags = [
        f"-max_total_time={seconds}",
        f"-max_len={LONGEST_INPUT}",
        f"-timeout={HANG_SECONDS}",
        f"-rss_limit_mb={OWN_MIB + MAX_GROWTH_MIB}",
        f"-malloc_limit_mb={MAX_GROWTH_MIB}",
        f"-artifact_prefix={findings}{os.sep}",
        *([f"-dict={words}"] if words.stat().st_size else []),
    ]
    command = [*NICE, sys.executable, "-m", "fuzz.harness", target, str(findings), *flags, str(corpus)]
    try:
        done = subprocess.run(
            command,
            cwd=ROOT,
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
            timeout=seconds + OVERDUE_SECONDS,
        )
        said, ended = done.stdout + done.stderr, done.returncode == 0
    except subprocess.TimeoutExpired:
        said, ended = f"it did not end in {seconds + OVERDUE_SECONDS} s", False
    cpu_s, runs = tally.read_text().split()
    found = tuple(sorted(path for path in findings.iterdir() if breaks_a_promise(target, path)))
    covered = _COVERED.findall(said)
    return Result(
        target=target,
        runs=int(runs),
        cpu_s=float(cpu_s),
        covered=int(covered[-1]) if covered else 0,
        findings=found,
        log="" if ended and _DONE.search(said) else said[-4000:],
    )


def breaks_a_promise(target: str, path: Path) -> bool:
    """Whether a file does so without the fuzzer as well; one that no longer does is taken away."""
    try:
        replayed = subprocess.run(
            [sys.executable, "-m", "fuzz.replay", target, str(path)],
            cwd=ROOT,
            capture_output=True,
            check=False,
            timeout=60,
        )
    except subprocess.TimeoutExpired:
        return True
    if replayed.returncode:
        return True
    path.unlink()
    return False


class Spent:
    """CPU seconds and inputs for each reader, over all runs on one folder.

    Attributes:
        seconds: of CPU time, by reader.
        runs: inputs, by reader.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / "spent.json"
        before = json.loads(self._path.read_text()) if self._path.exists() else {}
        self.seconds: dict[str, float] = {name: spent[0] for name, spent in before.items()}
        self.runs: dict[str, int] = {name: spent[1] for name, spent in before.items()}

    def add(self, result: Result) -> None:
        """Count one more run of a reader, and keep the sums."""
        self.seconds[result.target] = self.seconds.get(result.target, 0.0) + result.cpu_s
        self.runs[result.target] = self.runs.get(result.target, 0) + result.runs
        table = {name: [round(self.seconds[name], 1), self.runs[name]] for name in sorted(self.seconds)}
        self._path.write_text(json.dumps(table, indent=1))


def report(result: Result, spent: Spent) -> int:
    """Print one reader's line and what it broke; the exit code it asks for."""
    print(f"  {result.target:26}{result.runs:10} inputs{result.cpu_s:8.0f} s CPU", end="")
    print(f"{result.covered:8} edges{spent.seconds[result.target]:8.0f} s CPU in all", end="", flush=True)
    print(f"{len(result.findings):6} found" if result.findings else "")
    for path in result.findings:
        print(f"    {Path(sys.executable)} -m fuzz.replay {result.target} {path}", flush=True)
    if result.findings:
        return 1
    if result.log:
        print(f"    it ended before its time:\n{result.log}", file=sys.stderr)
        return 2
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    """Write the seeds, fuzz, judge."""
    parser = argparse.ArgumentParser(description="Fuzz the readers with atheris.")
    parser.add_argument(
        "--seconds", type=int, default=60, metavar="S", help="for each reader at a time, by the clock"
    )
    parser.add_argument(
        "--until",
        type=int,
        default=0,
        metavar="S",
        help="take turns until each reader has had S s of CPU time",
    )
    parser.add_argument("--target", default="", metavar="NAME,…", help="these readers alone")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="at a time")
    parser.add_argument("--folder", type=Path, default=FOLDER, metavar="DIR", help="corpus and findings")
    parser.add_argument("--samples", type=Path, metavar="DIR", help="more files to start from")
    arguments = parser.parse_args(argv)
    wanted = tuple(filter(None, arguments.target.split(","))) or targets()
    unknown = sorted(set(wanted) - set(targets()))
    if unknown or arguments.seconds < 1 or arguments.jobs < 1:
        parser.error(f"no reader is called {', '.join(unknown)}" if unknown else "expected numbers from 1 on")
    if importlib.util.find_spec("atheris") is None:
        parser.error("atheris is not installed; `make fuzz` installs it where it has a wheel")
    start = time.perf_counter()
    folder: Path = arguments.folder
    write_seeds(folder / "corpus")
    if arguments.samples is not None:
        write_samples(arguments.samples, folder / "corpus")
    print(f"{len(wanted)} readers, {arguments.seconds} s each, {arguments.jobs} at a time", flush=True)
    spent = Spent(folder)

    def turn(name: str) -> int:
        result = fuzz(name, folder, arguments.seconds)
        spent.add(result)
        return report(result, spent)

    codes: dict[str, int] = {}
    waiting = tuple(sorted(wanted, key=lambda name: spent.seconds.get(name, 0.0)))
    with ThreadPoolExecutor(arguments.jobs) as pool:
        while waiting:
            for name, code in zip(waiting, pool.map(turn, waiting), strict=True):
                codes[name] = max(code, codes.get(name, 0))
            # A fuzzer that could not run would not be given up otherwise.
            waiting = tuple(
                name for name in waiting if codes[name] < 2 and spent.seconds.get(name, 0.0) < arguments.until
            )
    print(f"in {time.perf_counter() - start:.0f} s")
    return 1 if 1 in codes.values() else max(codes.values())


if __name__ == "__main__":
    sys.exit(main())
