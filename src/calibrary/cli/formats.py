"""``calibrary formats``: list the calibration file formats that can be read or written, from their declarations."""

from __future__ import annotations

import argparse
from typing import Any

from calibrary.cli.commands import meant
from calibrary.cli.shown import Shown
from calibrary.jobs.formats import formats

DESCRIPTION = "List the calibration files that are read and written."
EXAMPLES = """\
examples:
  calibrary formats              the table
  calibrary formats colmap       formats with a word in name or title, with their conventions
  calibrary formats agisoft_xml   one format: an example in its own words, how it counts, its source
"""


class _Formats(Shown):
    def show(self, done: Any, arguments: argparse.Namespace, **_: Any) -> None:
        from calibrary.cli.console import errors

        if done.formats:
            super().show(done, arguments, name=arguments.name)
            return
        words = [word for one in formats().formats for word in (one.name, *one.programs)]
        remedy = meant(arguments.name, words) or "'calibrary formats' lists them all"
        errors().say(f"calibrary: no format is called {arguments.name!r}; {remedy}")


COMMAND = _Formats(
    formats,
    DESCRIPTION,
    EXAMPLES,
    positional={"name": "NAME"},
    told="calibrary.jobs.formats",
    exits={"formats": 1},
)
