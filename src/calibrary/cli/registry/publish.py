"""``calibrary registry publish``: write the registry as static files for other programs."""

from __future__ import annotations

import argparse

from calibrary.cli.commands import add_json_flag, print_json
from calibrary.cli.flags import add_flags, call
from calibrary.cli.progress import Bar
from calibrary.cli.registry import add_registry_flag, entries, opened
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

Approved and retired entries are published, with the revisions that earlier days need; drafts are not. Only
changes are written. Readers refuse what is older than what they read before, and what was not published again in
time. docs/publishing.md explains how to serve and read the files.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(parser, Fleet.publish, positional={"out": "OUT"})
    add_registry_flag(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note, out, plain

    with Bar(note(arguments), "publishing") as bar:
        done = call(opened(arguments).publish, arguments, progress=bar)
    if arguments.json:
        print_json(done)
        return 0
    files = "1 camera file" if done.cameras == 1 else f"{done.cameras} camera files"
    signed = f"signed by {done.signed_by}" if done.signed_by is not None else "not signed (--sign KEY)"
    out(arguments).say(
        f"{entries(done.entries)} in {files} of commit {done.commit[:12]}, {signed}; {done.written} files written to "
        f"{plain(arguments.out)}, {done.removed} removed; valid until {done.valid_until:%Y-%m-%d}: publish again before"
    )
    return 0
