"""What a command costs before it does anything, beside a Python that only imports what it cannot do without.

    python -m benchmarks.startup [--quick]

The unavoidable imports of a command are listed here: of what it loads, the libraries that do its work. Compiled modules
are there already; a first run compiles them.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

from benchmarks.corpus import write_corpus
from benchmarks.table import compared, in_turns, machine

XML = """<?xml version="1.0" encoding="UTF-8"?>
<calibration><projection>frame</projection><width>5472</width><height>3648</height>
<f>3657.6</f><cx>3.1</cx><cy>-8.2</cy><k1>-0.0102</k1></calibration>
"""
COMMANDS = {
    "--version": (["--version"], "pass", None),
    "--help": (["--help"], "pass", None),
    "catalogue M3T": (["catalogue", "M3T"], "import msgspec, yaml, rich.console", 1.3),
    "inspect one.xml": (
        ["inspect", "one.xml"],
        "import msgspec, yaml, rich.console, numpy, lxml.etree, importlib.metadata",
        1.3,
    ),
    "extract of two images": (
        ["extract", "flight", "--recursive", "--output-matrix", "K.npy"],
        "import numpy, lxml.etree, msgspec, rich.console",
        2.5,
    ),
}
"""By command: its arguments, the program that no way of writing it could do without, and how many times its cost."""
LEAN = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
"""As the command sets it for itself: to start OpenBLAS's threads takes a quarter of what the libraries take."""


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="What commands cost before they do anything.")
    parser.add_argument("--quick", action="store_true", help="fewer repetitions")
    repeats = 7 if parser.parse_args().quick else 21
    print(machine())
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "one.xml").write_text(XML, encoding="utf-8")
        write_corpus(folder / "flight", 2)

        def run(*arguments: str) -> None:
            command = [sys.executable, *arguments]
            subprocess.run(
                command, cwd=folder, env=LEAN, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, check=True
            )

        for what, (arguments, program, most) in COMMANDS.items():
            times = in_turns(
                {"ours": partial(run, "-m", "calibrary", *arguments), "peer": partial(run, "-c", program)},
                repeats,
            )
            ours, bare = ([cost.cpu_s for cost in times[who]] for who in ("ours", "peer"))
            compared(f"calibrary {what}", ours, bare, scale=1e3, unit="ms", name=program, most=most)


if __name__ == "__main__":
    main()
