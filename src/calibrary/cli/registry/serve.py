"""``calibrary registry serve``: serve the registry's pages to a browser on this machine."""

from __future__ import annotations

import argparse
import sys

from calibrary.cli.progress import Bar
from calibrary.cli.registry.place import add_registry_flag, opened
from calibrary.cli.registry.site import worker_count

__all__ = ["DESCRIPTION", "EXAMPLES", "add_arguments", "run"]

DESCRIPTION = "Show the registry in a browser on this machine only."
EXAMPLES = """\
examples:
  calibrary registry serve                     prints the address to open; Ctrl-C ends it
  calibrary registry serve --port 8710

Only this machine can reach it. When the registry changes, the pages are rebuilt; reload to see them.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    parser.add_argument("--port", type=_port, default=0, metavar="N", help="port (default: any free port)")
    add_registry_flag(parser)
    parser.add_argument(
        "--workers", type=worker_count, metavar="N", help="processes (default: one per processor)"
    )


def _port(text: str) -> int:
    if not text.isdecimal() or not 0 <= int(text) <= 65_535:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a port, 1 … 65535, or 0 for any that is free")
    return int(text)


def run(arguments: argparse.Namespace) -> int:
    """Run the command; returns the exit code."""
    from calibrary.cli.console import note, plain

    remarks = note(arguments)

    def told(text: str) -> None:
        remarks.say(plain(text))

    try:
        with Bar(remarks, "making") as bar:
            server = opened(arguments).server(
                port=arguments.port, workers=arguments.workers, progress=bar, told=told
            )
        with server:
            sys.stdout.write(f"{server.url}\n")
            sys.stdout.flush()
            told("Ctrl-C ends it")
            server.run()
    except KeyboardInterrupt:
        told("ended")
    return 0
