"""Fuzz every reader, judge what is found, and say how to see it again.

    python -m fuzz.run [--seconds S] [--target NAME,NAME] [--jobs N] [--folder DIR]

In the project's folder; ``make fuzz`` does it. The corpus stays in the folder (build/fuzz) and grows from run to
run, as do the findings. Exit code 1 when there is a finding, 2 when a fuzzer could not run.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import re
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from fuzz.seeds import write_dictionary, write_seeds
from fuzz.target import MAX_GROWTH_MIB, targets

ROOT = Path(__file__).parents[1]
FOLDER = Path("build") / "fuzz"
LONGEST_INPUT = 16 * 1024
HANG_SECONDS = 20
"""libFuzzer ends an input that takes longer; whether two seconds are kept is for the replay to say."""
OWN_MIB = 512
"""What the fuzzer itself, the instrumented code and the corpus may hold, beside what an input may."""

_DONE = re.compile(r"Done (\d+) runs in (\d+) second")
_COVERED = re.compile(r"\bcov: (\d+)")
NICE = ("nice", "-n", "10") if os.name == "posix" else ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """What became of one reader.

    Attributes:
        target: its name.
        runs: how many inputs it was fed.
        covered: how many edges of the code they reached.
        findings: the inputs that break a promise, each confirmed without the fuzzer.
        log: the fuzzer's own words, where it ended before its time; empty otherwise.
    """

    target: str
    runs: int
    covered: int
    findings: tuple[Path, ...]
    log: str


def fuzz(target: str, folder: Path, seconds: int) -> Result:
    """Run one reader in a process of its own."""
    corpus, findings = folder / "corpus" / target, folder / "findings" / target
    words = folder / f"{target}.dict"
    corpus.mkdir(parents=True, exist_ok=True)
    findings.mkdir(parents=True, exist_ok=True)
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
    done = subprocess.run(
        command,
        cwd=ROOT,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
        timeout=seconds + 300,
    )
    said = done.stdout + done.stderr
    ended = _DONE.search(said)
    found = tuple(sorted(path for path in findings.iterdir() if breaks_a_promise(target, path)))
    covered = _COVERED.findall(said)
    return Result(
        target=target,
        runs=int(ended[1]) if ended else 0,
        covered=int(covered[-1]) if covered else 0,
        findings=found,
        log="" if ended and not done.returncode else said[-4000:],
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


def report(result: Result) -> int:
    """Print one reader's line and what it broke; the exit code it asks for."""
    print(f"  {result.target:26}{result.runs:10} runs{result.covered:8} edges", end="", flush=True)
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
    parser.add_argument("--seconds", type=int, default=60, metavar="S", help="for each reader")
    parser.add_argument("--target", default="", metavar="NAME,…", help="these readers alone")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="at a time")
    parser.add_argument("--folder", type=Path, default=FOLDER, metavar="DIR", help="corpus and findings")
    arguments = parser.parse_args(argv)
    wanted = tuple(filter(None, arguments.target.split(","))) or targets()
    unknown = sorted(set(wanted) - set(targets()))
    if unknown or arguments.seconds < 1 or arguments.jobs < 1:
        parser.error(f"no reader is called {', '.join(unknown)}" if unknown else "expected numbers from 1 on")
    if importlib.util.find_spec("atheris") is None:
        parser.error("atheris is not installed; `make fuzz` installs it where it has a wheel")
    start = time.perf_counter()
    write_seeds(arguments.folder / "corpus")
    print(f"{len(wanted)} readers, {arguments.seconds} s each, {arguments.jobs} at a time", flush=True)
    with ThreadPoolExecutor(arguments.jobs) as pool:
        results = pool.map(lambda name: fuzz(name, arguments.folder, arguments.seconds), wanted)
        codes = [report(result) for result in results]
    print(f"in {time.perf_counter() - start:.0f} s")
    return 1 if 1 in codes else max(codes)


if __name__ == "__main__":
    sys.exit(main())
