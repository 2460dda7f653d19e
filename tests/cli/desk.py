"""A desk with one small example of everything, and what every command prints there, run once in order."""

from __future__ import annotations

import contextlib
import io
import re
import shlex
import subprocess
from dataclasses import dataclass
from pathlib import Path

import pytest

from calibrary.cli.main import main
from calibrary.registry.registry import Registry
from tests.calib.rigs import write_rig_corners
from tests.cli.registry.fleets import xml
from tests.jobs.calibrate.boards import corners
from tests.jobs.extract.fleet import DEWARP, NOBODY, P4R, picture
from tests.jobs.onboard.payloads import survey
from tests.pages.sketches import sketched

KEY = "--make DJI --model FC6310R"
COMMANDS: dict[str, int] = {
    "registry init new/fleet": 0,
    "extract survey --output-matrix new/k/K_matrix.npy --html new/p/survey.html": 1,
    "extract survey --to odm --task new/task --output-matrix new/odm/K_matrix.npy": 1,
    "extract survey --dry-run --policy source": 1,
    "check survey/a.jpg camera.xml": 1,
    "undistort small.png --calibration small.txt --out new/flat": 0,
    "calibrate --from corners.json --out new/c/lens.yml --to opencv_storage --html new/c/r.html": 0,
    "calibrate --from corners.json": 0,
    "calibrate --from corners.json --correlations": 0,
    "calibrate rig --from rig/rig.json --lens-model k1k2p1p2 --out new/c/camchain.yaml": 0,
    "calibrate board checkerboard:11x8 --square-mm 40 --out new/b/board.pdf": 0,
    f"registry add camera.xml {KEY} --reason first --yes": 0,
    "registry approve fc6310r --digest DIGEST --reason 'looked at it for a long while, over the test field in May'": 0,
    f"registry add later.xml {KEY} --approve --yes --reason 'the lens was sent to the maker and came back'": 0,
    f"registry add other.xml {KEY} --approve --yes": 0,
    "registry list": 0,
    "registry show fc6310r/5472": 0,
    "registry show fc6310r/5472 --diff HEAD~3": 0,
    "registry log": 0,
    "registry log fc6310r/5472": 0,
    f"registry resolve {KEY} --image-size 5472x3648": 0,
    "registry check": 0,
    "registry audit survey --html new/a/audit.html": 1,
    "registry status": 0,
    "registry lock --out new/l/calibrary.lock": 0,
    "registry export --to csv --out new/e/fleet.csv": 0,
    "registry site new/w/site --workers 1": 0,
    "registry publish new/p/public --workers 1": 0,
    "registry add lab --make DJI --model FC330 --yes": 0,
    "registry retire fc6310r/4864x3648 --reason 'no longer flown'": 0,
    "registry sync ./hub.git": 0,
    "registry sync": 0,
    "onboard payload --yes --for unit --html new/o/onboard.html": 0,
    "registry set fc6310r/5472 label=P4R-03 +survey --yes": 0,
    "registry set --where tags=survey 'notes=the lens came back' --yes": 0,
    "registry set --out new/u/fleet.csv": 0,
    "registry set --table new/u/fleet.csv --yes": 0,
    "diff camera.xml later.xml --html new/d/diff.html": 1,
    "diff --since HEAD~6": 1,
    "inspect camera.xml": 0,
    "inspect survey/a.jpg --tags": 0,
    "convert camera.xml new/v/camera.yml --to opencv_storage": 0,
    "k camera.xml": 0,
    "formats": 0,
    "formats colmap": 0,
    "catalogue": 0,
    "catalogue M3T": 0,
    "completion bash": 0,
}
"""Each command and its exit code; what it prints is kept in ``outputs/``."""


READING = (
    "extract survey --dry-run",
    "calibrate --from corners.json",
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
        "extract survey --fallback-k nothing.xml",
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Printed:
    """What a command printed and how it ended."""

    code: int
    out: str
    err: str

    @property
    def last(self) -> str:
        """The last line of the results."""
        return self.out.rstrip("\n").rpartition("\n")[2]


@dataclass(frozen=True, slots=True, kw_only=True)
class Ran:
    """What was printed at a desk by every command, by the reading ones as JSON, and by those that were refused."""

    folder: Path
    commands: dict[str, Printed]
    documents: dict[str, Printed]
    refused: dict[str, Printed]


def furnish(folder: Path) -> None:
    """Put an example of everything into a folder."""
    from PIL import Image

    picture(folder / "survey/a.jpg", (5472, 3648), **P4R, dewarp=DEWARP)
    picture(folder / "survey/b.jpg", **NOBODY)
    (folder / "survey/torn.jpg").write_bytes(b"\xff\xd8\xff")
    Image.new("RGB", (240, 160), (90, 120, 60)).save(folder / "small.png")
    (folder / "small.txt").write_text("1 SIMPLE_RADIAL 240 160 140 120 80 -0.1\n")
    xml(folder / "camera.xml")
    xml(folder / "later.xml", 3730.0)
    xml(folder / "other.xml", 3661.0, (4864, 3648))
    (folder / "lab").mkdir()
    xml(folder / "lab/lab.xml", 2300.0, (4000, 3000))
    corners(folder / "corners.json")
    write_rig_corners(folder / "rig")
    (folder / "payload").mkdir()
    survey(folder / "payload")


def printed(command: str, *more: str) -> Printed:
    """Run a command in this process, as the shell would give it its words; DIGEST is that of the only proposal."""
    if "DIGEST" in command:
        [proposed] = Registry.open(Path("new/fleet")).snapshot().proposed.values()
        command = command.replace("DIGEST", str(proposed))
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8") for _ in range(2))
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err), sketched():
        try:
            code = main([*shlex.split(command), *more])
        except SystemExit as ended:
            code = int(ended.code or 0)
    texts = []
    for stream in (out, err):
        stream.flush()
        buffer = stream.buffer
        assert isinstance(buffer, io.BytesIO)
        texts.append(buffer.getvalue().decode())
    return Printed(code=code, out=texts[0], err=texts[1])


def typed(line: str) -> subprocess.CompletedProcess[str]:
    """A line of a page as it is typed here: by a shell where it takes one, else in this process, which is quicker."""
    if not line.startswith("calibrary ") or re.search(r"[|<>;&$`]", line):
        return subprocess.run(["/bin/sh", "-c", line], capture_output=True, text=True, check=False)
    done = printed(line.removeprefix("calibrary "))
    return subprocess.CompletedProcess(line, done.code, done.out, done.err)


def terminal(monkeypatch: pytest.MonkeyPatch, columns: int) -> None:
    """Let the commands believe that a terminal of so many columns reads them."""
    monkeypatch.setenv("TTY_COMPATIBLE", "1")
    monkeypatch.setenv("COLUMNS", str(columns))


def unstyled(text: str) -> str:
    """What a terminal shows, without its colours."""
    return re.sub(r"\x1b\[[\d;]*m", "", text)
