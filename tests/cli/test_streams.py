"""Results on standard output, remarks on standard error, whole in every width, the verdict last: every command."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from rich.cells import cell_len

from calibrary.cli.main import build_parser, leaves
from tests.cli.desk import COMMANDS, READING, REFUSED, Ran, printed, terminal, unstyled

ONE_LINE_A_ROW = ("extract survey --dry-run",)
"""Commands that leave out columns of their table, and say so, where a terminal is very narrow."""
A_SCRIPT_READS = "registry resolve"
"""Whose answer is one line, however long."""

VERDICTS = {
    "extract survey --dry-run": r"2 cameras, judged by the fleet policy: 1 valid, 1 unproven",
    "calibrate --from corners.json": r"FIXED: ",
    "registry check": r"good: ",
    "registry audit survey": r"needs attention: ",
    "registry status": r"2 for Ada Keeper; 2 entries",
    "diff camera.xml later.xml": r"drift, needs attention\. Keep using A until ",
    "diff --since HEAD~6": r"1 needs attention: ",
    "onboard payload --yes --for unit --html new/o/onboard.html": r"1 camera: draft proposed",
    "convert camera.xml new/v/camera.yml --to opencv_storage": r"exact",
    "extract survey --output-matrix new/k/K_matrix.npy --html new/p/survey.html": r"2 cameras, judged by ",
}


def content(text: str) -> set[str]:
    return {line.strip() for line in text.splitlines() if line.strip()}


def test_results_are_on_standard_output_and_not_on_standard_error(ran: Ran) -> None:
    assert {command: done.code for command, done in ran.commands.items()} == COMMANDS
    for command, done in ran.commands.items():
        assert content(done.out).isdisjoint(content(done.err)), command
        assert "\x1b" not in done.out + done.err, command


def test_every_command_is_in_the_table() -> None:
    serving = {
        "calibrary demo",
        "calibrary desk",
        "calibrary calibrate flight",
        "calibrary calibrate synth",
        "calibrary calibrate watch",
    }
    """Started, and looked at, by tests of their own."""
    names = {leaf.prog for leaf in leaves(build_parser())} - serving
    assert {
        name for name in names if not any(f"calibrary {c} ".startswith(f"{name} ") for c in COMMANDS)
    } == set()


def test_a_pipe_gets_no_blanks_at_line_ends(ran: Ran) -> None:
    for command, done in ran.commands.items():
        assert padded(done.out + done.err) == [], command


def test_help_has_no_blanks_at_line_ends() -> None:
    assert [leaf.prog for leaf in leaves(build_parser()) if padded(leaf.format_help())] == []


def test_a_pipe_gets_a_refusal_in_one_line(ran: Ran) -> None:
    codes = {command: code for code, commands in REFUSED.items() for command in commands}
    assert {command: done.code for command, done in ran.refused.items() if done.code != codes[command]} == {}
    in_one_line = re.compile(r"calibrary[^\n]*: [^\n]{10,}\n")
    others = {
        command: done
        for command, done in ran.refused.items()
        if done.out or not in_one_line.fullmatch(done.err)
    }
    assert others == {}
    assert padded("".join(done.err for done in ran.refused.values())) == []


@pytest.mark.usefixtures("desk")
@pytest.mark.parametrize("command", READING)
def test_the_same_is_said_on_a_terminal_of_every_width_and_no_word_is_broken(
    monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    said = {}
    for width in (2000, 120, 80, *(() if command in ONE_LINE_A_ROW else (60,))):
        terminal(monkeypatch, width)
        said[width] = unstyled(printed(command).out)
        assert command.startswith(A_SCRIPT_READS) or too_wide(said[width], width) == []
    wide = words(said[2000])
    for width, text in said.items():
        assert wide - words(text) == set(), width


@pytest.mark.usefixtures("desk")
@pytest.mark.parametrize("command", VERDICTS)
def test_the_verdict_is_the_last_line(ran: Ran, command: str) -> None:
    done = printed(command) if command in READING else ran.commands[command]
    assert re.match(VERDICTS[command], done.last), done.out


def test_json_is_one_document_and_nothing_else(ran: Ran) -> None:
    for command, done in ran.documents.items():
        document, end = json.JSONDecoder().raw_decode(done.out)
        assert isinstance(document, dict), command
        assert done.out[end:] == "\n", command


@pytest.mark.usefixtures("desk")
@pytest.mark.parametrize("command", READING)
def test_quiet_keeps_results_and_drops_remarks(command: str) -> None:
    loud, quiet = printed(command), printed(command, "--quiet")
    assert (quiet.code, quiet.out) == (loud.code, loud.out)
    assert quiet.err == ""


@pytest.mark.usefixtures("desk")
def test_verbose_says_more_on_standard_error_and_the_same_on_standard_output() -> None:
    command = "convert camera.xml again.yml --to opencv_storage"
    short, long = printed(command), printed(command, "--verbose")
    assert (short.out, short.err) == (long.out, "")
    assert "calibrary: wrote again.yml (" in long.err


@pytest.mark.usefixtures("desk")
def test_verbose_says_what_was_read_and_what_was_skipped_and_how_long_each_part_took() -> None:
    broken = Path("flight_with_a_broken_image")
    broken.mkdir(exist_ok=True)
    (broken / "torn.jpg").write_bytes(b"\xff\xd8\xff\xe1")
    said = printed(f"extract {broken} --dry-run --verbose").err
    assert "calibrary: skipped torn.jpg: " in said
    for part in ("read the heads of 1 images", "derived and judged K", "in all"):
        assert re.search(rf"^calibrary: {part}: \d+\.\d\d s$", said, re.MULTILINE), part
    said = printed("inspect camera.xml --verbose").err
    assert re.search(r"^calibrary: read camera\.xml: \d+\.\d\d s$", said, re.MULTILINE)


def padded(text: str) -> list[str]:
    """Lines that end in blanks."""
    return [line for line in text.splitlines() if line != line.rstrip()]


def too_wide(text: str, width: int) -> list[str]:
    """Lines beyond the width, but for a word that has a line of its own."""
    return [
        line
        for line in text.splitlines()
        if cell_len(line.rstrip()) > width and len(line.split()) > 1 and not line.startswith("    colmap ")
    ]


def words(text: str) -> set[str]:
    return {word for word in text.split() if set(word) - {"─"}}
