"""The command line as a whole: help that helps, exit codes, and no traceback for anybody."""

from __future__ import annotations

import argparse
import re
import shlex
import subprocess
import sys
from importlib.metadata import version

import pytest

from calibrary.cli.main import build_parser, main
from calibrary.errors import (
    CalibraryError,
    CalibrationError,
    InputError,
    RegistryError,
    UnknownFormatError,
    ValidationError,
)
from calibrary.validation import Report


def commands(parser: argparse.ArgumentParser | None = None) -> dict[str, argparse.ArgumentParser]:
    """The commands right below a parser; of the whole command line if it is left out."""
    actions = (parser or build_parser())._actions
    return {
        name: below
        for action in actions
        if isinstance(action, argparse._SubParsersAction)
        for name, below in action.choices.items()
    }


def words(parser: argparse.ArgumentParser | None = None) -> dict[str, argparse.ArgumentParser]:
    """Every command that can be given, by all of its words: "registry show", but not "registry" alone."""
    found: dict[str, argparse.ArgumentParser] = {}
    for name, below in commands(parser).items():
        deeper = words(below)
        found |= {f"{name} {more}": one for more, one in deeper.items()} if deeper else {name: below}
    return found


def printed_by(argv: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as ended:
        main(argv)
    assert ended.value.code == 0
    return capsys.readouterr().out


def test_help_lists_every_command_and_every_exit_code(capsys: pytest.CaptureFixture[str]) -> None:
    text = printed_by(["--help"], capsys)
    for name in commands():
        assert re.search(rf"^ +{name}\s+\w", text, re.MULTILINE)
    for code in range(5):
        assert re.search(rf"^ +{code}  \w", text, re.MULTILINE)


@pytest.mark.parametrize("name", words())
def test_a_commands_help_ends_with_examples_that_are_understood(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    text = printed_by([*name.split(), "--help"], capsys)
    examples = re.findall(
        rf"^  calibrary ({name}\b.*?)(?:   .*)?$", text.partition("examples:")[2], re.MULTILINE
    )
    assert examples
    for example in examples:
        assert build_parser().parse_args(shlex.split(example)).run


@pytest.mark.parametrize("name", words())
def test_every_flag_is_explained(name: str) -> None:
    for action in words()[name]._actions:
        assert action.help, action.option_strings


@pytest.mark.parametrize("name", [name for name, parser in commands().items() if commands(parser)])
def test_a_commands_help_lists_the_commands_below_it(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    text = printed_by([name, "--help"], capsys)
    for below in commands(commands()[name]):
        assert re.search(rf"^ +{below}\s+\w", text, re.MULTILINE)


def test_the_version_is_the_packages(capsys: pytest.CaptureFixture[str]) -> None:
    assert printed_by(["--version"], capsys) == f"calibrary {version('calibrary')}\n"


def test_no_command_is_a_misunderstanding(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([])
    assert ended.value.code == 2
    assert "COMMAND" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (ValidationError("broken", Report(policy="fleet")), 1),
        (CalibrationError("broken"), 1),
        (InputError("broken"), 3),
        (UnknownFormatError("broken"), 3),
        (RegistryError("broken"), 4),
    ],
)
def test_each_kind_of_error_has_its_exit_code(
    error: CalibraryError, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def failing(*_: object) -> None:
        raise error

    monkeypatch.setattr("calibrary.registry.catalogue.load_catalogue", failing)
    assert main(["catalogue"]) == code
    assert capsys.readouterr().err == "calibrary: broken\n"


def test_a_bug_is_called_one_and_shows_no_traceback(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def failing() -> None:
        raise ZeroDivisionError("by nought")

    monkeypatch.setattr("calibrary.registry.catalogue.load_catalogue", failing)
    assert main(["catalogue"]) == 70
    told = capsys.readouterr().err
    assert "this is a bug: ZeroDivisionError: by nought" in told
    assert "Traceback" not in told
    monkeypatch.setenv("CALIBRARY_DEBUG", "1")
    with pytest.raises(ZeroDivisionError):
        main(["catalogue"])


def test_a_reader_that_has_seen_enough_is_no_error() -> None:
    """As in ``calibrary catalogue --json | head -1``."""
    command = [sys.executable, "-m", "calibrary.cli.main", "catalogue", "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.readline()
        process.stdout.close()
        told = process.stderr.read()
    assert (process.returncode, told) == (0, b"")
