"""``calibrary registry export``: write the registry for another program."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from calibrary.cli.registry import OfRegistry
from calibrary.jobs.fleet import Fleet

if TYPE_CHECKING:
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


class _Export(OfRegistry):
    def show(self, done: ExportReport, arguments: argparse.Namespace, **_: Any) -> None:
        super().show(done, arguments, place=arguments.out)


COMMAND = _Export(
    Fleet.export,
    DESCRIPTION,
    EXAMPLES,
    spelled={"statuses": "--status"},
    at=True,
    used=lambda done: [f"cameras/{one.entry}.yaml" for one in done.written],
)
