"""``calibrary registry status``: what waits in a registry, and for whom."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from calibrary.cli.registry import OfRegistry, where
from calibrary.jobs.fleet import Fleet

if TYPE_CHECKING:
    from calibrary.jobs.status.run import RegistryStatus

EXIT_WAITING = 1

DESCRIPTION = (
    "Show what waits in a registry, most urgent first: proposals and for whom, changes of the rules, validities that "
    "end, calibrations to repeat, statements without effect, the age of the published copy. Nothing is written."
)
EXAMPLES = """\
examples:
  calibrary registry status                                  what waits, and for whom
  calibrary registry status flights/2026-04                  also what these flights show, as an audit does
  calibrary registry status --within-days 90            the next three months
  calibrary registry status --published https://cameras.example.com/

exit code 0: nothing waits for you; 1: something does, or for anybody; 3: a folder cannot be read; 4: the registry.
"""


class _Status(OfRegistry):
    def show(self, done: RegistryStatus, arguments: argparse.Namespace, **_: Any) -> None:
        super().show(done, arguments, registry=where(arguments))

    def exit_code(self, done: RegistryStatus, _: argparse.Namespace) -> int:
        return EXIT_WAITING if done.is_waiting else 0


COMMAND = _Status(Fleet.status, DESCRIPTION, EXAMPLES, positional={"folders": "IMAGES_DIR"}, doing="reading")
