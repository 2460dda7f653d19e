"""``calibrary``: one command, a module for each of its parts, and the map from errors to exit codes."""

from __future__ import annotations

import argparse
import io
import os
import sys
from collections.abc import Sequence

from calibrary.cli import (
    calibrate,
    catalogue,
    completion,
    convert,
    diff,
    extract,
    formats,
    inspect,
    onboard,
    registry,
    undistort,
)
from calibrary.errors import CalibraryError, CalibrationError, RegistryError, ValidationError

__all__ = ["build_parser", "main"]

COMMANDS = (
    extract,
    calibrate,
    onboard,
    registry,
    diff,
    inspect,
    convert,
    undistort,
    catalogue,
    formats,
    completion,
)

EXIT_POLICY = 1
EXIT_INPUT = 3
EXIT_REGISTRY = 4
EXIT_BUG = 70
EXIT_INTERRUPTED = 130

EPILOG = """\
exit codes:
  0  good
  1  a policy was broken, or a K is not proven
  2  the command was not understood
  3  an input cannot be read
  4  the registry cannot be read or written
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code."""
    _spell_out_what_cannot_be_printed()
    arguments = build_parser().parse_args(argv)
    try:
        code: int = arguments.run(arguments)
        sys.stdout.flush()
    except CalibraryError as error:
        print(f"calibrary: {_printable(error)}", file=sys.stderr)  # noqa: T201 — the command line may print
        return _exit_code(error)
    except KeyboardInterrupt:
        print("calibrary: interrupted; nothing was half written", file=sys.stderr)  # noqa: T201 — as above
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        # Whoever read the output has seen enough; keep the interpreter from complaining on exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except Exception as error:
        if os.environ.get("CALIBRARY_DEBUG"):
            raise
        message = f"calibrary: this is a bug: {type(error).__name__}: {_printable(error)}"
        print(f"{message}; CALIBRARY_DEBUG=1 shows where, please report it", file=sys.stderr)  # noqa: T201
        return EXIT_BUG
    return code


def _spell_out_what_cannot_be_printed() -> None:
    """Let a terminal without Unicode read an escape in place of a ± rather than nothing at all."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _printable(error: Exception) -> str:
    """What it says without control characters: file names are in it, and a terminal would obey them."""
    return "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in str(error))


def _exit_code(error: CalibraryError) -> int:
    if isinstance(error, ValidationError | CalibrationError):
        return EXIT_POLICY
    return EXIT_REGISTRY if isinstance(error, RegistryError) else EXIT_INPUT


def build_parser() -> argparse.ArgumentParser:
    """The whole command line."""
    parser = argparse.ArgumentParser(
        prog="calibrary",
        description="The library of a fleet's camera calibrations: derives, validates and keeps K.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="print the version and exit")
    subparsers = parser.add_subparsers(title="commands", metavar="COMMAND", required=True)
    for command in COMMANDS:
        command.add_parser(subparsers)
    return parser


class _Version(argparse.Action):
    """Looks the version up only when it is asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object, **__: object) -> None:
        from importlib.metadata import version

        sys.stdout.write(f"calibrary {version('calibrary')}\n")
        parser.exit()


if __name__ == "__main__":
    sys.exit(main())
