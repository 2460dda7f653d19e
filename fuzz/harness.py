"""One reader under libFuzzer, through atheris.

    python -m fuzz.harness TARGET FINDINGS [libFuzzer's flags and corpora]

It does not stop at what it finds. The smallest input for every place that raises, and the slowest one past two
seconds, are kept in FINDINGS; ``run.py`` starts this for every reader and judges them by ``replay.py``, without
the instrumentation that makes everything slower here. The CPU time spent since the first input and the number of
inputs are in FINDINGS.tally, renewed about once a second, because libFuzzer may end the process at any moment.
"""

from __future__ import annotations

import sys
import time
import traceback
import warnings
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["calibrary"]):
    from fuzz.target import MAX_SECONDS, Target, target_named, targets

    targets()  # loads the formats' modules, which nothing imports before it is asked for


class Watched:
    """A target whose findings are written down."""

    def __init__(self, target: Target, findings: Path) -> None:
        self.target = target
        self.findings = findings
        self.smallest: dict[str, int] = {}
        self.slowest = MAX_SECONDS
        self.runs = 0
        self.began = self.tallied = time.process_time()

    def __call__(self, data: bytes) -> None:
        """Feed the target once."""
        start = time.process_time()
        try:
            self.target(data)
        except Exception as error:  # noqa: BLE001  to see all of them is what this is for
            self.keep(_place(error), data)
        now = time.process_time()
        if now - start > self.slowest:
            self.slowest = now - start
            (self.findings / "slow").write_bytes(data)
        self.runs += 1
        if now - self.tallied > 1:
            self.tallied = now
            self.findings.with_suffix(".tally").write_text(f"{now - self.began:.1f} {self.runs}")

    def keep(self, place: str, data: bytes) -> None:
        """Write down the input, if it is the smallest one that fails there."""
        if len(data) < self.smallest.get(place, sys.maxsize):
            self.smallest[place] = len(data)
            (self.findings / place).write_bytes(data)


def _place(error: Exception) -> str:
    """The error's kind and where in our own code it came from, as a file's name."""
    frames = [
        frame for frame in traceback.extract_tb(error.__traceback__) if "calibrary" in frame.filename
    ] or traceback.extract_tb(error.__traceback__)
    return f"{type(error).__name__}-{Path(frames[-1].filename).stem}-{frames[-1].lineno}"


def main() -> None:
    """Fuzz until libFuzzer's flags say that it is enough."""
    name, findings, *flags = sys.argv[1:]
    target = target_named(name)
    warnings.simplefilter("error")
    atheris.Setup([sys.argv[0], *flags], Watched(target, Path(findings)))
    atheris.Fuzz()


if __name__ == "__main__":
    main()
