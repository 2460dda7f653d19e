"""``calibrary registry status``: what waits in a registry, and for whom."""

from __future__ import annotations

import argparse
from itertools import groupby
from typing import TYPE_CHECKING

from calibrary.cli.commands import print_json
from calibrary.cli.flags import call
from calibrary.cli.progress import Bar
from calibrary.cli.registry import OfRegistry, entries, opened, where
from calibrary.jobs.fleet import Fleet

if TYPE_CHECKING:
    from collections.abc import Sequence
    from datetime import date

    from calibrary.cli.console import Screen
    from calibrary.jobs.audit.status import Matter

EXIT_WAITING = 1
MOST_ALIKE = 5
"""Matters of one kind and of the same people that are shown one by one."""

DESCRIPTION = (
    "Show what waits in a registry, most urgent first: proposals and for whom, changes of the rules, validities that "
    "end, calibrations to repeat, statements without effect, the age of the published copy. Nothing is written."
)
EXAMPLES = """\
examples:
  calibrary registry status                                  what waits, and for whom
  calibrary registry status flights/2026-04                  also what these flights show, as an audit does
  calibrary registry status --within-days 90            the next three months
  calibrary registry status --published https://cameras.example.com/

exit code 0: nothing waits for you; 1: something does, or for anybody; 3: a folder cannot be read; 4: the registry.
"""


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note, out, plain

    with Bar(note(arguments), "reading") as bar:
        done = call(opened(arguments).status, arguments, progress=bar)
    if arguments.json:
        print_json(done)
        return EXIT_WAITING if done.is_waiting else 0
    screen = out(arguments)
    for _, alike in groupby(done.matters, key=lambda one: (one.kind, one.yours, one.waits_for)):
        _show(screen, [*alike], done.day, where(arguments))
    mine = sum(one.yours for one in done.matters)
    who = plain(done.person or "you")
    verdict = f"[bold yellow]{mine} for {who}[/]" if mine else f"[bold green]nothing waits for {who}[/]"
    others = len(done.matters) - mine
    screen.say(f"{verdict}{f', {others} for others or later' if others else ''}; {entries(done.entries)}")
    return EXIT_WAITING if done.is_waiting else 0


def _show(screen: Screen, alike: Sequence[Matter], today: date, of_registry: str) -> None:
    """Print matters of one kind and of the same people; many of them as one."""
    from calibrary.cli.console import plain
    from calibrary.errors import first_of

    matter, age = alike[0], ""
    if len(alike) <= MOST_ALIKE and len(alike) > 1:
        for one in alike:
            _show(screen, [one], today, of_registry)
        return
    since = min((one.since for one in alike if one.since is not None), default=None)
    if since is not None:
        days = (today - since).days
        age = f", since {'today' if days <= 0 else '1 day' if days == 1 else f'{days} days'}"
    whom = "you" if matter.yours else ", ".join(matter.waits_for)
    style = "bold yellow" if matter.yours else "yellow" if matter.due is None or matter.due > today else "red"
    many = plain(matter.what)
    if len(alike) > 1:
        many, age = f"{len(alike)} ×", age.replace("since", "the oldest since")
    screen.say(
        f"[{style}]{matter.kind.value}[/] [bold]{many}[/]{age}{f', for {plain(whom)}' if whom else ''}"
    )
    if len(alike) > 1:
        screen.say(plain(first_of([one.what for one in alike])), indent=2)
        steps = {one.next for one in alike}
        step = steps.pop() if len(steps) == 1 else "calibrary registry status --json, which tells of each"
        screen.say(f"[cyan]next[/] {plain(step or '')}", indent=2)
        return
    screen.say(plain(matter.text), indent=2)
    if matter.next is not None:
        # What begins as one of its commands may also be several of them, or a sentence.
        is_one = matter.next.startswith("calibrary registry ") and "," not in matter.next
        screen.say(f"[cyan]next[/] {plain(matter.next + of_registry * is_one)}", indent=2)


COMMAND = OfRegistry(Fleet.status, DESCRIPTION, EXAMPLES, run=run, positional={"folders": "IMAGES_DIR"})
