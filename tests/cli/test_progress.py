"""The bar of long work: drawn on a terminal after a second, and nowhere else."""

from __future__ import annotations

import io

import pytest
from rich.console import Console

from calibrary.cli import progress
from calibrary.cli.progress import Bar


def drawn(*, terminal: bool) -> str:
    """What a bar writes while five things are done."""
    out = io.StringIO()
    with Bar(Console(file=out, force_terminal=terminal, width=80), "checking") as bar:
        for done in range(1, 6):
            bar(done, 5, "entries")
    return out.getvalue()


def test_quick_work_draws_none() -> None:
    assert drawn(terminal=True) == ""


def test_long_work_draws_one_on_a_terminal_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "SHOWN_AFTER_S", 0.0)
    assert "checking entries" in drawn(terminal=True)
    assert drawn(terminal=False) == ""
