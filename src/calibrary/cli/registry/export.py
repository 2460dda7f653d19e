"""``calibrary registry export``: export the whole registry in the format of another program."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.registry.place import add_registry_flag, note_waiting, opened

if TYPE_CHECKING:
    from calibrary.cli.console import Screen
    from calibrary.jobs.exchange.export import Export

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = "Write all entries in the format of another program, and report how exactly it represents them."
EXAMPLES = """\
examples:
  calibrary registry export --format odm --out cameras.json
  calibrary registry export --format opensfm --out camera_models_overrides.json
  calibrary registry export --format colmap --out cameras.txt
  calibrary registry export --format csv --out fleet.csv --status draft --status approved
  calibrary registry export --format opencv_storage --out opencv/ --at 2026-05-01       a file for each entry

FORMAT is csv, yaml (the entries' files as one stream), odm, opensfm, colmap or any format that 'calibrary formats'
lists as written. Without --status only approved and held entries are written.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("--format", required=True, metavar="FORMAT", help="format to write")
    parser.add_argument("--out", type=Path, required=True, metavar="FILE|DIR", help="file or folder to write")
    parser.add_argument("--at", metavar="REV", help="as it was at a commit, tag, branch or day")
    parser.add_argument(
        "--status",
        action="append",
        choices=("draft", "approved", "held", "retired"),
        help="only entries of this status; may be given several times (default: approved and held)",
    )
    parser.add_argument(
        "--max-error-px",
        type=float,
        metavar="PX",
        help="largest error allowed if the format does not have the lens model (default: 0.05)",
    )
    add_registry_flag(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import out

    registry = opened(arguments)
    done = registry.export(
        arguments.format,
        arguments.out,
        statuses=arguments.status or ("approved", "held"),
        max_error_px=arguments.max_error_px,
    )
    note_waiting(arguments, registry, [f"cameras/{one.entry}.yaml" for one in done.export.written])
    if arguments.json:
        print_json(done.to_dict())
    else:
        _show(out(arguments), done.export, arguments.out)
    return 0


def _show(screen: Screen, done: Export, out: Path) -> None:
    from calibrary.cli.console import plain

    refitted = [one for one in done.written if one.verdict.value == "refitted"]
    count = len(done.written)
    lines = [
        f"{out}: {count} {'entry' if count == 1 else 'entries'} as {done.format}, {count - len(refitted)} exact"
    ]
    lines += [
        f"  refitted: {one.entry}: rms {one.rms_px:.3g} px, max {one.max_px:.3g} px" for one in refitted
    ]
    lines += [f"  left out: {one.entry}: {one.reason}" for one in done.left_out]
    if done.dropped:
        lines.append(f"  it has no place for: {', '.join(done.dropped)}")
    for line in lines:
        screen.say(plain(line))
