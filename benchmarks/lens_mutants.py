"""How many files lose their lens without a word if a key or value that states it is changed.

    python -m benchmarks.lens_mutants [--count 1000] [--seed N] [FILE …]

Without files, the small files of all formats are changed (``tests/parsers/mutants.py``). Prints every loss, and counts
what became of the mutants: refused, read the same, read with the distortion unknown.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))

from tests.parsers.mutants import LOST, mutated


def main() -> None:
    """Change the files, and print what became of them."""
    command = argparse.ArgumentParser(prog="python -m benchmarks.lens_mutants")
    command.add_argument("files", nargs="*", type=Path)
    command.add_argument("--count", type=int, default=1000)
    command.add_argument("--seed", type=int, default=1)
    given = command.parse_args()
    counted: Counter[str] = Counter()
    for name, what, outcome in mutated(given.count, seed=given.seed, paths=given.files):
        counted[outcome] += 1
        if outcome == LOST:
            print(f"{LOST} {name}: {what}")
    print(f"{given.count} mutants: {', '.join(f'{count} {what}' for what, count in counted.most_common())}")
    sys.exit(counted[LOST] > 0)


if __name__ == "__main__":
    main()
