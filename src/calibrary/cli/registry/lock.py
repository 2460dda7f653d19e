"""``calibrary registry lock``: pin the entries that a run depends on."""

from __future__ import annotations

import argparse
from typing import Any

from calibrary.cli.registry import OfRegistry, entries
from calibrary.jobs.fleet import Fleet

DESCRIPTION = "Pin entries as they are now, so that a run can be repeated on the same ones."
EXAMPLES = """\
examples:
  calibrary registry lock                                every approved entry
  calibrary registry lock flight/                        the entries that apply to a flight's images
  calibrary registry lock dji/fc6310r sony/dsc-rx1rm2
  calibrary extract --image-dir flight/ --registry fleet --locked       later, with these only

Later runs read a registry in git at the pinned commit, and report what has changed since. They refuse a registry that
has lost that commit, and a plain folder in which a pinned entry has changed.
"""


class _Lock(OfRegistry):
    def exit_code(self, done: Any, arguments: argparse.Namespace) -> int:
        from calibrary.cli.console import note

        for sentence in done.unanswered:
            note(arguments).say(("note", "yellow"), f" {sentence}")
        return 0


def _said(lock: Any, arguments: argparse.Namespace) -> list[str]:
    at = f" at {lock.commit[:12]}" if lock.commit is not None else ""
    return [f"{arguments.out or 'calibrary.lock'}: {entries(len(lock.pins))} pinned{at}"]


COMMAND = _Lock(
    Fleet.lock,
    DESCRIPTION,
    EXAMPLES,
    positional={"what": "IMAGE_DIR|KEY"},
    at=True,
    used=lambda lock: [pin.path for pin in lock.pins],
    said=_said,
)
