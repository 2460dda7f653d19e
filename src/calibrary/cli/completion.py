"""``calibrary completion``: print a shell script that completes commands, flags, files and formats."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

from calibrary.cli.flags import call
from calibrary.cli.shown import Shown

DESCRIPTION = "Print a script that completes commands, flags, files and formats in a shell."
EXAMPLES = """\
examples:
  calibrary completion bash   > ~/.local/share/bash-completion/completions/calibrary
  calibrary completion zsh    > ~/.zfunc/_calibrary
  calibrary completion tcsh   >> ~/.cshrc

zsh looks for it in the folders of fpath, which must be set before compinit runs.
A new shell then completes commands; write the script again after an update.
"""


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    sys.stdout.write(call(completion_script, arguments))
    return 0


def completion_script(shell: Literal["bash", "zsh", "tcsh"]) -> str:
    """Make the script that completes commands in a shell; the command line itself is its subject, so no job does it.

    Args:
        shell: bash, zsh or tcsh.
    """
    import shtab

    from calibrary.cli.main import build_parser

    parser = build_parser()
    for action in _actions(parser):
        if isinstance(action, argparse._SubParsersAction):
            # shtab omits what --help omits, and finds commands only in a dict.
            action.help, action.choices = None, dict(action.choices)
        _set_completion(action)
    script: str = shtab.complete(parser, shell=shell)
    return script if script.endswith("\n") else f"{script}\n"


def _actions(parser: argparse.ArgumentParser) -> Iterator[argparse.Action]:
    """All arguments of a command and of its subcommands."""
    for action in parser._actions:
        yield action
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from _actions(below)


def _set_completion(action: argparse.Action) -> None:
    """Set what an argument completes to: files, folders, or the formats and their options."""
    import shtab

    from calibrary.jobs.formats import formats

    if action.type is Path or hasattr(action, "completes_path"):
        kind = shtab.DIRECTORY if action.metavar == "DIR" else shtab.FILE
        # shtab reads this attribute, which argparse does not define.
        action.complete = kind  # type: ignore[attr-defined]
    elif action.choices is not None:
        return
    elif hasattr(action, "completes_words"):
        action.choices = action.completes_words
    elif action.dest in {"format", "to"}:
        listed = [one for one in formats().formats if (one.reads if action.dest == "format" else one.writes)]
        programs = {program for one in listed for program in one.programs}
        action.choices = sorted({*programs, *(one.name for one in listed)})
    elif action.dest == "set":
        asked = (one.options.items() for one in formats().formats)
        action.choices = sorted(
            {f"{name}={value}" for items in asked for name, values in items for value in values}
        )


COMMAND = Shown(completion_script, DESCRIPTION, EXAMPLES, run=run, positional={"shell": "SHELL"}, json=False)
