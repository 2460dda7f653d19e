"""No command enters more files, or calls deeper, than it does: who adds to it finds room, or takes away elsewhere."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.house.project import ROOT
from tests.registry.git.repositories import seclude


@pytest.mark.thorough
def test_no_command_grows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seclude(monkeypatch, tmp_path)
    command = [sys.executable, "-m", "benchmarks.calls"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    lines = done.stdout.splitlines()
    assert len(lines) == 10, done.stderr
    grown = [line for line in lines if not line.endswith("| yes")]
    assert not grown, "python -m benchmarks.calls --chain COMMAND shows its calls"
