"""``calibrary registry audit``: compare recent flights with the registry, interactively or from cron."""

from __future__ import annotations

import argparse
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from calibrary.cli.registry import OfRegistry, where
from calibrary.jobs.fleet import Fleet
from calibrary.jobs.tables import flown

if TYPE_CHECKING:
    from calibrary.jobs.audit.report import AuditReport

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


class _Audit(OfRegistry):
    def check(self, arguments: argparse.Namespace) -> None:
        from calibrary.cli.console import note

        super().check(arguments)
        # Without pycolmap the audit ends with one line that names the extra, and must announce nothing before it.
        if arguments.verify and find_spec("pycolmap") is not None:
            note(arguments).say(
                "--verify: one flight of each unit and date, a dozen images and about a minute each, "
                f"at most {arguments.verify_minutes or 15:g} min",
                style="dim",
            )

    def show(self, done: AuditReport, arguments: argparse.Namespace, **_: Any) -> None:
        super().show(done, arguments, registry=where(arguments))


COMMAND = _Audit(
    Fleet.audit,
    DESCRIPTION,
    EXAMPLES,
    positional={"folders": "IMAGES_DIR"},
    doing="reading",
    exits={"is_clean": 1},
    table=("what flew", flown),
    switches={"--explain": "show every finding of each unit, and every flight"},
)
