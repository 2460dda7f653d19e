"""Ctrl-C and SIGTERM: 130 and 143, one line, no traceback, nothing half written, and no process left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from calibrary.cli.main import main
from tests.jobs.extract.fleet import P4R, picture
from tests.thorough import every

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks at processes through /proc")

SIGNALS = {signal.SIGINT: 130, signal.SIGTERM: 143}
CALIBRARY = ("-m", "calibrary")
WAIT_S = 120.0
"""As long as a busy machine may take; a quick one waits for nothing."""

Marker = Callable[["subprocess.Popen[str]"], bool]


@pytest.fixture(scope="module")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """So many images that processes share the work, and for so long that none meets its end in these tests."""
    folder = tmp_path_factory.mktemp("signals") / "flight"
    one = picture(folder / "0000.jpg", (72, 48), **P4R)
    for number in range(1, 6000):
        (folder / f"{number:04}.jpg").hardlink_to(one)
    return folder


def members(group: int) -> list[int]:
    """The processes of a group that are alive."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[2]) == group and fields[0] != "Z":
            found.append(int(stat.parent.name))
    return found


HELD = """
import runpy, sys, time

module = sys.argv.pop()

class Hold:
    def find_spec(self, name, path, target=None):
        if name == module:
            print(name, file=sys.stderr, flush=True)
            time.sleep(600)

sys.meta_path.insert(0, Hold())
runpy.run_module("calibrary", run_name="__main__", alter_sys=True)
"""
"""Runs the program, which tells that it is about to import the module named last, and goes no further."""


def held_at(module: str) -> Marker:
    """The program is importing a module."""

    def reached(process: subprocess.Popen[str]) -> bool:
        assert process.stderr is not None
        return process.stderr.readline() == f"{module}\n"

    return reached


def processes(count: int) -> Marker:
    """So many processes are at work."""

    def reached(process: subprocess.Popen[str]) -> bool:
        ends = time.monotonic() + WAIT_S
        while process.poll() is None and time.monotonic() < ends:
            if len(members(process.pid)) >= count:
                return True
            time.sleep(0.002)
        return False

    return reached


def at_work(process: subprocess.Popen[str]) -> bool:
    """The program has spent far more CPU time than its imports need."""
    ends = time.monotonic() + WAIT_S
    while process.poll() is None and time.monotonic() < ends:
        ticks = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()[11]
        if int(ticks) > 3 * os.sysconf("SC_CLK_TCK"):
            return True
        time.sleep(0.01)
    return False


def interrupted(
    command: list[str], folder: Path, number: signal.Signals, marker: Marker, *, group: bool
) -> tuple[int, str]:
    """How Python ends that is signalled at a moment, and what it says."""
    with subprocess.Popen(
        [sys.executable, *command],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        assert marker(process)
        (os.killpg if group else os.kill)(process.pid, number)
        _, printed = process.communicate(timeout=WAIT_S)
    assert gone(process.pid)
    return process.returncode, printed


def gone(group: int) -> bool:
    ends = time.monotonic() + WAIT_S
    while members(group) and time.monotonic() < ends:
        time.sleep(0.01)
    return members(group) == []


@pytest.mark.parametrize("number", SIGNALS)
@pytest.mark.parametrize(
    "module",
    ["calibrary.cli.commands", "calibrary.jobs.extract.run"],
)
def test_start_up_is_interrupted_in_order(
    tmp_path: Path, flight: Path, number: signal.Signals, module: str
) -> None:
    command = ["extract", str(flight), "--workers", "1", "--output-matrix", "out/K_matrix.npy"]
    held = ["-c", HELD, *command, module]
    code, printed = interrupted(held, tmp_path, number, held_at(module), group=False)
    assert (code, printed) == (SIGNALS[number], "calibrary: interrupted; nothing was half written\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("number", every(2, SIGNALS))
@pytest.mark.parametrize("count", every(2, [2, 5]))
def test_worker_processes_end_with_the_command_and_say_nothing(
    tmp_path: Path, flight: Path, number: signal.Signals, count: int
) -> None:
    """A terminal sends Ctrl-C to every process of the command; SIGTERM goes to the command alone."""
    command = [*CALIBRARY, "extract", str(flight), "--workers", "3", "--output-matrix", "out/K_matrix.npy"]
    group = number is signal.SIGINT
    code, printed = interrupted(command, tmp_path, number, processes(count), group=group)
    assert (code, printed) == (SIGNALS[number], "calibrary: interrupted; nothing was half written\n")
    assert list(tmp_path.iterdir()) == []


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("board") / "frames"
    board = ("--board", "checkerboard:9x6", "--square-mm", "40")
    assert main(["calibrate", "synth", str(out), *board, "--frames", "4"]) == 0
    one = next(out.glob("*.jpg"))
    for number in range(400):
        (out / f"again_{number}.jpg").hardlink_to(one)
    return out


@pytest.mark.parametrize("number", every(2, SIGNALS))
def test_a_calibration_leaves_nothing_behind(tmp_path: Path, frames: Path, number: signal.Signals) -> None:
    command = [
        *CALIBRARY,
        "calibrate",
        str(frames),
        "--square-mm",
        "40",
        "--workers",
        "2",
        "--html",
        "r.html",
    ]
    group = number is signal.SIGINT
    code, printed = interrupted(command, tmp_path, number, processes(4), group=group)
    assert (code, printed) == (SIGNALS[number], "calibrary: interrupted; nothing was half written\n")
    assert list(tmp_path.iterdir()) == []
    assert len([*frames.iterdir()]) == 405


@pytest.mark.thorough
def test_a_watch_that_is_looking_at_frames_stops_in_silence(tmp_path: Path, frames: Path) -> None:
    command = [*CALIBRARY, "calibrate", "watch", str(frames), "--board", "checkerboard:9x6"]
    assert interrupted(command, tmp_path, signal.SIGINT, at_work, group=False) == (1, "")


@pytest.mark.thorough
def test_a_second_ctrl_c_does_not_disturb_the_first(tmp_path: Path, flight: Path) -> None:
    def twice(process: subprocess.Popen[str]) -> bool:
        if not processes(4)(process):
            return False
        os.killpg(process.pid, signal.SIGINT)
        return process.poll() is None

    command = [*CALIBRARY, "extract", str(flight), "--workers", "3"]
    code, printed = interrupted(command, tmp_path, signal.SIGINT, twice, group=True)
    assert (code, printed) == (130, "calibrary: interrupted; nothing was half written\n")
    assert list(tmp_path.iterdir()) == []


STARTED = """
import os, subprocess, sys, time

environment = {**os.environ, "CALIBRARY_PARENT": str(os.getpid())}
watch = [sys.executable, "-m", "calibrary", "calibrate", "watch", sys.argv[1], "--board", "checkerboard:9x6"]
one = subprocess.Popen(watch, env=environment, start_new_session=True, stderr=subprocess.DEVNULL)
print(one.pid, flush=True)
time.sleep(600)
"""


def test_a_command_ends_with_the_program_that_it_works_for(tmp_path: Path) -> None:
    starter = subprocess.Popen([sys.executable, "-c", STARTED, tmp_path], stdout=subprocess.PIPE, text=True)
    with starter as desk:
        assert desk.stdout is not None
        group = int(desk.stdout.readline())
        assert members(group)
        desk.kill()
    until = time.monotonic() + WAIT_S
    while members(group) and time.monotonic() < until:
        time.sleep(0.1)
    assert members(group) == []
