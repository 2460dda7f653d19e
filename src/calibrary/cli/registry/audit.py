"""``calibrary registry audit``: compare recent flights with the registry, interactively or from cron."""

from __future__ import annotations

import argparse
from importlib.util import find_spec
from typing import TYPE_CHECKING

from calibrary.cli.commands import add_json_flag, add_table_flag, check_table_flag, print_json, write_table
from calibrary.cli.flags import add_flags, call
from calibrary.cli.progress import Bar
from calibrary.cli.registry import add_registry_flag, opened, where
from calibrary.jobs.fleet import Fleet

if TYPE_CHECKING:
    from calibrary.jobs.audit.report import AuditReport
    from calibrary.jobs.tables.rows import Table

EXIT_FINDINGS = 1

DESCRIPTION = (
    "Compare the registry with images of recent flights: find cameras without an entry, entries that the "
    "images, files among them or proposals contradict, and stale entries. Nothing is written."
)
EXAMPLES = """\
examples:
  calibrary registry audit flights/                          which cameras fly without a valid entry
  calibrary registry audit flights/2026-03 flights/2026-04 --html audit.html
  calibrary registry audit /data/flights --since 2026-04-01 --json      for a cron job
  calibrary registry audit flights/ --stale-after-months 12   calibrations over a year old
  calibrary registry audit flights/ --verify --html k.html   K over time from the pixels of ordinary flights

The entries in use are compared with what the images state, with calibration files among them, and with proposals on
any branch. The command only reads. exit code 0: nothing to do, possibly notes; 1: an error or a warning, or not
everything could be compared; 3: a folder cannot be read; 4: the registry.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(parser, Fleet.audit, positional={"folders": "IMAGES_DIR"})
    add_registry_flag(parser)
    parser.add_argument(
        "--explain", action="store_true", help="show every finding of each unit, and every flight"
    )
    add_json_flag(parser)
    add_table_flag(parser, "what flew")


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note, out

    check_table_flag(arguments)
    # Without pycolmap the audit ends with one line that names the extra, and must announce nothing before it.
    if arguments.verify and find_spec("pycolmap") is not None:
        note(arguments).say(
            "[dim]--verify: one flight of each unit and date, a dozen images and about a minute each, "
            f"at most {arguments.verify_minutes or 15:g} min[/]"
        )
    with Bar(note(arguments), "reading") as bar:
        done = call(opened(arguments).audit, arguments, progress=bar)
    write_table(arguments.table, lambda: _as_table(done))
    if arguments.json:
        print_json(done)
    else:
        from calibrary.cli.shown import show
        from calibrary.jobs.audit.told import told

        show(out(arguments), told(done, registry=where(arguments)), whole=arguments.explain)
    return 0 if done.is_clean else EXIT_FINDINGS


def _as_table(done: AuditReport) -> Table:
    from calibrary.jobs.tables.rows import audit_table

    return audit_table(done)
