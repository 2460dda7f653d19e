"""``calibrary registry add``: add calibrations of any format to the registry, after showing the changes."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.camera_flags import add_camera_flags, add_label_flag, camera_of
from calibrary.cli.output import add_json_flag, print_json
from calibrary.cli.reading import add_reading_flags, reading_of
from calibrary.cli.registry.asking import add_yes_flag, agreed, deciding_screen
from calibrary.cli.registry.deciding import add_force_flag, add_validity_flags, force_of, validity_of
from calibrary.cli.registry.place import add_registry_flag, where
from calibrary.cli.stated_flags import add_stated_flags, stated_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibrary.cli.console import Screen
    from calibrary.jobs.fleet.changes import ProposedChange
    from calibrary.registry.firmware import FirmwareRange
    from calibrary.registry.proposals import Proposal

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = "Put the cameras of a calibration file, an image or an entry's file into the registry."
EXAMPLES = """\
examples:
  calibrary registry add camera.xml --make DJI --model FC6310R
  calibrary registry add K.npy --image-size 5472x3648 --make DJI --model FC6310R --approve --yes
  calibrary registry add flight/DJI_0001.JPG                from the image's metadata
  calibrary registry add cameras.txt --camera 2 --sub-camera ''    the second camera, without the file's own number
  calibrary registry add cameras/dji/fc6310r/5472x3648.yaml --reason "focus was re-set"
  calibrary registry add camera.xml --serial 0V2LG3H0 --label P4R-03      of one unit, with your name for it
  calibrary registry add camera.xml --branch new-lens       for a pull request

An added entry is a proposal: it stays in proposals/, beside the entry in use, until it is approved. K is compared with
the catalogue, the sensor, other units and what was approved before; a contradiction needs --force and --reason.
If the registry's check reports an error, nothing is written (exit code 1).
An entry that has changed since it was shown is not overwritten (exit code 4).
"""

EXIT_REFUSED = 1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument(
        "file", type=Path, metavar="FILE", help="a file of any format, an image, or an entry's YAML"
    )
    parser.add_argument("--camera", type=int, metavar="N", help="only this camera of the file, from 1")
    parser.add_argument(
        "--firmware-range",
        type=_range,
        metavar="MIN..MAX",
        help="firmware versions for which it is valid, both included; you may omit either",
    )
    parser.add_argument("--note", action="append", metavar="TEXT", help="note for people")
    parser.add_argument("--reason", metavar="TEXT", help="why, for the history")
    add_stated_flags(parser)
    parser.add_argument(
        "--approve", action="store_true", help="approve it at once, if the check reports no error"
    )
    parser.add_argument(
        "--branch",
        metavar="NAME",
        help="propose it on this branch, for a pull request; the branch is created if it does not exist",
    )
    add_validity_flags(parser)
    add_label_flag(parser)
    parser.add_argument(
        "--tag", action="append", metavar="WORD", help="a tag for searching; may be given several times"
    )
    add_force_flag(parser)
    parser.add_argument("--override-held", action="store_true", help="replace an entry that a person pinned")
    add_camera_flags(parser, with_image_size=False)
    add_reading_flags(parser)
    add_registry_flag(parser)
    add_yes_flag(parser)
    add_json_flag(parser)


def _range(text: str) -> FirmwareRange:
    from calibrary.errors import InputError
    from calibrary.jobs.fleet.changes import FirmwareRange

    try:
        return FirmwareRange.parse(text)
    except InputError as error:
        raise argparse.ArgumentTypeError(f"{text!r}: {error}; expected MIN..MAX, MIN.. or ..MAX") from None


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import errors
    from calibrary.cli.registry.changes import show_changes, show_differences, show_findings

    screen = deciding_screen(arguments)
    change = _proposed(arguments)
    proposals, code = change.proposals, 0
    show_changes(screen, proposals.items)
    show_differences(screen, change)
    show_findings(screen, proposals.findings)
    if proposals.errors:
        refused = _refused(len(proposals.errors), approve=arguments.approve)
        errors().say(f"nothing was written: {refused}")
        code = EXIT_REFUSED
    elif proposals.due and agreed(arguments, _question(proposals.due)):
        _write(arguments, change, screen)
    elif proposals.due:
        screen.say("nothing was written")
    if arguments.json:
        print_json(change.to_dict())
    return code


def _proposed(arguments: argparse.Namespace) -> ProposedChange:
    from calibrary.cli.console import note, plain
    from calibrary.jobs.fleet import Fleet

    registry, is_new = Fleet.named_or_new(arguments.registry)
    if is_new:
        text = f"no registry was named and none was found here, so your own was created: {registry.place}"
        note(arguments).say(plain(text))
    return registry.propose(
        arguments.file,
        reading=reading_of(arguments, camera=arguments.camera),
        camera=partial(camera_of, arguments),
        stated=stated_of(arguments),
        firmware=arguments.firmware_range,
        notes=arguments.note or (),
        reason=arguments.reason,
        approve=arguments.approve,
        override_held=arguments.override_held,
        force=force_of(arguments),
        branch=arguments.branch,
        valid=validity_of(arguments),
        label=arguments.label,
        tags=arguments.tag or (),
    )


def _write(arguments: argparse.Namespace, change: ProposedChange, screen: Screen) -> None:
    from calibrary.cli.console import errors, note, plain
    from calibrary.cli.registry.changes import show_conflict, show_written
    from calibrary.jobs.fleet.changes import FileConflictError

    due = change.proposals.due
    try:
        written = change.write(arguments.reason)
    except FileConflictError as error:
        show_conflict(errors(), error)
        raise
    show_written(screen, written, "approved" if arguments.approve else "proposed", len(due))
    if not arguments.approve:
        named = " ".join(one.entry.id for one in due[:3])
        digests = " ".join(f"--digest {(one.digest or '')[:12]}" for one in due[:3])
        branch = f" --from {arguments.branch}" if arguments.branch is not None else ""
        more = " …" if len(due) > 3 else ""
        remark = (
            f"a proposal is not used yet; next: calibrary registry approve {named}{branch}{where(arguments)} {digests}"
            f"{more}"
        )
        note(arguments).say(plain(remark))


def _question(due: Sequence[Proposal]) -> str:
    return f"Write {due[0].entry.id}?" if len(due) == 1 else f"Write these {len(due)} entries?"


def _refused(number: int, *, approve: bool) -> str:
    what = "the check found an error" if number == 1 else f"the check found {number} errors"
    return f"{what}; correct it in the file or with flags" + (
        ", or add it as a draft without --approve" if approve else ""
    )
