"""What messages say to do: in flags of the command line, which exist, never in arguments of Python."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from calibrary import parsers
from calibrary.cli.main import build_parser

ROOM = Path(parsers.__file__).resolve().parent
PYTHON = re.compile(r"\b(?:options=|image_size\b|max_error_px\b|max_bytes\b|format=)")
FLAG = re.compile(r"(?<![\w-])--[a-z][a-z_-]+")
OF_OTHER_PROGRAMS = {"--output-type", "--output_type", "--cameras"}
OF_CONVERT = {"--to", "--max-error-px", "--allow-prior", "--drop-distortion", "--force"}
OF_OURS = {
    "--image-size",
    "--size-from-centre",
    "--pixel-origin",
    "--format",
    "--set",
    "--max-size-mib",
    *OF_CONVERT,
}


@cache
def sentences() -> tuple[tuple[str, str], ...]:
    """Every text of several words in the room that is not documentation, with the place where it is written."""
    return tuple(_sentences())


def _sentences() -> Iterator[tuple[str, str]]:
    for path in sorted(ROOM.rglob("*.py")):
        nodes = [*ast.walk(ast.parse(path.read_text(encoding="utf-8")))]
        documentation = {
            id(node.value)
            for node in nodes
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        }
        documentation |= {
            id(word.value)
            for node in nodes
            if isinstance(node, ast.Call)
            for word in node.keywords
            if word.arg == "words"
        }
        for node in nodes:
            text = node.value if isinstance(node, ast.Constant) else None
            if isinstance(text, str) and " " in text and id(node) not in documentation:
                yield path.name, text


def test_no_message_speaks_of_pythons_arguments() -> None:
    assert [(place, text) for place, text in sentences() if PYTHON.search(text)] == []


def test_every_flag_that_a_message_names_is_one_of_inspect_or_convert() -> None:
    named = {flag for _, text in sentences() for flag in FLAG.findall(text)} - OF_OTHER_PROGRAMS
    assert named <= OF_OURS
    assert "--image-size" in named


def test_every_answer_that_a_message_asks_for_is_an_option_of_a_format() -> None:
    options = {
        (option.name, value)
        for record in parsers.formats()
        for option in record.options
        for value in option.values
    }
    asked = {pair for _, text in sentences() for pair in re.findall(r"--set (\w+)=([\w-]+)", text)}
    assert asked
    assert asked <= options


@pytest.mark.parametrize("flag", sorted(OF_OURS))
def test_the_flags_exist(flag: str) -> None:
    values = {
        "--image-size": "5472x3648",
        "--format": "kalibr",
        "--set": "a=b",
        "--max-size-mib": "100",
        "--max-error-px": "1",
        "--pixel-origin": "corner",
        "--to": "kalibr",
    }
    command = ["convert", "in.yml", "out.xml"] if flag in OF_CONVERT else ["inspect", "in.yml"]
    value = [values[flag]] if flag in values else []
    build_parser().parse_args([*command, flag, *value])  # it exits where it knows no such flag


def test_every_command_of_ours_that_a_message_names_exists() -> None:
    known = build_parser().format_help()
    for _, text in sentences():
        for command in re.findall(r"\bcalibrary ([a-z]+)\b", text):
            assert command in known
