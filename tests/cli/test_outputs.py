"""All that each command prints and writes, kept in ``outputs/``: what differs is shown, and ``make golden`` accepts it.

What differs from run to run is masked: the folder, dates and times of today, commits and statements, versions; pictures
and the drawn parts of pages are left out. Numbers are kept to the digits that every processor finds.
"""

from __future__ import annotations

import difflib
import os
import re
import subprocess
from collections.abc import Callable
from datetime import UTC, date, datetime, timedelta
from pathlib import Path

import numpy as np

from tests.cli.desk import Printed, Ran

KEPT = Path(__file__).with_name("outputs")
ACCEPT = os.environ.get("GOLDEN") == "accept"
LISTS = {"completion bash", "formats", "catalogue"}
"""Lists of all formats, cameras and flags: one more is no other output."""
OF_OTHERS = (
    "/.git/",
    "schema/",
    ".publishing/",
    "flat/small.png",
    "DISTORTION.md",
    "site/files/",
    "4864x3648.html",
)
"""Copies of what is kept elsewhere, and pictures that a library encodes."""
VALID = (89, 90, 91)
"""Days for which a publication is valid, counted from either midnight."""
DIGITS = 7
SHOWN = 60
"""Lines of a difference."""


def outputs(ran: Ran) -> dict[str, str]:
    """Every command's output by its name, and every file that was written by its path."""
    mask = masker(ran.folder)
    told: dict[str, str] = {}
    for command, done in {**ran.commands, **ran.documents}.items():
        if command.removesuffix(" --json") not in LISTS:
            told[_name(command)] = told.get(_name(command), "") + mask(shown(command, done))
    told["refused.txt"] = "".join(mask(shown(command, done)) for command, done in ran.refused.items())
    for path in sorted((ran.folder / "new").rglob("*"), key=_place):
        name = path.relative_to(ran.folder).as_posix()
        if path.is_file() and not any(other in name for other in OF_OTHERS):
            told[mask(name)] = mask(content(path))
    return told


def _place(path: Path) -> tuple[str, str]:
    """Where a file comes: a statement, whose name is a digest, by what it says."""
    if "events" not in path.parts or not path.is_file():
        return str(path), ""
    return str(path.parent), re.sub(r"[0-9a-f]{32}", "", path.read_text(encoding="utf-8"))


def _name(command: str) -> str:
    """The file of a command: its words before what it is given."""
    words = command.split()
    return (
        f"{'-'.join(words[: 2 if words[0] == 'registry' or words[1:2] in (['rig'], ['board']) else 1])}.txt"
    )


def shown(command: str, done: Printed) -> str:
    """A command, its results, its remarks and its exit code."""
    remarks = "".join(f"! {line}\n" for line in done.err.splitlines())
    return f"$ calibrary {command}\n{done.out}{remarks}= {done.code}\n\n"


def content(path: Path) -> str:
    """A file as text; the pictures, styles and scripts of a page are tested where they are made."""
    if path.suffix == ".npy":
        return f"{np.load(path)}\n"
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        return "not text\n"
    if path.suffix == ".html":
        text = re.sub(r"(?s)<(svg|style|script)\b.*?</\1>", r"<\1/>", text)
        text = re.sub(r"(?<=>)(?=<)", "\n", text)
    return text


def masker(desk: Path) -> Callable[[str], str]:
    """Replaces what differs from run to run, by as many characters: tables stay as wide as they are."""
    commits = _git(desk / "new/fleet", "rev-list", "--all").split()
    statements = [path.stem[-32:] for path in (desk / "new/fleet/events").rglob("*") if path.is_file()]
    numbers: dict[str, int] = {}

    def numbered(match: re.Match[str]) -> str:
        for known in (*commits, *statements):
            if known.startswith(match[0]):
                number = numbers.setdefault(known, len(numbers) + 1)
                return f"<{number}>".ljust(len(match[0]), "-")
        return match[0]

    today = datetime.now(UTC).date()
    days = {day.isoformat() for off in (-1, 0, 1, *VALID) for day in (today + timedelta(off), date.today())}

    def masked(text: str) -> str:
        text = text.replace(str(desk), "/desk")
        text = re.sub(r"\b[0-9a-f]{7,40}\b", numbered, text)
        text = re.sub(rf"(?:{'|'.join(days)})(?:([T ])\d\d:\d\d(?::\d\d)?)?", _no_day, text)
        text = re.sub(r'"(version|until)":("?)[-0-9T:Z]+', r'"\1":\2', text)
        text = re.sub(r'(calibrary|Unicode|opencv|OpenCV|numpy)(": "| )\d+\.\d+\.\d+', r"\1\2VERSION", text)
        text = re.sub(r"-?\d+\.\d+(?:e[-+]?\d+)?", _rounded, text)
        # A document is one line: it is compared field by field.
        return re.sub(r"(?m)^\{.*", lambda line: re.sub(r',(?= ?["{])', ",\n", line[0]), text)

    return masked


def _no_day(match: re.Match[str]) -> str:
    return re.sub(r"\d", "0", match[0])


def _rounded(match: re.Match[str]) -> str:
    """A number with fewer digits, if it has more than every processor finds."""
    digits = re.sub(r"e.*|[-.]", "", match[0]).lstrip("0")
    return match[0] if len(digits) <= DIGITS else f"{float(match[0]):.{DIGITS}g}"


def _git(folder: Path, *words: str) -> str:
    return subprocess.run(["git", "-C", folder, *words], check=True, capture_output=True, text=True).stdout


def test_every_command_prints_and_writes_what_is_kept(ran: Ran) -> None:
    told = outputs(ran)
    kept = {path.relative_to(KEPT).as_posix(): path for path in KEPT.rglob("*") if path.is_file()}
    if ACCEPT:
        for name in kept.keys() - told.keys():
            kept[name].unlink()
        for name, text in told.items():
            (KEPT / name).parent.mkdir(parents=True, exist_ok=True)
            (KEPT / name).write_text(text, encoding="utf-8")
        return
    before = {name: path.read_text(encoding="utf-8") for name, path in kept.items()}
    difference = [
        line
        for name in sorted(before.keys() | told.keys())
        if before.get(name) != told.get(name)
        for line in difflib.unified_diff(
            before.get(name, "").splitlines(), told.get(name, "").splitlines(), name, name, lineterm="", n=1
        )
    ]
    shown = "\n".join(difference[:SHOWN])
    assert not difference, f"{len(difference)} lines differ; if they should: make golden\n{shown}"
