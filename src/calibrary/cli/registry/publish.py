"""``calibrary registry publish``: write the registry as static files for other programs."""

from __future__ import annotations

import argparse
from typing import Any

from calibrary.cli.registry import OfRegistry, entries
from calibrary.jobs.fleet import Fleet

DESCRIPTION = (
    "Write the registry as static files: small JSON documents that any web server or bucket can serve. "
    "calibrary and other programs find a camera's calibration in them over HTTP; one signed manifest vouches for all "
    "of them."
)
EXAMPLES = """\
examples:
  calibrary registry publish public/                    then: calibrary registry resolve … --registry https://…
  calibrary registry publish --registry fleet/ /srv/www/cameras --sign ~/.ssh/id_ed25519
  calibrary registry publish public/ --site             pages for people in the same folder, with links to the JSON

Approved and retired entries are published, with the revisions that earlier days need; drafts are not. An entry that
cannot be read is named (exit code 1), and readers refuse its camera; every other one is published. Only changes are
written. Readers refuse what is older than what they read before, and what was not published again in time.
docs/publishing.md explains how to serve and read the files.
"""


def _said(done: Any, arguments: argparse.Namespace) -> list[str]:
    from calibrary.cli.console import errors

    for why in done.refused:
        errors().say(("not published", "red"), f" {why}")
    files = "1 camera file" if done.cameras == 1 else f"{done.cameras} camera files"
    signed = f"signed by {done.signed_by}" if done.signed_by is not None else "not signed (--sign KEY)"
    return [
        f"{entries(done.entries)} in {files} of commit {done.commit[:12]}, {signed}; {done.written} files written to "
        f"{arguments.out}, {done.removed} removed; valid until {done.valid_until:%Y-%m-%d}: publish again before"
    ]


COMMAND = OfRegistry(
    Fleet.publish,
    DESCRIPTION,
    EXAMPLES,
    positional={"out": "OUT"},
    doing="publishing",
    said=_said,
    exits={"is_whole": 1},
)
