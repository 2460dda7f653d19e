"""``registry publish``: what it prints, and its exit codes."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.registry.direct import put
from tests.cli.registry.fleets import commit_of, printed, run
from tests.registry.entries import an_entry


def test_what_was_published_is_one_line_or_one_document(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, an_entry())
    code, out, _ = run(capsys, "publish", tmp_path / "out")
    assert code == 0
    assert (
        f"1 entry in 1 camera file of commit {commit_of(fleet)[:12]}, not signed (--sign KEY); 3 files written"
        in " ".join(out.split())
    )
    document = printed(capsys, "registry-publish-1", "publish", tmp_path / "out")
    assert (document["written"], document["unchanged"], document["signed_by"]) == (0, 3, None)


def test_what_cannot_be_published_is_one_line_with_its_exit_code(
    fleet: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(fleet, an_entry(serial="0V2LG3H0"))
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters/a.txt").write_text("dear")
    for out, code, expected in (
        ("out", 1, "serial number is not hashed"),
        ("letters", 3, "name another folder"),
    ):
        got, _, said = run(capsys, "publish", tmp_path / out)
        assert (got, expected in said, said.count("\n")) == (code, True, 1)
