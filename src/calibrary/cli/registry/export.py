"""``calibrary registry export``: write the registry for another program, or one entry for a public registry."""

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
    from calibrary.jobs.fleet import Contribution

DESCRIPTION = (
    "Write all entries in the format of another program, and report how exactly it represents them. With --public, "
    "write one approved entry as a proposal for a public registry, without private data."
)
EXAMPLES = """\
examples:
  calibrary registry export --to odm --out cameras.json
  calibrary registry export --to opensfm --out camera_models_overrides.json
  calibrary registry export --to colmap --out cameras.txt
  calibrary registry export --out fleet.csv --status draft --status approved
  calibrary registry export --to opencv_storage --out opencv/ --at 2026-05-01       a file for each entry
  calibrary registry export fc6310r --public --out ../public-registry    then commit it there, and open a pull request

FORMAT is csv, yaml (the entries' files as one stream), odm, opensfm, colmap or any format that 'calibrary formats'
lists as written. Without --status only approved and held entries are written.

--public: the proposal is of the model, with the evidence behind it (digests, date, tool, σ) and without serial number,
label, tags, notes, and names of files and people. The calibration of one unit is an estimate for its model: the grade
becomes derived, the tolerance at least 3 %, and σ is stated as evidence of that unit. The command refuses drafts,
retired entries, typed and overridden values, and a unit from which another unit of the model differs by more than 3 %.
Look at the file before you send it.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(parser, Fleet.export, spelled={"statuses": "--status"})
    public = parser.add_argument_group("for a public registry, without private data")
    public.add_argument("--public", action="store_true", help="write the entry KEY as a proposal")
    add_flags(parser, Fleet.contribute, positional={"key": "KEY"}, optional=["key"])
    add_registry_flag(parser, at=True)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import out

    if arguments.public != (arguments.key is not None):
        arguments.parser.error("KEY and --public go together: the entry for a public registry")
    registry = opened(arguments)
    if arguments.public:
        if (
            arguments.to
            or arguments.statuses
            or arguments.drop_distortion
            or arguments.max_error_px is not None
        ):
            arguments.parser.error(
                "--public writes an entry's file: it takes no --to, --status, --max-error-px and --drop-distortion"
            )
        proposal = call(registry.contribute, arguments)
        print_json(proposal) if arguments.json else _show_proposal(out(arguments), proposal)
        return 0
    done = call(registry.export, arguments)
    note_waiting(arguments, registry, [f"cameras/{one.entry}.yaml" for one in done.written])
    print_json(done) if arguments.json else _show(out(arguments), done, arguments.out)
    return 0


def _show_proposal(screen: Screen, done: Contribution) -> None:
    from calibrary.cli.console import plain

    screen.say(f"wrote {plain(done.file)}: grade {done.grade.value}, a draft for review")
    if done.left_out:
        screen.say(f"left out: {plain(', '.join(done.left_out))}; look at the file before you send it")


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
