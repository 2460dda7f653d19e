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
    "calibrary and other programs find a camera's calibration in them over HTTP; what is read is verified with "
    "The Update Framework."
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
    signed = ", signed" if done.signed else ", not signed (--sign KEY)"
    folder = plain(arguments.out)
    out(arguments).say(
        f"{entries(done.entries)} in {files} of commit {done.commit[:12]}{signed}; {done.written} files written to "
        f"{folder}, {done.removed} removed; valid until {done.valid_until:%Y-%m-%d}: publish again before"
    )
    if done.is_new_root and done.signed:
        keys = "1 key" if done.root_keys == 1 else f"{done.root_keys} keys"
        out(arguments).say(
            f"root {done.root}: {keys}, of which a change needs {done.root_threshold}; keep "
            f"{folder}/metadata/{done.root}.root.json"
        )
    elif done.root_until <= done.valid_until:
        note(arguments).say(
            f"[yellow]warning[/] the root ends on {done.root_until:%Y-%m-%d}: renew it before, with --root-key"
        )
    return 0
