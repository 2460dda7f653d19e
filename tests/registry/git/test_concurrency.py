"""Many writers, killed at any moment: nothing acknowledged is lost, nothing is half there."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from calibrary.registry.git.repository import Repository
from tests.registry.git.repositories import ENTRY, bare, git, made, nobodys_git, now, put
from tests.thorough import examples

__all__ = ["bare", "made", "nobodys_git"]

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="the writers are forked")

ADD = """
import os, sys
from pathlib import Path
import git
from calibrary.registry.git.repository import Repository
from calibrary.registry.git.writing import FileChange, write

path, processes, each = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
for writer in range(processes):
    if os.fork() == 0:
        repo = Repository.open(path, durable=False)
        for number in range(each):
            change = FileChange(path=f"cameras/make/w{writer}/n{number}.yaml", data=f"{writer} {number}\\n".encode())
            write(repo, [change], f"add {writer} {number}\\n")
        os._exit(0)
sys.exit(max(os.waitstatus_to_exitcode(os.wait()[1]) for _ in range(processes)))
"""

COUNT = """
import os, sys
from pathlib import Path
import git
from calibrary.registry.git.errors import FileConflictError
from calibrary.registry.git.repository import Repository
from calibrary.registry.git.writing import FileChange, write

path, entry, processes, each = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
for writer in range(processes):
    if os.fork() == 0:
        repo = Repository.open(path, durable=False)
        done = 0
        while done < each:
            blob = repo.read(repo.tip(), entry)
            change = FileChange(path=entry, data=b"%d\\n" % (int(blob.data) + 1), base=blob.oid)
            try:
                write(repo, [change], "count\\n")
                done += 1
            except FileConflictError:
                pass
        os._exit(0)
sys.exit(max(os.waitstatus_to_exitcode(os.wait()[1]) for _ in range(processes)))
"""

KILL = """
import os, random, signal, sys, time
from pathlib import Path
import git
from calibrary.registry.git.errors import FileConflictError
from calibrary.registry.git.repository import Repository
from calibrary.registry.git.writing import FileChange, write

path, journal, kills, writers = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), int(sys.argv[4])

repo = Repository.open(path, durable=False, stale_lock_s=0.1)

def work():
    os.setpgid(0, 0)
    acknowledged = os.open(journal, os.O_WRONLY | os.O_APPEND | os.O_CREAT)
    while True:
        name = f"cameras/make/model/shared-{random.randrange(6)}.yaml"
        blob = repo.read(repo.tip(), name)
        data = b"- %d\\n" % random.getrandbits(64) * 20
        try:
            written = write(repo, [FileChange(path=name, data=data, base=blob.oid if blob else None)], "work\\n")
        except FileConflictError:
            continue
        os.write(acknowledged, f"{written.commit}\\n".encode())

def start():
    pid = os.fork()
    if pid == 0:
        try:
            work()
        finally:
            os._exit(9)
    return pid

def size_of(name):
    return os.path.getsize(name) if os.path.exists(name) else 0

random.seed(7)
running = [start() for _ in range(writers)]
while kills:
    # However slow the machine is, work is done between the kills.
    seen, deadline = size_of(journal), time.monotonic() + 10.0
    while kills % 4 == 0 and size_of(journal) == seen and time.monotonic() < deadline:
        time.sleep(0.001)
    time.sleep(random.uniform(0.0, 0.04))
    victim = running.pop(random.randrange(len(running)))
    try:
        os.killpg(victim, signal.SIGKILL)
    except ProcessLookupError:
        os.kill(victim, signal.SIGKILL)
    code = os.waitstatus_to_exitcode(os.waitpid(victim, 0)[1])
    assert code == -9, code
    kills -= 1
    running.append(start())
for pid in running:
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
"""


def run(code: str, *arguments: object) -> None:
    command = [sys.executable, "-c", code, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.thorough
def test_eight_processes_that_add_twenty_entries_each_lose_none(bare: Repository) -> None:
    run(ADD, bare.path, 8, 20)
    tip = bare.tip()
    assert tip is not None
    files = bare.listing(tip, "cameras/make")
    wanted = {f"cameras/make/w{writer}/n{number}.yaml" for writer in range(8) for number in range(20)}
    assert set(files) == wanted
    contents = dict(zip(files, bare.objects([*files.values()]), strict=True))
    assert contents["cameras/make/w3/n7.yaml"] == b"3 7\n"
    assert git(bare.path, "rev-list", "--count", "main") == "161"


@pytest.mark.thorough
def test_processes_that_count_up_one_entry_never_overwrite_each_other(bare: Repository) -> None:
    put(bare, {ENTRY: b"0\n"})
    run(COUNT, bare.path, ENTRY, 4, 12)
    assert now(bare) == b"48\n"
    assert git(bare.path, "rev-list", "--count", "main") == "50"


@pytest.mark.thorough
def test_writers_killed_many_times_lose_nothing_they_acknowledged(bare: Repository, tmp_path: Path) -> None:
    printed = tmp_path / "acknowledged"
    run(KILL, bare.path, printed, examples(60, 200), 4)
    acknowledged = printed.read_text().split()
    assert len(acknowledged) >= 15
    assert set(acknowledged) <= set(git(bare.path, "rev-list", "main").split())
    git(bare.path, "fsck", "--strict", "--connectivity-only")
    tip = bare.tip()
    assert tip is not None
    for data in bare.objects([*bare.listing(tip, "cameras/make").values()]):
        lines = data.split(b"\n")
        assert len(lines) == 21
        assert len(set(lines[:-1])) == 1
    put(Repository.open(bare.path, stale_lock_s=0.3), {ENTRY: b"after all\n"})
    assert now(bare) == b"after all\n"
