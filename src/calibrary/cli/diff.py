"""``calibrary diff``: whether two calibrations of one camera differ by more than noise, and what changed."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from calibrary.cli.flags import add_flags, call
from calibrary.cli.progress import Bar
from calibrary.cli.shown import Shown
from calibrary.jobs.diff import compare, compare_fleet

if TYPE_CHECKING:
    from calibrary.jobs.diff.comparison import DiffReport
    from calibrary.jobs.diff.fleet import FleetDiffReport

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
FLEET = {"every entry of a registry instead of two calibrations": ("since", "firmware")}


class _Diff(Shown):
    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare the flags of both jobs."""
        super().add_arguments(parser)
        one = [("since", "firmware")]
        add_flags(parser, compare_fleet, groups=FLEET, exclusive=one, without=["registry"])

    def check(self, arguments: argparse.Namespace) -> None:
        is_fleet = arguments.since is not None or arguments.firmware is not None
        if is_fleet and arguments.a is not None:
            arguments.parser.error(
                "expected either two calibrations A B, or --since REV, or --firmware OLD..NEW"
            )
        if not is_fleet and arguments.b is None:
            arguments.parser.error("expected two calibrations A B, or --since REV, or --firmware OLD..NEW")

    def done(self, arguments: argparse.Namespace, _: Any = None) -> DiffReport | FleetDiffReport:
        """Compare two calibrations, or a fleet, and say where the page is."""
        from calibrary.cli.console import note

        found: DiffReport | FleetDiffReport
        if arguments.a is not None:
            found = call(compare, arguments)
        else:
            from calibrary.jobs.fleet import Fleet

            with Bar(note(arguments), "comparing") as bar:
                registry = Fleet.named(arguments.registry).registry
                found = call(compare_fleet, arguments, registry=registry, progress=bar)
        if arguments.html is not None:
            note(arguments).say(f"wrote {arguments.html}")
        return found

    def exit_code(self, done: DiffReport | FleetDiffReport, _: argparse.Namespace) -> int:
        return EXIT_ALARM if done.alarm else 0


COMMAND = _Diff(
    compare,
    DESCRIPTION,
    EXAMPLES,
    positional={"a": "A", "b": "B"},
    optional=["a", "b"],
)
