"""How many of our files a command enters, and how deep its calls go: what a reader has to follow.

    python -m benchmarks.calls [--chain COMMAND]

Counted are functions of this project that run; those of libraries, and what an import runs, are left out, and so are
comprehensions and lambdas, which some versions of Python call as functions. Each command runs in a process of its own,
so that nothing is remembered from another. ``--chain`` prints the deepest calls of one.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from types import FrameType
from typing import NamedTuple

from benchmarks.table import at_most
from calibrary.cli.main import main as calibrary
from calibrary.registry.init import init
from tests.cli.desk import furnish

ROOT = Path(__file__).resolve().parents[1]
OURS = tuple(f"{ROOT / folder}{os.sep}" for folder in ("src", "calib", "parsers", "registry"))

COMMANDS = {
    "registry add": "registry add camera.xml --make DJI --model FC6310R --registry fleet --yes",
    "extract": "extract survey --output-matrix K_matrix.npy --workers 1 --registry none",
    "convert": "convert camera.xml camera.yml --to opencv_storage",
    "diff": "diff camera.xml later.xml",
    "calibrate": "calibrate --from corners.json --out lens.yml --to opencv_storage",
}
"""What is typed in a folder that :func:`furnished` prepares."""


class Calls(NamedTuple):
    """What a command enters.

    Attributes:
        files: files of ours with a function that ran.
        deepest: most functions of ours that were running at once.
        chain: those functions, as file:name.
    """

    files: int
    deepest: int
    chain: tuple[str, ...] = ()


MOST = {
    # With the files in which all that states a K is weighed, and the one description that every medium shows.
    "registry add": Calls(files=70, deepest=18),
    "extract": Calls(files=81, deepest=21),
    "convert": Calls(files=47, deepest=21),
    "diff": Calls(files=57, deepest=16),
    "calibrate": Calls(files=83, deepest=21),
}
"""What no command enters more of (``tests/house/test_calls.py``); it goes down with the code, up with a reason."""


def furnished(folder: Path) -> None:
    """Prepare a folder in which the commands can be typed."""
    furnish(folder)
    init(folder / "fleet")


def counted(name: str, folder: Path) -> Calls:
    """Run a command in a process of its own, and count."""
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks.calls", "--in", str(folder), "--chain", name],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    said, *chain = done.stdout.splitlines()
    files, deepest = map(int, said.split())
    return Calls(files, deepest, tuple(chain))


class _Tracer:
    """Counts calls of our functions, as :func:`sys.setprofile` reports them."""

    def __init__(self) -> None:
        self.files: set[str] = set()
        self.deepest: tuple[str, ...] = ()
        self._running: list[str] = []
        self._importing = 0
        self._ours: dict[str, str | None] = {}

    def __call__(self, frame: FrameType, event: str, _: object) -> None:
        name = frame.f_code.co_name
        if event not in {"call", "return"} or (name.startswith("<") and name != "<module>"):
            return
        step = 1 if event == "call" else -1
        if name == "<module>":
            self._importing += step
        elif not self._importing and (file := self._file(frame.f_code.co_filename)) is not None:
            if step < 0:
                self._running.pop()
                return
            self.files.add(file)
            self._running.append(f"{file}:{name}")
            if len(self._running) > len(self.deepest):
                self.deepest = tuple(self._running)

    def _file(self, path: str) -> str | None:
        """Path of our file in the repository; None for those of others."""
        if path not in self._ours:
            real = os.path.realpath(path)
            self._ours[path] = str(Path(real).relative_to(ROOT)) if real.startswith(OURS) else None
        return self._ours[path]


def _trace(name: str, folder: Path) -> None:
    """Run a command here, and print what it entered."""
    os.chdir(folder)
    tracer, said = _Tracer(), os.dup(1)
    os.dup2(2, 1)  # what the command prints is not what is asked for
    sys.setprofile(tracer)
    try:
        code = calibrary(COMMANDS[name].split())
    finally:
        sys.setprofile(None)
        sys.stdout.flush()
        os.dup2(said, 1)
    if code > 1:
        raise SystemExit(code)
    print(f"{len(tracer.files)} {len(tracer.deepest)}", *tracer.deepest, sep="\n")


def main() -> None:
    """Count and print."""
    parser = argparse.ArgumentParser(
        description="How many files a command enters, and how deep its calls go."
    )
    parser.add_argument("--chain", choices=COMMANDS, help="the deepest calls of this command")
    parser.add_argument("--in", dest="folder", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.folder is not None:
        _trace(given.chain, given.folder)
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        furnished(folder)
        for command, most in MOST.items():
            if given.chain in {None, command}:
                found = counted(command, folder)
                at_most(f"calibrary {command}: files entered", found.files, "", most.files)
                at_most(f"calibrary {command}: depth of calls", found.deepest, "", most.deepest)
                if given.chain is not None:
                    print(*found.chain, sep="\n")


if __name__ == "__main__":
    main()
