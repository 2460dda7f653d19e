"""``calibrary registry export``: write the registry for another program."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from calibrary.cli.commands import add_json_flag, print_json
from calibrary.cli.flags import add_flags, call
from calibrary.cli.registry import add_registry_flag, entries, note_waiting, opened
from calibrary.jobs.fleet import Fleet

if TYPE_CHECKING:
    from calibrary.cli.console import Screen
    from calibrary.jobs.export.run import ExportReport

DESCRIPTION = "Write all entries in the format of another program, and report how exactly it represents them."
EXAMPLES = """\
examples:
  calibrary registry export --to odm --out cameras.json
  calibrary registry export --to opensfm --out camera_models_overrides.json
  calibrary registry export --to colmap --out cameras.txt
  calibrary registry export --out fleet.csv --status draft --status approved
  calibrary registry export --to opencv_storage --out opencv/ --at 2026-05-01       a file for each entry

FORMAT is csv, yaml (the entries' files as one stream), odm, opensfm, colmap or any format that 'calibrary formats'
lists as written. Without --status only approved entries are written.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(parser, Fleet.export, spelled={"statuses": "--status"})
    add_registry_flag(parser, at=True)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import out

    registry = opened(arguments)
    done = call(registry.export, arguments)
    note_waiting(arguments, registry, [f"cameras/{one.entry}.yaml" for one in done.written])
    print_json(done) if arguments.json else _show(out(arguments), done, arguments.out)
    return 0


def _show(screen: Screen, done: ExportReport, out: str) -> None:
    from calibrary.cli.console import plain

    changed = [one for one in done.written if one.verdict.value != "exact"]
    count = len(done.written)
    exact = f"{count - len(changed)} exact (0.000 px)"
    lines = [f"{out}: {entries(count)} as {done.format}, {exact}"]
    lines += [f"  {one.entry}: {one}" for one in changed]
    lines += [f"  left out: {one.entry}: {one.reason}" for one in done.left_out]
    if done.dropped:
        lines.append(f"  it has no place for: {', '.join(done.dropped)}")
    for line in lines:
        screen.say(plain(line))
