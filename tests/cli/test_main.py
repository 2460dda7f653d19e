"""The command line as a whole: help that helps, exit codes, and no traceback for anybody."""

from __future__ import annotations

import argparse
import logging
import os
import re
import shlex
import signal
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import version

import pytest

from calibrary.__main__ import main as entry_point
from calibrary.cli.main import GROUPS, _logging, build_parser, main
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


def test_the_name_alone_shows_the_commands_by_job(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    printed = capsys.readouterr().err
    titles = re.findall(r"^(\w.*):\n  \w", printed, re.MULTILINE)
    assert [title for title in titles if title not in {"options", "exit codes"}] == [
        name for name, _ in GROUPS
    ]
    assert set(re.findall(r"^  (\w+) +\w", printed, re.MULTILINE)) >= set(commands())


@pytest.mark.parametrize(
    ("argv", "said"),
    [
        (["extract", "--no-such-flag"], "calibrary extract: unrecognized arguments: --no-such-flag"),
        (
            ["extract", "a", "--image-dir", "b"],
            "calibrary extract: DIR and --image-dir are the same; give one of them",
        ),
        (
            ["extract", "--workers", "x"],
            "calibrary extract: argument --workers: 'x': expected a whole number",
        ),
        (["extract", "--quiet", "--verbose"], "calibrary extract: argument --verbose/-v: not allowed with"),
        (
            ["registry", "retire", "x"],
            "calibrary registry retire: the following arguments are required: --reason, as in 'calibrary registry",
        ),
        (["registry"], "calibrary registry: the following arguments are required: COMMAND"),
        (
            ["calibrate", "board", "x"],
            "calibrary calibrate board: the following arguments are required: --out, --square-mm",
        ),
        (["extrct"], "calibrary: argument COMMAND: there is no 'extrct'; did you mean extract?"),
        (
            ["extract", "--to", "colmp"],
            "calibrary extract: argument --to: there is no 'colmp'; did you mean colmap?",
        ),
    ],
)
def test_a_misunderstanding_is_one_line_that_says_where_help_is(
    argv: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(argv)
    printed = capsys.readouterr()
    assert (ended.value.code, printed.out, printed.err.count("\n")) == (2, "", 1)
    assert printed.err.startswith(said)
    prog = said.partition(":")[0]
    assert printed.err.endswith(f" see '{prog} --help'\n")


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

    monkeypatch.setattr("calibrary.catalogue.search_catalogue", failing)
    assert main(["catalogue"]) == code
    assert capsys.readouterr().err == "calibrary: broken\n"


def test_a_bug_is_called_one_and_shows_no_traceback(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def failing(*_: object) -> None:
        raise ZeroDivisionError("by nought")

    monkeypatch.setattr("calibrary.catalogue.search_catalogue", failing)
    assert main(["catalogue"]) == 70
    printed = capsys.readouterr().err
    assert "this is a bug: ZeroDivisionError: by nought" in printed
    assert "Traceback" not in printed
    monkeypatch.setenv("CALIBRARY_DEBUG", "1")
    with pytest.raises(ZeroDivisionError):
        main(["catalogue"])


@pytest.mark.parametrize("flags", [["catalogue", "--json"], ["catalogue"]])
def test_a_reader_that_has_gone_ends_the_command_quietly_as_it_ends_others(flags: list[str]) -> None:
    """As in ``calibrary catalogue --json | head -1``: 141, which a shell gives a command that SIGPIPE ended."""
    command = [sys.executable, "-m", "calibrary", *flags]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        printed = process.stderr.read()
    assert (process.returncode, printed) == (141, b"")


def loaded_by(argv: list[str]) -> set[str]:
    """The modules that are loaded when a command has run."""
    code = (
        "import sys\nfrom calibrary.cli.main import main\n"
        f"try:\n    main({argv!r})\nexcept SystemExit:\n    pass\n"
        "print(*sys.modules, sep='\\n', file=sys.stderr)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return set(done.stderr.split())


@pytest.mark.parametrize(
    ("argv", "loaded"), [(["--version"], set()), (["--help"], set()), (["formats", "--help"], {"formats"})]
)
def test_only_the_command_that_is_named_is_loaded(argv: list[str], loaded: set[str]) -> None:
    modules = loaded_by(argv)
    assert {name for name in commands() if f"calibrary.cli.{name}" in modules} == loaded
    assert not modules & {"numpy", "rich"}
    assert loaded or "msgspec" not in modules


def test_no_commands_help_loads_what_does_its_work() -> None:
    code = (
        "import sys\nfrom calibrary.cli.main import build_parser, leaves\n"
        "for leaf in leaves(build_parser()):\n    leaf.format_help()\n"
        "print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {*done.stdout.split()} & {"numpy", "rich", "PIL", "cv2", "git", "jinja2"}


def test_a_look_into_the_catalogue_loads_no_numpy() -> None:
    modules = loaded_by(["catalogue", "M3T"])
    assert "calibrary.catalogue" in modules
    assert "numpy" not in modules


@pytest.fixture
def kept_signals() -> Iterator[None]:
    """A program that ends is deaf to signals; the tests after it, and the programs that they start, must not be."""
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.usefixtures("kept_signals")
@pytest.mark.parametrize(("before", "after"), [(None, "1"), ("4", "4")])
def test_one_thread_does_the_linear_algebra_unless_the_user_says_otherwise(
    before: str | None, after: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Set first, so that what the command line leaves behind is taken away again.
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", before or "")
    if before is None:
        monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    monkeypatch.setattr(sys, "argv", ["calibrary", "--version"])
    with pytest.raises(SystemExit):
        entry_point()
    assert os.environ["OPENBLAS_NUM_THREADS"] == after


@pytest.mark.parametrize(("verbose", "told"), [(0, []), (1, ["read"]), (2, ["read", "looked"])])
def test_verbose_tells_the_steps_and_twice_the_details(
    verbose: int, told: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    logger = logging.getLogger("calibrary.somewhere")
    with _logging(verbose):
        logger.debug("looked")
        logger.info("read")
    logger.warning("later")
    said = capsys.readouterr().err
    assert sorted(word for word in ("read", "looked", "later") if f"calibrary: {word}\n" in said) == sorted(
        told
    )
