"""``calibrary catalogue``: show the known cameras and their data."""

from __future__ import annotations

import argparse
from typing import Any

from calibrary.cli.commands import meant
from calibrary.cli.shown import Shown
from calibrary.jobs.catalogue import known_cameras
from calibrary.jobs.tables import catalogue

DESCRIPTION = "Print the known cameras, their pixels and the source of each number."
EXAMPLES = """\
examples:
  calibrary catalogue                  every camera
  calibrary catalogue M3T              cameras with this Model, with K, sources and conflicts
  calibrary catalogue "phantom 4"      by its common name
  calibrary catalogue --table cameras.csv
"""


class _Catalogue(Shown):
    def show(self, done: Any, arguments: argparse.Namespace, **_: Any) -> None:
        from calibrary.cli.console import errors

        if done.cameras:
            super().show(done, arguments)
            return
        words = [word for one in known_cameras().cameras for word in (*one.models, one.title)]
        remedy = meant(arguments.model, words) or "'calibrary catalogue' lists them all"
        errors().say(f"calibrary: the catalogue has no camera like {arguments.model!r}; {remedy}")


COMMAND = _Catalogue(
    known_cameras,
    DESCRIPTION,
    EXAMPLES,
    positional={"model": "MODEL"},
    told="calibrary.jobs.catalogue",
    exits={"cameras": 1},
    table=("the cameras", catalogue),
)
