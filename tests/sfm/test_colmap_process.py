"""Work in a process of its own: its answer, its errors, what it writes, and its end."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from calibrary.errors import CalibrationError, InputError
from calibrary.progress import Progress
from calibrary.sfm.colmap_process import run_apart
from tests.house.project import ROOT


@pytest.fixture(autouse=True)
def the_tests_can_be_imported(monkeypatch: pytest.MonkeyPatch) -> None:
    """By the other process, which is handed our sys.path."""
    monkeypatch.syspath_prepend(ROOT)


def halve(report: Progress, number: int) -> float:
    """Work that answers, after it has reported."""
    report(1, 2, "halves")
    os.write(2, b"I20260101 00:00:00.000000 123 sift.cc:722] noise\n")
    print("noise")  # noqa: T201  as a C++ library may
    return number / 2


def refuse(report: Progress, name: str) -> None:
    del report
    raise InputError("is empty", source=name)


def crash(report: Progress) -> None:
    del report
    os.write(2, b"F20260101 00:00:00.000000 123 sift.cc:722] Check failed: no memory\n\n")
    os._exit(6)


def die_once(report: Progress, file: Path) -> str:
    report(1, 2, "tries")
    if file.exists():
        return "done"
    file.touch()
    os.kill(os.getpid(), signal.SIGKILL)
    return "never"


def log_folder(report: Progress) -> str:
    """Where glog writes a file of its own, whatever else is said on standard error."""
    del report
    return os.environ["GLOG_log_dir"]  # noqa: SIM112  glog's spelling


def write_for_ever(report: Progress, file: Path) -> None:
    file.write_text(str(os.getpid()))
    while True:
        report(0, 1, "turns")
        time.sleep(0.01)


def test_the_answer_and_the_progress_come_back_and_the_noise_does_not(
    capfd: pytest.CaptureFixture[str],
) -> None:
    seen: list[tuple[int, int, str]] = []
    assert run_apart(halve, lambda *step: seen.append(step), 5) == 2.5
    assert seen == [(1, 2, "halves")]
    assert capfd.readouterr() == ("", "")


def test_its_logs_go_with_it() -> None:
    folder = Path(run_apart(log_folder, None))
    assert folder.name.startswith("calibrary-")
    assert not folder.exists()


def test_an_error_of_ours_stays_what_it_is() -> None:
    with pytest.raises(InputError, match="is empty") as caught:
        run_apart(refuse, None, "a.jpg")
    assert caught.value.source == "a.jpg"


def test_a_process_that_dies_leaves_its_last_words() -> None:
    with pytest.raises(
        CalibrationError, match=r"\(status 6\) 2 times; last it wrote: Check failed: no memory$"
    ):
        run_apart(crash, None)


def test_a_process_that_dies_is_started_once_more_and_that_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    assert run_apart(die_once, None, tmp_path / "died") == "done"
    assert caplog.messages == ["COLMAP's process was ended by SIGKILL; it is started once more"]


def test_a_script_without_a_guard_may_ask_for_it(tmp_path: Path) -> None:
    """As a library's user writes one: its main module is not run a second time."""
    script = tmp_path / "script.py"
    script.write_text(
        "from calibrary.sfm.colmap_process import run_apart\n"
        "from tests.sfm.test_colmap_process import halve\n"
        "print(run_apart(halve, None, 8))\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    ran = subprocess.run(
        [sys.executable, str(script)], env=environment, capture_output=True, text=True, check=False
    )
    assert (ran.stdout, ran.stderr) == ("4.0\n", "")


def test_an_interrupt_ends_the_process(tmp_path: Path) -> None:
    file = tmp_path / "pid"

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_apart(write_for_ever, interrupt, file)
    with pytest.raises(ProcessLookupError):
        os.kill(int(file.read_text()), 0)
