"""``calibrary``: entry point of the command line, and the mapping of errors to exit codes."""

from __future__ import annotations

import argparse
import io
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from calibrary.cli.commands import Command, Parser, add_commands
from calibrary.cli.signals import exit_code
from calibrary.cli.words import printable
from calibrary.errors import (
    AmbiguousCameraError,
    CalibraryError,
    CalibrationError,
    MissingExtraError,
    RegistryError,
    UsageError,
    ValidationError,
)
from calibrary.version import __version__

GROUPS = (
    (
        "the images of a flight",
        (
            ("extract", "derive and validate one K per camera from a directory of images"),
            ("check", "check whether the K that you are about to use is right for these images"),
            ("undistort", "remove lens distortion from images, and write their new K"),
        ),
    ),
    (
        "a camera that is calibrated",
        (
            ("calibrate", "compute K from frames of a board or from a flight"),
            (
                "onboard",
                "process a new payload: identify its cameras, compare sources of K, propose the best",
            ),
        ),
    ),
    (
        "the fleet",
        (
            ("registry", "keep the fleet's calibrations in git"),
            ("desk", "work with the registry in a browser on this machine"),
            ("diff", "show whether K moved: two calibrations, or a fleet then and now"),
        ),
    ),
    (
        "calibration files",
        (
            ("k", "print the K of one image, calibration file or camera"),
            ("inspect", "show what a calibration file or an image contains"),
            ("convert", "write a calibration in another program's format"),
            ("formats", "list the calibration files that are read and written"),
            ("catalogue", "list the known cameras, with the source of each number"),
        ),
    ),
    (
        "first steps",
        (
            ("demo", "write a synthetic flight to try the commands on"),
            ("completion", "print a script that completes commands and flags in a shell"),
        ),
    ),
)
"""The commands by what they are for; each is a module of this package."""

EXIT_POLICY = 1
EXIT_USAGE = 2
EXIT_INPUT = 3
EXIT_REGISTRY = 4
EXIT_BUG = 70
EXIT_BROKEN_PIPE = 141
"""Exit code as for a command ended by SIGPIPE: the output was not delivered, so it is not 0."""

EPILOG = """\
exit codes:
  0  good
  1  a policy was broken, a K is not proven or not right, or an image cannot be read
  2  the command was not understood, or needs a library that is not installed
  3  an input cannot be read
  4  the registry cannot be read or written

130 after Ctrl-C, 143 after SIGTERM, 141 if the reader of the output has ended (calibrary … | head).
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; returns the exit code."""
    _spell_out_what_cannot_be_printed()
    parser = build_parser()
    given = sys.argv[1:] if argv is None else list(argv)
    if not given:
        parser.print_help(sys.stderr)
        return EXIT_USAGE
    try:
        arguments = parser.parse_args(given)
        arguments.given = given
        with _logging(arguments.verbose):
            code: int = arguments.run(arguments)
            sys.stdout.flush()
        return code
    except CalibraryError as error:
        _complain(printable(str(error)))
        return _exit_code(error)
    except KeyboardInterrupt as error:
        _complain("; ".join(("interrupted", *map(str, error.args))) if error.args else INTERRUPTED)
        return exit_code(error)
    except BrokenPipeError:
        # The reader closed the pipe; prevent the interpreter from reporting an error on exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_BROKEN_PIPE
    except Exception as error:
        if os.environ.get("CALIBRARY_DEBUG"):
            raise
        said = f"this is a bug: {type(error).__name__}: {printable(str(error))}"
        _complain(f"{said}; CALIBRARY_DEBUG=1 shows where, please report it")
        return EXIT_BUG


INTERRUPTED = "interrupted; nothing was half written"


@contextmanager
def _logging(verbose: int) -> Iterator[None]:
    """Send the library's log messages to standard error, one line each, if the user asked for them."""
    if not verbose:
        yield
        return
    import logging

    from calibrary.progress import stage

    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(logging.Formatter("calibrary: %(message)s"))
    logger = logging.getLogger("calibrary")
    logger.setLevel(logging.DEBUG if verbose > 1 else logging.INFO)
    logger.addHandler(handler)
    try:
        with stage("in all"):
            yield
    finally:
        logger.removeHandler(handler)


def _complain(text: str) -> None:
    sys.stderr.write(f"calibrary: {text}\n")


def _spell_out_what_cannot_be_printed() -> None:
    """Print escapes in place of characters that the terminal's encoding lacks, instead of failing."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _exit_code(error: CalibraryError) -> int:
    if isinstance(error, ValidationError | CalibrationError):
        return EXIT_POLICY
    if isinstance(error, AmbiguousCameraError | MissingExtraError | UsageError):
        return EXIT_USAGE
    return EXIT_REGISTRY if isinstance(error, RegistryError) else EXIT_INPUT


def build_parser() -> Parser:
    """Build the parser of the command line; the arguments of a command are declared when it is looked up."""
    parser = Parser(
        prog="calibrary",
        usage="calibrary COMMAND …",
        description="Derive, validate and keep the camera calibrations of a fleet.",
    )
    parser.add_argument(
        "--version", action="version", version=f"calibrary {__version__}", help="print the version and exit"
    )
    # The epilog lists the commands by group; argparse would list them a second time, without the groups.
    every = [
        Command(name, text, f"calibrary.cli.{name}") for _, commands in GROUPS for name, text in commands
    ]
    add_commands(parser, every, prog="calibrary", help=argparse.SUPPRESS)
    listed = [
        line
        for title, commands in GROUPS
        for line in (f"{title}:", *(f"  {name:<12}{text}" for name, text in commands), "")
    ]
    parser.epilog = "\n".join(
        [*listed, "calibrary COMMAND --help explains a command, with examples.", "", EPILOG]
    )
    return parser


def leaves(parser: argparse.ArgumentParser) -> Iterator[argparse.ArgumentParser]:
    """The parsers of all commands that can be run, without those that only group others."""
    below = [
        child
        for action in parser._actions
        if isinstance(action, argparse._SubParsersAction)
        for child in action.choices.values()
    ]
    for child in below:
        yield from leaves(child)
    yield from getattr(parser, "words", {}).values()
    if not below:
        yield parser
