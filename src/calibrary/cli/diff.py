"""``calibrary diff``: whether two calibrations of one camera differ by more than noise, and what changed."""

from __future__ import annotations

import argparse

from calibrary.cli.commands import add_json_flag, print_json
from calibrary.cli.flags import add_flags, call
from calibrary.cli.progress import Bar
from calibrary.jobs.diff import compare, compare_fleet

DESCRIPTION = (
    "Compare two calibrations of one camera, or every entry of a registry with its earlier state: in "
    "numbers, in pixels and on the ground, against their noise."
)
EXAMPLES = """\
examples:
  calibrary diff factory.xml adjusted.cam                two files, whatever their formats
  calibrary diff fc6310r@2026-05-01 fc6310r              an entry of the registry, then and now
  calibrary diff fc6310r@firmware:01.08 flight/DJI_0001.JPG
  calibrary diff K.npy camera.xml --camera 2
  calibrary diff old.yaml new.yaml --camera cam0         by name; --camera cam0,cam1 is one for each side
  calibrary diff old.xml new.xml --html diff.html        and a page
  calibrary diff --since v1.0                            every entry that changed since, worst first
  calibrary diff --firmware 01.08..01.09                 every camera calibrated with either; 01.09 is 01.09.1691

--since and --firmware compare proposals as well, each with the entry that it would replace.

exit code 1: the projections differ by 0.5 px rms, 1 px at most or 0.05 % of the focal length (a policy may state
other limits) and no measured uncertainty explains it; or the frame, the lens or a convention
changed; or an
entry could not be compared, or none is of that firmware.
"""

EXIT_ALARM = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(parser, compare, positional={"a": "A", "b": "B"}, optional=["a", "b"])
    fleet = {"every entry of a registry instead of two calibrations": ("since", "firmware")}
    add_flags(parser, compare_fleet, groups=fleet, exclusive=[("since", "firmware")], without=["registry"])
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import out
    from calibrary.cli.shown import show

    if arguments.since is not None or arguments.firmware is not None:
        if arguments.a is not None:
            arguments.parser.error(
                "expected either two calibrations A B, or --since REV, or --firmware OLD..NEW"
            )
        return _fleet(arguments)
    if arguments.b is None:
        arguments.parser.error("expected two calibrations A B, or --since REV, or --firmware OLD..NEW")
    found = call(compare, arguments)
    _say_written(arguments)
    if arguments.json:
        print_json(found)
    else:
        from calibrary.jobs.diff.told import told

        show(out(arguments), told(found))
    return EXIT_ALARM if found.alarm else 0


def _fleet(arguments: argparse.Namespace) -> int:
    from calibrary.cli.console import note, out
    from calibrary.cli.shown import show
    from calibrary.jobs.fleet import Fleet

    registry = Fleet.named(arguments.registry).registry
    with Bar(note(arguments), "comparing") as bar:
        found = call(compare_fleet, arguments, registry=registry, progress=bar)
    _say_written(arguments)
    if arguments.json:
        print_json(found)
    else:
        from calibrary.jobs.diff.told import told_fleet

        show(out(arguments), told_fleet(found))
    return EXIT_ALARM if found.alarm else 0


def _say_written(arguments: argparse.Namespace) -> None:
    from calibrary.cli.console import note, plain

    if arguments.html is not None:
        note(arguments).say(plain(f"wrote {arguments.html}"))
