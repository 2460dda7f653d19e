"""``calibrary registry publish``: write the registry as static files for other programs."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.progress import Bar
from calibrary.cli.registry.place import add_registry_flag, opened
from calibrary.cli.registry.site import worker_count

if TYPE_CHECKING:
    from calibrary.registry.published.write import Publication

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = (
    "Write the registry as static files: small JSON documents that any web server or bucket can serve. "
    "calibrary and other programs find a camera's calibration in them over HTTP, and verify every file from "
    "one root."
)
EXAMPLES = """\
examples:
  calibrary registry publish public/                    then: calibrary registry resolve … --registry https://…
  calibrary registry publish --registry fleet/ /srv/www/cameras --sign ~/.ssh/id_ed25519
  calibrary registry publish public/ --site             pages for people in the same folder, with links to the JSON

Approved, held and retired entries are published, with the revisions that earlier days need; drafts are not. Only
changes are written, and the root file last. docs/publishing.md explains how to serve and read the files.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("out", type=Path, metavar="OUT", help="folder: new, empty, or published before")
    parser.add_argument(
        "--site", action="store_true", help="also write the pages of 'registry site' into the folder"
    )
    parser.add_argument(
        "--base-url",
        metavar="URL",
        help="URL at which OUT is served: also write the JSON Schemas of the files, with URLs there as their ids",
    )
    parser.add_argument("--sign", type=Path, metavar="KEY", help="an ssh key to sign the root file with")
    parser.add_argument(
        "--workers", type=worker_count, metavar="N", help="processes (default: one per processor)"
    )
    add_registry_flag(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note, out, plain
    from calibrary.records import to_json

    registry = opened(arguments)
    with Bar(note(arguments), "publishing") as bar:
        done: Publication = registry.publish(
            arguments.out,
            key=arguments.sign,
            base_url=arguments.base_url,
            workers=arguments.workers,
            progress=bar,
        )
    if arguments.site:
        with Bar(note(arguments), "making pages") as bar:
            registry.write_site(arguments.out, workers=arguments.workers, progress=bar)
    if arguments.json:
        print_json(to_json(done))
        return 0
    signed = ", signed" if done.signed else ""
    out(arguments).say(
        f"{done.entries} entries in {done.cameras} camera files of commit {done.commit[:12]}{signed}; "
        f"{done.written} files written, {done.removed} removed; the root is {plain(str(arguments.out))}/calibrary.json"
    )
    return 0
