"""No advice names a command or a flag that does not exist: messages, help, README and the documentation."""

from __future__ import annotations

import ast
import re
import shlex
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from calibrary.cli.main import build_parser, leaves
from tests.house.project import ROOT

SOURCES = sorted(
    path
    for room in ("src/calibrary", "calib", "parsers", "registry")
    for path in (ROOT / room).rglob("*.py")
    if not any(part.is_symlink() for part in path.parents)
)
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
PROGS = {leaf.prog: leaf for leaf in leaves(build_parser())}
GROUPING = {"calibrary", "calibrary registry"}
QUOTED = re.compile(r"'(calibrary [a-z][^'\n]*)'|``?(calibrary [a-z][^`\n]*?)``?")
UNQUOTED = re.compile(
    r"\b(calibrary(?: registry)? [a-z]+)(?= [A-Z<{\-]|:? calibrary)|: (calibrary(?: registry)? [a-z]+)\b"
)


@cache
def parsed(path: Path) -> tuple[ast.AST, ...]:
    """Every node of a source."""
    return tuple(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))


def said_in_code() -> Iterator[tuple[str, str]]:
    """Every string of the sources, its formatted values as a word, with where it is."""
    for path in SOURCES:
        name = path.relative_to(ROOT)
        for node in parsed(path):
            if isinstance(node, ast.JoinedStr):
                parts = (p.value if isinstance(p, ast.Constant) else "VALUE" for p in node.values)
                yield f"{name}:{node.lineno}", "".join(map(str, parts))
            elif isinstance(node, ast.Constant) and isinstance(node.value, str):
                yield f"{name}:{node.lineno}", node.value


@cache
def advised() -> list[tuple[str, str]]:
    texts = [*said_in_code(), *((path.name, path.read_text(encoding="utf-8")) for path in DOCUMENTS)]
    found = {
        (where, next(filter(None, match.groups())))
        for where, text in texts
        if "calibrary" in text
        for pattern in (QUOTED, UNQUOTED)
        for match in pattern.finditer(re.sub(r"\n +", " ", text))
    }
    return sorted(found)


def problem(command: str) -> str | None:
    """What is wrong with a command that a message asks to type, None if nothing is."""
    # The one command that is also written as a flag.
    command = command.replace("calibrary calibrate --rig", "calibrary calibrate rig")
    try:
        words = shlex.split(command.replace("…", " ").replace("'", " "))
    except ValueError:
        words = command.split()
    prog = next((" ".join(words[:n]) for n in (4, 3, 2) if " ".join(words[:n]) in PROGS), None)
    if len(words) > 2 and " ".join(words[:3]) in GROUPING:
        return None if prog is not None or len(words) == 3 else "no such command"
    if (
        prog is None
        and words[:2] == ["calibrary", "registry"]
        and re.fullmatch("[a-z]+", "".join(words[2:3]))
    ):
        return "no such command"
    if prog is None:
        return (
            None
            if " ".join(words[:2]) in GROUPING or words[:2] == ["calibrary", "COMMAND"]
            else "no such command"
        )
    known = {flag for action in PROGS[prog]._actions for flag in action.option_strings}
    named = re.findall(r"(?<![\w-])--[a-z][\w-]*", command)
    unknown = sorted(set(named) - known)
    return f"no such flag: {', '.join(unknown)}" if unknown else None


def test_every_command_advised_is_one() -> None:
    assert len(advised()) > 100
    wrong = [f"{where}: {command}: {what}" for where, command in advised() if (what := problem(command))]
    assert wrong == []


@pytest.mark.parametrize(
    ("command", "wrong"),
    [
        ("calibrary regster add FILE", "no such command"),
        ("calibrary registry put FILE", "no such command"),
        ("calibrary extract --images flight", "no such flag: --images"),
        ("calibrary registry add FILE --yes", None),
    ],
)
def test_what_does_not_exist_is_noticed(command: str, wrong: str | None) -> None:
    assert problem(command) == wrong


PYTHONIC = re.compile(r"(?<![-\w.])(format|image_size|max_error_px|options|max_bytes|workers|registry)=")
"""Arguments of functions, where a message of the command line would name a flag."""


def test_messages_speak_in_flags_not_in_arguments_of_functions() -> None:
    """Messages, that is: the strings that errors are raised with, but for what only a Python program can call."""
    found = []
    for path in SOURCES:
        if "interop" in path.parts:
            continue
        for node in parsed(path):
            if isinstance(node, ast.Raise) and isinstance(node.exc, ast.Call):
                for part in node.exc.args:
                    texts = [c.value for c in ast.walk(part) if isinstance(c, ast.Constant)]
                    found += [
                        f"{path.relative_to(ROOT)}:{node.lineno}: {text}"
                        for text in texts
                        if isinstance(text, str) and PYTHONIC.search(text)
                    ]
    assert found == []


def test_paths_of_the_sources_are_found_once() -> None:
    assert len({path.resolve() for path in SOURCES}) == len(SOURCES)
    assert Path(ROOT / "src/calibrary/cli/main.py") in SOURCES
