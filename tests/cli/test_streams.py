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
from tests.cli.desk import COMMANDS, Printed, furnish, printed, terminal, unstyled
from tests.registry.git.repositories import seclude

READING = (
    "extract survey --dry-run",
    "calibrate --from corners.json --correlations",
    "registry show fc6310r/5472",
    "registry show fc6310r/5472 --diff HEAD~7",
    "registry log",
    "registry log fc6310r/5472",
    "registry resolve --make DJI --model FC6310R --image-size 5472x3648",
    "registry check",
    "registry audit survey",
    "registry status",
    "diff camera.xml later.xml",
    "diff --since HEAD~6",
    "inspect camera.xml",
    "formats",
    "formats colmap",
    "catalogue",
    "catalogue M3T",
)
"""Commands that say the same when they are run again."""

ONE_LINE_A_ROW = ("extract survey --dry-run",)
"""Commands that leave out columns of their table, and say so, where a terminal is very narrow."""

VERDICTS = {
    "extract survey --dry-run": r"2 cameras, judged by the fleet policy: 1 valid, 1 unproven",
    "calibrate --from corners.json --correlations": r"FIXED ",
    "registry check": r"good: ",
    "registry audit survey": r"needs attention: ",
    "registry status": r"2 for Ada Keeper; 2 entries",
    "diff camera.xml later.xml": r"drift, needs attention\. Keep using A until ",
    "diff --since HEAD~6": r"1 needs attention: ",
    "onboard payload --yes --for unit --html new/o/onboard.html": r"draft proposed: ",
    "convert camera.xml new/v/camera.yml --to opencv_storage": r"exact",
    "extract survey --output-matrix new/k/K_matrix.npy --html new/p/survey.html": r"2 cameras, judged by ",
}

ROWS = {
    "registry list": r"^dji/fc6310r/4864x3648 .* 2427\.50 +1831\.25$",
    "registry log": r"^[0-9a-f]{10} .* looked at it for a long while, over the test field in May$",
    "catalogue": r"^.*FC6310R.*$",
}
"""Commands with a wide table, and a row of it."""

REFUSED = {
    1: ("formats nonsense", "catalogue nonsense"),
    2: (
        "nonsense",
        "registry",
        "extract survey --bogus",
        "extract survey --sensor-width-mm -1",
        "undistort small.png --keep everything",
        "undistort small.png --calibration camera.xml --out",
        "calibrate",
        "calibrate --from corners.json --lens-model nonsense",
        "calibrate rig nowhere",
        "registry show fc6310r",
        "registry approve fc6310r/5472 --bogus",
        "registry add camera.xml --image-size 3x",
        "registry set P4R-03 notes",
        "diff camera.xml",
        "inspect",
        "convert camera.xml",
        "convert camera.xml later.xml new",
        "convert camera.xml x.yml",
        "calibrate --from corners.json --out k.yml",
    ),
    3: (
        "extract nowhere",
        "extract empty",
        "extract survey --policy nothing",
        "extract survey --fallback-k camera.xml",
        "extract survey --html page.txt",
        "check survey nothing.xml",
        "check survey/a.jpg",
        "undistort small.png --calibration nothing.xml",
        "calibrate empty --board checkerboard:9x6 --square-mm 40",
        "calibrate empty --board chess:9x6 --square-mm 40",
        "calibrate rig --from corners.json",
        "calibrate board checkerboard:1x1 --square-mm 40 --out b.pdf",
        "calibrate synth survey --board checkerboard:9x6 --square-mm 40",
        "calibrate flight nowhere",
        "onboard empty",
        "registry add camera.xml",
        "registry add survey/b.jpg --yes",
        "registry list --where a=b",
        "registry list --columns nothing",
        "registry resolve --make DJI",
        "registry audit nowhere",
        "registry status nowhere",
        "registry site survey",
        "registry publish survey",
        "registry set P4R-03 nothing=x",
        "diff camera.xml nothing.xml",
        "convert camera.xml x.yml --to colmap_txt",
        "convert survey/b.jpg x.xml --to pix4d",
        "demo camera.xml",
    ),
    4: (
        "extract survey --registry nowhere",
        "registry init new/fleet",
        "registry approve fc6310r/5472 --digest 000000 --reason x",
        "registry retire nothing --reason x",
        "registry list --registry nowhere",
        "registry show fc6310r@nothing",
        "registry log nothing",
        "registry resolve --make DJI --model FC9999 --image-size 5472x3648",
        "registry check nothing",
        "registry sync nowhere",
        "diff --since nothing",
    ),
}
"""What cannot be done, by exit code."""


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
        (folder / "empty").mkdir()
        yield folder


@pytest.fixture(scope="module")
def ran(desk: Path) -> dict[str, Printed]:
    """Every command of the table into a pipe, in its order."""
    assert desk.is_dir()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "40")
        return {command: printed(command) for command in COMMANDS}


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


@pytest.mark.parametrize("command", COMMANDS)
def test_a_pipe_gets_no_blanks_at_line_ends(ran: dict[str, Printed], command: str) -> None:
    assert padded(ran[command].out + ran[command].err) == []


def test_help_has_no_blanks_at_line_ends() -> None:
    assert [leaf.prog for leaf in leaves(build_parser()) if padded(leaf.format_help())] == []


@pytest.mark.usefixtures("ran")
@pytest.mark.parametrize("code", REFUSED)
def test_a_pipe_gets_a_refusal_in_one_line(code: int) -> None:
    refused = {command: printed(command) for command in REFUSED[code]}
    assert {command: done.code for command, done in refused.items() if done.code != code} == {}
    in_one_line = re.compile(r"calibrary[^\n]*: [^\n]{10,}\n")
    others = {
        command: done for command, done in refused.items() if done.out or not in_one_line.fullmatch(done.err)
    }
    assert others == {}
    assert padded("".join(done.err for done in refused.values())) == []


@pytest.mark.parametrize("command", ROWS)
def test_a_pipe_gets_a_row_of_a_table_in_one_line(ran: dict[str, Printed], command: str) -> None:
    assert re.search(ROWS[command], ran[command].out, re.MULTILINE), ran[command].out


@pytest.mark.usefixtures("ran")
@pytest.mark.parametrize("command", READING)
def test_the_same_is_said_on_a_terminal_of_every_width_and_no_word_is_broken(
    monkeypatch: pytest.MonkeyPatch, command: str
) -> None:
    said = {}
    for width in (2000, 120, 80, *(() if command in ONE_LINE_A_ROW else (60,))):
        terminal(monkeypatch, width)
        said[width] = unstyled(printed(command).out)
        assert too_wide(said[width], width) == []
    wide = words(said[2000])
    for width, text in said.items():
        assert wide - words(text) == set(), width


@pytest.mark.parametrize("command", VERDICTS)
def test_the_verdict_is_the_last_line(ran: dict[str, Printed], command: str) -> None:
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
