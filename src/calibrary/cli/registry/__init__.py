"""``calibrary registry``: the fleet's cameras in git. One module for each of its commands."""

from __future__ import annotations

import argparse

from calibrary.cli.registry import (
    add,
    approve,
    audit,
    blame,
    check,
    export,
    hold,
    import_,
    init,
    list_,
    lock,
    log,
    pull,
    push,
    resolve,
    retire,
    serve,
    show,
    site,
)

__all__ = ["add_parser"]

COMMANDS = (
    init,
    add,
    import_,
    list_,
    show,
    resolve,
    check,
    audit,
    approve,
    hold,
    retire,
    log,
    blame,
    export,
    lock,
    pull,
    push,
    site,
    serve,
)

EPILOG = """\
The registry is the one named with --registry, else $CALIBRARY_REGISTRY, else the nearest registry.yaml in this
folder or above it, else your own.

KEY is make/model[/variant] in any case, as short as it is unambiguous: fc6310r, dji/fc6310r. KEY@REV is what it
was: at a commit, tag or branch, on a day (fc6310r@2026-05-01), or for a firmware (fc6310r@firmware:01.09).

exit codes: 0 good; 1 something is wrong with an entry; 2 usage; 3 an input cannot be read; 4 the registry.
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Register the command and its own commands."""
    parser = subparsers.add_parser(
        "registry",
        help="keep the fleet's calibrations in git",
        description="Keep the fleet's calibrations: one YAML file a camera, in git, with history and review.",
        epilog=EPILOG,
    )
    commands = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in COMMANDS:
        command.add_parser(commands)
