"""Results on standard output, remarks on standard error, whole in every width, the verdict last: every command."""

from __future__ import annotations

import argparse
import json
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest
from rich.cells import cell_len

from calibrary.cli.main import build_parser, leaves
from tests.cli.desk import COMMANDS, Printed, furnish, printed, rows
from tests.registry.git.repositories import seclude

READING = (
    "extract survey --dry-run",
    "calibrate --from corners.json --correlations",
    "registry show fc6310r/5472",
    "registry show fc6310r/5472 --diff HEAD~7",
    "registry log",
    "registry log fc6310r/5472",
    "registry log fc6310r/5472 --fields",
    "registry resolve --make DJI --model FC6310R --image-size 5472x3648",
    "registry check",
    "registry audit survey",
    "diff camera.xml later.xml",
    "diff --since HEAD~7",
    "inspect camera.xml",
    "formats",
    "formats colmap",
    "catalogue",
    "catalogue M3T",
)
"""Commands that say the same when they are run again."""

VERDICTS = {
    "extract survey --dry-run": r"2 cameras, judged by the fleet policy: 1 valid, 1 unproven",
    "calibrate --from corners.json --correlations": r"PASS ",
    "registry check": r"good: ",
    "registry audit survey": r"needs attention: ",
    "diff camera.xml later.xml": r"drift, needs attention\. Keep using A, ",
    "diff --since HEAD~7": r"1 need attention: ",
    "onboard payload --yes --for unit --html new/o/onboard.html": r"draft proposed: ",
    "convert camera.xml new/v/camera.yml --to opencv_storage": r"exact",
    "extract survey --output-matrix new/k/K_matrix.npy --html new/p/survey.html": r"2 cameras, judged by ",
}


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A furnished folder, in which every command works on the registry that the table makes."""
    folder = tmp_path_factory.mktemp("desk")
    with pytest.MonkeyPatch.context() as patch:
        seclude(patch, folder)
        patch.chdir(folder)
        patch.setenv("CALIBRARY_REGISTRY", str(folder / "new/fleet"))
        furnish(folder)
        subprocess.run(["git", "init", "--quiet", "--bare", "hub.git"], check=True, cwd=folder)
        yield folder


@pytest.fixture(scope="module")
def ran(desk: Path) -> dict[str, Printed]:
    """Every command of the table, at 80 columns, in its order."""
    assert desk.is_dir()
    with pytest.MonkeyPatch.context() as patch:
        rows(patch, 80)
        return {command: printed(command) for command in COMMANDS}


STYLE = re.compile(r"\x1b\[[\d;]*m")


def content(text: str) -> set[str]:
    return {line.strip() for line in text.splitlines() if line.strip()}


@pytest.mark.parametrize("command", COMMANDS)
def test_results_are_on_standard_output_and_not_on_standard_error(
    ran: dict[str, Printed], command: str
) -> None:
    done, (code, words) = ran[command], COMMANDS[command]
    assert done.code == code, done.err + done.out
    for word in words.split():
        assert word in done.out
    assert content(done.out).isdisjoint(content(done.err))
    assert "\x1b" not in done.out + done.err


def test_every_command_is_in_the_table() -> None:
    serving = {
        "calibrary demo",
        "calibrary calibrate flight",
        "calibrary calibrate synth",
        "calibrary calibrate watch",
    }
    """Started, and looked at, by tests of their own."""
    names = {leaf.prog for leaf in leaves(build_parser())} - serving
    assert {
        name for name in names if not any(f"calibrary {c} ".startswith(f"{name} ") for c in COMMANDS)
    } == set()


@pytest.mark.parametrize("command", COMMANDS)
def test_a_pipe_gets_no_blanks_at_line_ends(ran: dict[str, Printed], command: str) -> None:
    lines = (ran[command].out + ran[command].err).splitlines()
    assert [line for line in lines if line != line.rstrip()] == []


def test_a_pipe_gets_a_refusal_in_one_line(desk: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert desk.is_dir()
    rows(monkeypatch, 40)
    refused = printed("convert camera.xml camera.yml --to colmap_txt")
    assert refused.err.count("\n") == 1
    assert len(refused.err) > 40


@pytest.mark.usefixtures("ran")
@pytest.mark.parametrize("command", READING)
def test_the_same_is_said_on_a_terminal_of_every_width_and_no_word_is_broken(
    monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    said = {}
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    for width in (2000, 120, 80, 60):
        rows(monkeypatch, width)
        said[width] = STYLE.sub("", printed(command).out)
        assert too_wide(said[width], width) == []
    wide = words(said[2000])
    for width, text in said.items():
        assert wide - words(text) == set(), width


@pytest.mark.parametrize("command", VERDICTS)
def test_the_verdict_is_the_last_line(
    ran: dict[str, Printed], command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    rows(monkeypatch, 200)
    done = printed(command) if command in READING else ran[command]
    assert re.match(VERDICTS[command], done.last), done.out


def with_json(parser: argparse.ArgumentParser) -> bool:
    return any("--json" in action.option_strings for action in parser._actions)


@pytest.mark.usefixtures("ran")
@pytest.mark.parametrize("command", READING)
def test_json_is_one_document_and_nothing_else(command: str) -> None:
    flags = () if "--correlations" in command else ("--json",)
    done = printed(command.replace("--correlations", "--json"), *flags)
    document, end = json.JSONDecoder().raw_decode(done.out)
    assert isinstance(document, dict)
    assert done.out[end:] == "\n"


@pytest.mark.usefixtures("ran")
@pytest.mark.parametrize("command", READING)
def test_quiet_keeps_results_and_drops_remarks(command: str) -> None:
    loud, quiet = printed(command), printed(command, "--quiet")
    assert (quiet.code, quiet.out) == (loud.code, loud.out)
    assert quiet.err == ""


@pytest.mark.usefixtures("ran")
def test_verbose_says_more_on_standard_error_and_the_same_on_standard_output() -> None:
    command = "convert camera.xml again.yml --to opencv_storage"
    short, long = printed(command), printed(command, "--verbose")
    assert (short.out, short.err) == (long.out, "")
    assert "calibrary: wrote again.yml (" in long.err


@pytest.mark.usefixtures("ran")
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


def too_wide(text: str, width: int) -> list[str]:
    """Lines beyond the width, but for a word that has a line of its own."""
    return [
        line
        for line in text.splitlines()
        if cell_len(line.rstrip()) > width and len(line.split()) > 1 and not line.startswith("    colmap ")
    ]


def words(text: str) -> set[str]:
    return {word for word in text.split() if set(word) - {"─"}}
