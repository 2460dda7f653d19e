"""``calibrary registry init``: create a registry, or copy one."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.cli.commands import print_json
from calibrary.cli.flags import call
from calibrary.cli.shown import Shown
from calibrary.jobs.fleet import create_registry

if TYPE_CHECKING:
    from calibrary.jobs.fleet import InitReport

DESCRIPTION = (
    "Create a registry of camera calibrations in git, or copy one, or bring one to the present layout."
)
EXAMPLES = """\
examples:
  calibrary registry init fleet
  calibrary registry init --bare fleet.git                        a target for pushes
  calibrary registry init --remote git@example.com:fleet.git      a copy of an existing one
  calibrary registry init fleet --migrate                         from the former layout to this one

The command makes a git repository with registry.yaml, README.md, .gitattributes, CODEOWNERS, JSON Schemas for
editors, and a workflow and a pre-commit hook that run 'calibrary registry check'. It uses a repository without a
commit, and does not change one with commits.
"""


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note, out

    made = call(create_registry, arguments)
    screen, remarks = out(arguments), note(arguments)
    for line in _said(made, arguments):
        screen.say(line)
    if arguments.json:
        print_json(made)
    else:
        where = "" if made.place == Path.cwd() else f" --registry {made.place}"
        remarks.say(f"next: calibrary registry add FILE{where}")
    return 0


def _said(made: InitReport, arguments: argparse.Namespace) -> list[str]:
    folder = made.registry
    if arguments.migrate:
        return [
            f"{folder}: brought to this layout in commit {made.commit[:12]}; what was in use stays in use"
        ]
    if made.cloned_from is not None and not made.files:
        lines = [f"{folder}: a copy of {made.cloned_from}"]
    elif made.cloned_from is not None:
        lines = [f"{folder}: {made.cloned_from} was empty, so a registry was created in it; push it"]
    else:
        lines = [f"{folder}: registry created, with {', '.join(sorted(made.files))}"]
    if made.outer is not None:
        lines.append(f"it lies in another repository, {made.outer}, whose .gitignore should name it")
    return lines


COMMAND = Shown(create_registry, DESCRIPTION, EXAMPLES, run=run, positional={"path": "PATH"})
