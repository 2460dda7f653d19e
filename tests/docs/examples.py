"""Blocks of Markdown that show commands and Python with what they print: found, run in order, compared."""

from __future__ import annotations

import io
import os
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import chdir, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path

from calibrary.cli.main import main
from tests.pages.sketches import sketched

ELISION = "…"
"""Alone on a line it stands for any number of lines, within a line for any text."""

FENCE = re.compile(
    r"(?ms)(?:^<!-- not run: (?P<reason>[^\n]+) -->\n\n?)?^```(?P<kind>console|python|sh)\n(?P<text>.*?)^```$"
)
SHELL = re.compile(r"[|<>&;*`$]|\\$")
BIN = Path(sys.executable).parent


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """One fence of a page.

    Attributes:
        kind: console, python or sh.
        text: what is in it.
        line: of the page, for messages.
        reason: why it is not run, None where it is.
    """

    kind: str
    text: str
    line: int
    reason: str | None

    def steps(self) -> Iterator[tuple[str, str]]:
        """Each command of a console with what is shown below it."""
        for part in re.split(r"(?m)^\$ ", self.text)[1:]:
            command, _, shown = part.partition("\n")
            while command.endswith("\\"):
                more, _, shown = shown.partition("\n")
                command = f"{command[:-1]}{more.strip()}"
            yield command, shown

    def printed(self) -> str:
        """What a block of Python says that it prints: its comments at the beginning of a line."""
        return "\n".join(re.findall(r"(?m)^# ?(.*)$", self.text))


def blocks(text: str) -> list[Block]:
    """The blocks of a page that show commands or Python."""
    return [
        Block(
            kind=match["kind"],
            text=match["text"],
            line=text.count("\n", 0, match.start("text")),
            reason=match["reason"],
        )
        for match in FENCE.finditer(text)
    ]


def matches(shown: str, printed: str) -> bool:
    """Whether the output is what a page shows, elisions apart."""
    pattern = ""
    for line in _lines(shown):
        if line.strip() == ELISION:
            pattern += r"(?:[^\n]*\n)*?"
        else:
            pattern += r"[^\n]*?".join(re.escape(part) for part in line.split(ELISION)) + r"\n"
    return re.fullmatch(pattern, "".join(f"{line}\n" for line in _lines(printed))) is not None


def _lines(text: str) -> list[str]:
    lines = [line.rstrip() for line in text.strip("\n").splitlines()]
    return [line for line in lines if line]


@dataclass(slots=True)
class Desk:
    """A folder in which the blocks of a page are run one after the other.

    Attributes:
        folder: where the reader is.
        names: what the blocks of Python have defined.
        code: with which the last command ended.
    """

    folder: Path
    names: dict[str, object] = field(default_factory=dict)
    code: int = 0

    def command(self, line: str) -> str:
        """Run a line of a console; returns what it prints, on either stream."""
        if line == "echo $?":
            said, self.code = f"{self.code}\n", 0
            return said
        words = shlex.split(line)
        if words[0] == "cd":
            self.folder = (self.folder / words[1]).resolve()
            return ""
        if words[0] == "export":
            name, _, value = words[1].partition("=")
            os.environ[name] = value
            return ""
        if words[0] != "calibrary" or SHELL.search(line):
            return self._shell(line)
        out = io.StringIO()
        with chdir(self.folder), redirect_stdout(out), redirect_stderr(out), sketched():
            try:
                self.code = main(words[1:])
            except SystemExit as ended:
                self.code = int(ended.code or 0)
        return out.getvalue()

    def python(self, code: str) -> str:
        """Run a block of Python; returns what it prints."""
        out = io.StringIO()
        with chdir(self.folder), redirect_stdout(out):
            exec(compile(code, "<page>", "exec"), self.names)  # noqa: S102  our own pages
        return out.getvalue()

    def _shell(self, line: str) -> str:
        path = os.pathsep.join([str(self.folder / "bin"), str(BIN), os.environ["PATH"]])
        done = subprocess.run(
            [shutil.which("sh") or "/bin/sh", "-c", line],
            cwd=self.folder,
            env={**os.environ, "PATH": path},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
        )
        self.code = done.returncode
        return done.stdout
