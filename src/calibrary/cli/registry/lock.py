"""``calibrary registry lock``: pin the entries that a run rests on."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.registry.place import add_registry_flag, snapshot_of

if TYPE_CHECKING:
    from calibrary.cli.console import Screen
    from calibrary.registry.snapshot import Snapshot

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

LOCK_FILE = "calibrary.lock"
"""As :data:`calibrary.registry.locking.LOCK_FILE`, without what that module loads."""

DESCRIPTION = "Pin entries as they are now, so that a run can be repeated on the same ones."
EXAMPLES = """\
examples:
  calibrary registry lock                                every approved and held entry
  calibrary registry lock flight/                        the entries that answer for a flight's images
  calibrary registry lock dji/fc6310r sony/dsc-rx1rm2
  calibrary extract --image-dir flight/ --registry fleet --locked       later, with just those

A registry in git is read at the pinned commit later, whatever became of it since, and the run tells what has
changed; one that has lost that commit is refused. Of a plain folder any change of a pinned entry is refused.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("what", nargs="*", metavar="IMAGE_DIR|KEY", help="all usable entries when left out")
    parser.add_argument(
        "--out", type=Path, default=Path(LOCK_FILE), metavar="FILE", help=f"the lock (default: {LOCK_FILE})"
    )
    parser.add_argument("--recursive", action="store_true", help="go into the sub-folders of IMAGE_DIR")
    parser.add_argument("--at", metavar="REV", help="as it was at a commit, tag, branch or day")
    add_registry_flag(parser)
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.atomic import write_files
    from calibrary.cli.console import note, out, plain
    from calibrary.errors import RegistryError
    from calibrary.registry.locking import lock_json, lock_yaml, pinned, usable_paths

    remarks, snapshot = note(arguments), snapshot_of(arguments, arguments.at)
    if arguments.what:
        paths = [
            path
            for word in arguments.what
            for path in _paths(snapshot, word, remarks, recursive=arguments.recursive)
        ]
    else:
        paths = usable_paths(snapshot)
    if not paths:
        raise RegistryError(
            "no entry to pin: none is approved or held; 'calibrary registry approve KEY' puts one to use"
        )
    lock = pinned(snapshot, paths)
    write_files({arguments.out: lock_yaml(lock)})
    count = len(lock.pins)
    at = f" at {lock.commit[:12]}" if lock.commit is not None else ""
    line = f"{arguments.out}: {count} {'entry' if count == 1 else 'entries'} pinned{at}"
    out(arguments).say(plain(line))
    if arguments.json:
        document = lock_json(lock)
        print_json(document)
    return 0


def _paths(snapshot: Snapshot, word: str, remarks: Screen, *, recursive: bool) -> list[str]:
    from calibrary.registry.paths import find_path

    folder = Path(word)
    if folder.is_dir():
        return _of_flight(snapshot, folder, remarks, recursive=recursive)
    return [find_path(snapshot.index().paths, word)]


def _of_flight(snapshot: Snapshot, folder: Path, remarks: Screen, *, recursive: bool) -> list[str]:
    """The entries that the gate would take for these images."""
    from datetime import date

    from calibrary.catalogue import load_catalogue
    from calibrary.cli.console import plain
    from calibrary.errors import InputError
    from calibrary.jobs.extract.gather import find_images, gather
    from calibrary.jobs.extract.knowledge import Knowledge

    images = find_images(folder, recursive=recursive)
    if not images:
        raise InputError("holds no images, and names no entry", source=str(folder))
    knowledge = Knowledge(catalogue=load_catalogue(), registry=snapshot.index(), on=date.today())
    paths: dict[str, None] = {}
    for metadata in gather(images, folder).states:
        known = knowledge.of(metadata)
        if known.resolution is not None:
            paths[known.resolution.path] = None
            continue
        name = (
            " ".join(text for text in (metadata.make, metadata.model) if text)
            or "an image that names no camera"
        )
        near = f" ({known.near[0].path}: {known.near[0].reason})" if known.near else ""
        remarks.say(f"[yellow]note[/] {plain(f'no entry answers for {name}{near}')}")
    return list(paths)
