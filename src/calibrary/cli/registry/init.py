"""``calibrary registry init``: create a registry, or copy one."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.commands import add_json_flag, print_json
from calibrary.cli.flags import add_flags, call
from calibrary.cli.registry.changes import add_yes_flag, agreed, can_ask
from calibrary.jobs.fleet import create_registry

if TYPE_CHECKING:
    from calibrary.jobs.fleet import InitReport

DESCRIPTION = "Create a registry of camera calibrations in git, or copy one."
EXAMPLES = """\
examples:
  calibrary registry init fleet
  calibrary registry init --bare fleet.git                        a target for pushes
  calibrary registry init --starter camera-calibrations           open to everyone, with the catalogue's cameras
  calibrary registry init --remote git@example.com:fleet.git      a copy of an existing one
  calibrary registry init fleet --migrate                         once, for a registry of an older version

The command makes a git repository with registry.yaml, README.md, .gitattributes, CODEOWNERS, JSON Schemas for
editors, and a workflow and a pre-commit hook that run 'calibrary registry check'. It uses a repository without a
commit, and does not change one with commits.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add_flags(parser, create_registry, positional={"path": "PATH"})
    add_yes_flag(parser, "configure git's diff of entries without asking")
    add_json_flag(parser)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note, out, plain, printable
    from calibrary.jobs.fleet.changes import show_fields

    made = call(create_registry, arguments)
    screen, remarks = out(arguments), note(arguments)
    for line in _said(made, arguments):
        screen.say(plain(line))
    if not (arguments.bare or arguments.migrate):
        question = "Have git show entries by their fields here (git config in this repository)?"
        if arguments.yes or (can_ask() and agreed(arguments, question)):
            made = show_fields(made)
        else:
            remarks.say("to have git show entries by their fields:")
            remarks.verbatim(printable(f"  {made.driver}"))
    if arguments.json:
        print_json(made)
    elif not arguments.migrate:
        where = "" if made.place == Path.cwd() else f" --registry {made.place}"
        remarks.say(plain(f"next: calibrary registry add FILE{where}"))
    return 0


def _said(made: InitReport, arguments: argparse.Namespace) -> list[str]:
    folder = made.registry
    if arguments.migrate:
        lines = [f"{folder}: statements say from now on what is approved; commit {made.commit[:12]}"]
    elif made.cloned_from is not None and not made.files:
        lines = [f"{folder}: a copy of {made.cloned_from}"]
    elif made.cloned_from is not None:
        lines = [f"{folder}: {made.cloned_from} was empty, so a registry was created in it; push it"]
    else:
        lines = [f"{folder}: registry created, with {', '.join(sorted(made.files))}"]
    if made.outer is not None:
        lines.append(f"it lies in another repository, {made.outer}, whose .gitignore should name it")
    return lines
