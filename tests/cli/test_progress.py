"""The bar of long work: drawn on a terminal after a second, and nowhere else."""

from __future__ import annotations

import io
import sys

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


def test_a_question_has_the_screen_for_itself_and_work_that_goes_on_draws_again(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(progress, "SHOWN_AFTER_S", 0.0)
    out = io.StringIO()
    with Bar(Console(file=out, force_terminal=True, width=80), "looking at") as bar:
        bar(1, 2, "files")
        bar.stop()
        sys.stderr.write("whose K is it? [unit/model] ")
        before = out.getvalue()
        bar(2, 2, "files")
    assert capsys.readouterr().err == "whose K is it? [unit/model] "
    assert "looking at files" in out.getvalue().removeprefix(before)


def test_long_work_draws_one_on_a_terminal_only(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(progress, "SHOWN_AFTER_S", 0.0)
    assert "checking entries" in drawn(terminal=True)
    assert drawn(terminal=False) == ""
