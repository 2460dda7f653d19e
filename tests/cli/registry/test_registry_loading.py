"""What the commands that only read a registry load: nothing of what changes one, reads files, or asks the web."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.registry.direct import put
from tests.registry.entries import an_entry
from tests.thorough import every

CHANGES = {
    "calibrary.jobs.fleet.changes",
    "calibrary.registry.proposals",
    "calibrary.registry.sync",
    "calibrary.registry.git.remotes",
}
READERS = {"calibrary.parsers", "calibrary.jobs.fleet.adding", "PIL", "exifread", "lxml"}
WEB = {"http.client", "ssl", "calibrary.registry.published.read"}
DRAWS = {"matplotlib", "jinja2", "cv2", "scipy", "jsonschema"}
JUDGES = {"calibrary.catalogue", "calibrary.validation", "calibrary.registry.entry_checks"}


@pytest.mark.parametrize(
    ("command", "besides"),
    every(
        2,
        [
            (["list", "--where", "fx>1000", "--sort", "date"], JUDGES),
            (["list"], JUDGES),
            # What a solver may do with it is judged.
            (["show", "fc6310r"], JUDGES - {"calibrary.validation"}),
            (["log", "fc6310r"], JUDGES),
            (["status"], {"calibrary.catalogue", "calibrary.jobs.audit.report", "calibrary.pages.plots"}),
            (["check"], set()),
            (["lock", "--out", "calibrary.lock"], JUDGES),
            # It compares its answer with the catalogue's.
            (["resolve", "dji/fc6310r"], {"calibrary.registry.entry_checks"}),
        ],
    ),
    ids=lambda words: words[0] if isinstance(words, list) else "",
)
def test_a_command_that_reads_loads_no_more(
    fleet: Path, tmp_path: Path, command: list[str], besides: set[str]
) -> None:
    put(fleet, an_entry())
    code = (
        "import sys\nfrom calibrary.cli.main import main\n"
        f"code = main({['registry', *command, '--registry', str(fleet)]!r})\n"
        "print(code, *sys.modules, file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=tmp_path
    )
    status, *loaded = done.stderr.splitlines()[-1].split()
    assert status == "0"
    assert {*loaded} & (CHANGES | READERS | WEB | DRAWS | besides) == set()
    assert "git" not in loaded
    assert ("numpy" in loaded) is (command[0] in {"check", "resolve"})
