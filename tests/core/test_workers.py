"""Work that is spread over processes, and what becomes of it when one of them is killed."""

from __future__ import annotations

import math
import multiprocessing.process
import os
import subprocess
import sys
import threading
import time
from itertools import count

import pytest

from calibrary import workers
from calibrary.workers import mapped, mapped_on

WORK = """
import os, sys
def work(item):
    if item in {3, 90}:
        os.kill(os.getpid(), 9)
    if item == 50 and not os.path.exists(sys.argv[1]):
        open(sys.argv[1], "w").close()
        os.kill(os.getpid(), 9)
    return item * item
if __name__ == "__main__":
    from calibrary.workers import mapped_on
    for item, result in mapped_on(work, iter(range(120)), 2, preload=[]):
        print(item, result)
"""


SENDING = """
import time
from calibrary.workers import mapped
for pause in range(6):
    results = mapped(bytes, [40_000_000] * 4, 2, preload=[], does="makes bytes")
    next(results)
    time.sleep(0.004 * pause)
    results.close()
"""


def test_results_come_in_the_order_of_the_items() -> None:
    assert [*mapped(abs, [-3, 2, -1], 2, preload=[], does="counts")] == [3, 2, 1]
    assert [*mapped_on(abs, iter([-3, 2, -1]), 2, preload=[])] == [(-3, 3), (2, 2), (-1, 1)]


def test_few_items_are_taken_before_their_turn() -> None:
    items = count()
    results = mapped_on(abs, items, 2, preload=[])
    assert next(results) == (0, 0)
    del results
    assert next(items) <= workers.AHEAD * 2 + 1


def test_a_map_that_ends_early_ends_in_silence(monkeypatch: pytest.MonkeyPatch) -> None:
    """The pool's thread sees its processes die before it is told to stop, as on a busy machine."""

    def slowly(process: multiprocessing.process.BaseProcess) -> None:
        kill(process)
        time.sleep(0.05)

    kill = multiprocessing.process.BaseProcess.kill
    said: list[object] = []
    monkeypatch.setattr(multiprocessing.process.BaseProcess, "kill", slowly)
    monkeypatch.setattr(threading, "excepthook", said.append)
    for _ in range(4):
        results = mapped(time.sleep, [0.05] * 200, 2, preload=[], does="waits")
        next(results)
        results.close()  # type: ignore[attr-defined]  # an Iterator that is a generator
    assert said == []


def test_processes_killed_as_they_send_their_results_are_not_waited_for() -> None:
    """Half a result is in the pipe: its reader must not wait for the other half."""
    subprocess.run([sys.executable, "-c", SENDING], check=True, timeout=120)


def test_what_a_killed_process_did_is_done_again_and_only_what_kills_twice_is_lost(
    tmp_path: object,
) -> None:
    script = f"{tmp_path}/work.py"
    with open(script, "w", encoding="utf-8") as file:  # noqa: PTH123  as the script itself does
        file.write(WORK)
    ran = subprocess.run(
        [sys.executable, script, f"{tmp_path}/once"],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
        env=os.environ,
    )
    wanted = [f"{item} {None if item in {3, 90} else item * item}" for item in range(120)]
    assert ran.stdout.split("\n")[:-1] == wanted


def test_an_error_in_a_process_is_raised_here() -> None:
    with pytest.raises(ValueError, match="math"):
        list(mapped_on(math.sqrt, [-1.0], 2, preload=[]))
