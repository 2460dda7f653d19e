"""``calibrary registry log``: show the revisions of an entry or of all."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from calibrary.cli.commands import print_json
from calibrary.cli.flags import call
from calibrary.cli.registry import OfRegistry, note_cut, opened
from calibrary.cli.tables import Column, fitted
from calibrary.jobs.fleet import Fleet

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rich.text import Text

    from calibrary.jobs.fleet import LoggedRevision

DESCRIPTION = "List the revisions of an entry with what changed in its K, or all commits."
EXAMPLES = """\
examples:
  calibrary registry log                     every commit
  calibrary registry log fc6310r             every revision of an entry, with what changed in K
  calibrary registry log fc6310r -n 5 --json
"""


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import out

    registry, screen = opened(arguments), out(arguments)
    found = call(registry.history, arguments)
    lines = (_of_all if arguments.key is None else _of_one)(found.revisions, screen.width)
    if arguments.json:
        print_json(found)
    else:
        screen.show(lines)
        note_cut(arguments, registry)
    return 0


OF_ONE = (
    Column(name="commit"),
    Column(name="date", rank=1),
    Column(name="what", rank=2),
    *(
        Column(name=f"{name} px", rank=3 + (name[0] == "c") * 2, right=True)
        for name in ("fx", "fy", "cx", "cy")
    ),
    Column(name="grade", rank=6),
    Column(name="firmware", rank=7),
    Column(name="by", rank=8),
    Column(name="reason", rank=4, wraps=True),
)
OF_ALL = (
    Column(name="commit"),
    Column(name="date", rank=1),
    Column(name="by", rank=4),
    Column(name="what", rank=2, wraps=True),
    Column(name="cameras", rank=3, wraps=True),
    Column(name="reason", rank=3, wraps=True),
)


def _of_one(revisions: Sequence[LoggedRevision], width: int) -> list[Text]:

    rows = []
    for one in revisions:
        K, delta = one.K, one.delta
        commit, when, by = _commit(one)
        rows.append(
            (
                commit,
                when,
                ", ".join(one.actions)
                or ("removed" if one.removed else "written" if K is not None else "unreadable"),
                *(
                    _number(getattr(K, name), getattr(delta, name, None)) if K is not None else ""
                    for name in ("fx", "fy", "cx", "cy")
                ),
                one.grade.value if one.grade is not None else "",
                one.firmware or "",
                by,
                one.reason or _without_names(one),
            )
        )
    return fitted(OF_ONE, rows, width)


def _without_names(one: LoggedRevision) -> str:
    """The commit's subject without the entry's name, which the user has just typed, and without a lone "Add"."""
    subject = one.subject
    for camera in one.cameras:
        subject = subject.removesuffix(camera).strip()
    return subject if " " in subject else ""


def _of_all(revisions: Sequence[LoggedRevision], width: int) -> list[Text]:

    rows = []
    for one in revisions:
        more = f" and {len(one.cameras) - 3} more" if len(one.cameras) > 3 else ""
        cameras = ", ".join(one.cameras[:3]) + more
        rows.append((*_commit(one), one.subject, cameras, one.reason or ""))
    return fitted(OF_ALL, rows, width)


def _commit(one: LoggedRevision) -> tuple[str, str, str]:

    return one.commit[:10], f"{one.date:%Y-%m-%d %H:%M}", one.author


def _number(value: float, delta: float | None) -> str:
    text = f"{value:.2f}"
    return f"{text} ({delta:+.2f})" if delta else text


COMMAND = OfRegistry(
    Fleet.history,
    DESCRIPTION,
    EXAMPLES,
    run=run,
    positional={"key": "KEY"},
    spelled={"most": ("-n", "--most")},
)
