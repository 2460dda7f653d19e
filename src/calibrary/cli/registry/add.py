"""``calibrary registry add``: add calibrations of any format to the registry, after showing the changes."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.flags import call
from calibrary.cli.progress import Bar
from calibrary.cli.registry import OfRegistry, where
from calibrary.cli.registry.changes import YES, agreed, decide
from calibrary.cli.registry.sync import SYNC, between_syncs
from calibrary.jobs.fleet import Fleet

if TYPE_CHECKING:
    from calibrary.jobs.fleet.changes import ProposedChange

DESCRIPTION = (
    "Put the cameras of a calibration file, an image or an entry's file into the registry; or a folder's."
)
EXAMPLES = """\
examples:
  calibrary registry add camera.xml --make DJI --model FC6310R
  calibrary registry add K.npy --image-size 5472x3648 --make DJI --model FC6310R --approve --yes
  calibrary registry add flight/DJI_0001.JPG                from the image's metadata
  calibrary registry add cameras.txt --camera 2 --sub-camera ''    the second camera, without the file's own number
  calibrary registry add cameras/dji/fc6310r/5472x3648.yaml --reason "focus was re-set"
  calibrary registry add camera.xml --serial 0V2LG3H0 --label P4R-03      of one unit, with your name for it
  calibrary registry add camera.xml --approve --sync        approves it as you, and sends it to the others
  calibrary registry add camera.xml --branch new-lens       for a pull request
  calibrary registry add lab-results/ --yes                 every calibration file below a folder, in one commit
  calibrary registry add catalogue                          every known camera with a K that can be derived, as drafts

An added entry is a proposal: its file says it, and what is in use stays in use until it is approved. K is compared with
the catalogue, the sensor, other units and what was approved before; a contradiction needs --force and --reason.
If the registry's check reports an error, nothing is written (exit code 1).
An entry that has changed since it was shown is not overwritten (exit code 4).

Of a folder, a file that cannot be added is reported and does not stop the others (exit code 3: there were files, and
none could be added). A second run changes nothing. ./catalogue is a file or folder of that name.
"""


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    return between_syncs(arguments, _add)


def _add(arguments: argparse.Namespace) -> int:
    from calibrary.cli.console import note

    remarks = note(arguments)
    registry, is_new = Fleet.named_or_new(arguments.registry)
    if is_new:
        text = f"no registry was named and none was found here, so your own was created: {registry.place}"
        remarks.say(text)
    if Path(arguments.source).is_dir():
        with Bar(remarks, "reading") as bar:
            change = call(registry.propose, arguments, progress=bar)
    else:
        change = call(registry.propose, arguments)
    code = decide(arguments, change, is_agreed=_is_agreed, remedy=_remedy(arguments, change))
    if change.written is not None and not change.proposals.due[0].after.is_usable:
        remarks.say(_next(arguments, change))
    return code


def _is_agreed(arguments: argparse.Namespace, change: ProposedChange) -> bool:
    due = change.proposals.due
    what = due[0].id if len(due) == 1 else f"these {len(due)} entries"
    return agreed(arguments, f"Write {what}?")


def _remedy(arguments: argparse.Namespace, change: ProposedChange) -> str:
    number = len(change.proposals.errors)
    found = "the check found an error" if number == 1 else f"the check found {number} errors"
    otherwise = ", or add it as a draft without --approve" if arguments.approve else ""
    return f"{found}; correct it in the file or with flags{otherwise}"


def _next(arguments: argparse.Namespace, change: ProposedChange) -> str:
    """The command that approves what was added."""
    due = change.proposals.due
    named = " ".join(one.id for one in due[:3])
    digests = " ".join(f"--digest {(one.digest or '')[:12]}" for one in due[:3])
    branch = f" --from {arguments.branch}" if arguments.branch is not None else ""
    more = " …" if len(due) > 3 else ""
    command = f"calibrary registry approve {named}{branch}{where(arguments)} {digests}{more}"
    return f"a proposal is not used yet; next: {command}"


COMMAND = OfRegistry(
    Fleet.propose,
    DESCRIPTION,
    EXAMPLES,
    run=run,
    positional={"source": "FILE|DIR|catalogue"},
    spelled={"notes": "--note", "tags": "--tag"},
    switches=YES | SYNC,
)
