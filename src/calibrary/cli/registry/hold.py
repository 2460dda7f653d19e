"""``calibrary registry hold``: pin entries, so that nothing takes their place unasked."""

from __future__ import annotations

import argparse

from calibrary.cli.registry.deciding import add_deciding_flags, run_decision

__all__ = ["add_parser"]

EXAMPLES = """\
examples:
  calibrary registry hold fc6310r --reason "agreed with the surveyor for 2026"
"""


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Register the command."""
    parser = subparsers.add_parser(
        "hold",
        help="use entries and pin them",
        description="Use entries and pin them: nothing takes their place without --override-held.",
        epilog=EXAMPLES,
    )
    add_deciding_flags(parser, reason_required=True)
    parser.set_defaults(run=_run)


def _run(arguments: argparse.Namespace) -> int:
    from calibrary.registry.entry import Status

    return run_decision(arguments, Status.HELD, "held")
