"""A flag is told three times: in its job's signature, in a line of its docstring, and in tests."""

from __future__ import annotations

import argparse
import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import calibrary
from calibrary.cli.main import build_parser, leaves

OF_EVERY_COMMAND = {"help", "json", "table", "image_table", "quiet", "verbose", "yes", "dry_run"}
"""What is printed and asked, and whether to write at all; no job has such a parameter."""
OF_ONE = {
    "calibrary extract": {"explain", "image_dir", "list_file"},
    "calibrary calibrate": {"correlations"},
    "calibrary calibrate flight": {"correlations"},
    "calibrary registry export": {"public"},
    "calibrary desk": {"no_open"},
    "calibrary registry audit": {"explain"},
    "calibrary registry show": {"yaml"},
    "calibrary registry set": {"words"},
    "calibrary registry add": {"sync"},
    "calibrary registry approve": {"sync"},
}
"""Another form of what is printed, or of where images are; which of a command's jobs are done; keys and changes, by
their form."""

COMMANDS = {leaf.prog: leaf for leaf in leaves(build_parser())}
SOURCE = Path(calibrary.__file__).parent
FACES = sorted((SOURCE / "jobs").glob("*/__init__.py"))
LEAST = 40
"""Letters of a sentence that two places do not say alike by chance."""


def of_no_job(parser: argparse.ArgumentParser) -> set[str]:
    """Flags and positionals of a command that are no parameter of a job."""
    known = OF_EVERY_COMMAND | OF_ONE.get(parser.prog, set())
    return {one.dest for one in parser._actions if not hasattr(one, "parameter")} - known


@pytest.mark.parametrize("command", COMMANDS)
def test_every_flag_is_a_parameter_of_a_job(command: str) -> None:
    left = sorted(of_no_job(COMMANDS[command]))
    assert not left, f"it declares {', '.join(left)} by itself; a parameter of its job does that"


def told(path: Path) -> Iterator[tuple[str, str]]:
    """Each parameter or field that a module explains, with the sentence."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.FunctionDef | ast.ClassDef):
            continue
        for section in ("Args:\n", "Attributes:\n"):
            body = (ast.get_docstring(node) or "").partition(section)[2].partition("\n\n")[0]
            for name, text in re.findall(r"^ {4}(\w+): (.+(?:\n {8}.+)*)", body, re.MULTILINE):
                yield name, " ".join(text.split())


def test_what_a_job_says_of_a_flag_stands_in_no_other_module() -> None:
    said = {pair for face in FACES for pair in told(face) if len(pair[1]) >= LEAST}
    others = [path for path in SOURCE.rglob("*.py") if path not in FACES]
    again = {pair: path.relative_to(SOURCE) for path in others for pair in told(path) if pair in said}
    assert not again
