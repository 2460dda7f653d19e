"""README.md does what it says: its commands run, its Python runs, its links lead somewhere, its numbers are ours."""

from __future__ import annotations

import argparse
import inspect
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import calibrary
from calibrary.catalogue import load_catalogue
from calibrary.cli.main import EPILOG, build_parser
from calibrary.jobs.extract.cameras import DEFAULT_SENSOR_MM
from calibrary.jobs.extract.fallback import seed
from calibrary.parsers import formats
from calibrary.parsers.fit import DEFAULT_MAX_ERROR_PX
from calibrary.policy import FLEET, SOURCE
from calibrary.schemas import require
from tests.cli.desk import typed
from tests.house.project import ROOT
from tests.imagery import ExifTags, write_jpeg
from tests.pages.sketches import sketched

README = (ROOT / "README.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"(?ms)^```(\w+)\n(.*?)^```$", README)
COMMANDS = [line for kind, text in BLOCKS if kind == "sh" for line in text.splitlines()]
OWN_COMMANDS = [line for line in COMMANDS if not line.startswith(("make ", "pip "))]
PROSE = re.sub(r"`[^`]*`|\]\([^)]*\)", " ", re.sub(r"(?ms)^```.*?^```$", "", README))

BIN = Path(sys.executable).parent

STUB = """\
#!/bin/sh
for word in "$@"; do printf '%s\\n' "$word"; done >> colmap.log
"""
"""COLMAP, as far as the README needs it."""


@contextmanager
def reader(folder: Path) -> Iterator[None]:
    """The desk of somebody who has installed the program, and git under a name."""
    with pytest.MonkeyPatch.context() as patch:
        for name in [name for name in os.environ if name.startswith(("MAKE", "MFLAGS"))]:
            patch.delenv(name)
        for role in ("AUTHOR", "COMMITTER"):
            for what in ("NAME", "EMAIL"):
                patch.setenv(f"GIT_{role}_{what}", "reader")
        patch.setenv("PATH", os.pathsep.join([str(folder / "bin"), str(BIN), os.environ["PATH"]]))
        patch.chdir(folder)
        with sketched():
            yield


def run(command: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """What a line of the README does; a shell of its own only where it takes one."""
    with reader(folder):
        return typed(command)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What ``make demo`` leaves behind, by the commands that it runs."""
    folder = tmp_path_factory.mktemp("reader")
    recipe = subprocess.run(
        ["make", "-n", "demo"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    [name] = re.findall(r"calibrary demo (\S+)", recipe)
    [extract] = set(re.findall(r"calibrary extract \S.*?\.npy", recipe))
    assert run(f"calibrary demo {name}", folder).returncode == 0
    place = folder / str(name)
    (place / "bin").mkdir()
    (place / "bin/colmap").write_text(STUB)
    (place / "bin/colmap").chmod(0o755)
    assert run(extract, place).returncode == 1
    return place


@pytest.fixture(scope="module")
def ran(folder: Path) -> dict[str, subprocess.CompletedProcess[str]]:
    """Every command for a reader's own images, run in the README's order."""
    return {command: run(command, folder) for command in OWN_COMMANDS}


FINDS_SOMETHING = {
    "calibrary extract flight --recursive --out flight-k/K_matrix.npy": "rejected",
    "calibrary registry audit survey --registry fleet": "it was calibrated on 2019-03-05",
}
"""Some images of the flight are bad on purpose; the survey's DewarpData is of 2019, which an audit has to say."""


@pytest.mark.parametrize("command", OWN_COMMANDS)
def test_every_command_runs(ran: dict[str, subprocess.CompletedProcess[str]], command: str) -> None:
    done = ran[command]
    assert done.returncode == (1 if command in FINDS_SOMETHING else 0), done.stderr
    assert FINDS_SOMETHING.get(command, "") in done.stdout
    assert "Traceback" not in done.stderr
    assert "left from an earlier run" not in done.stdout


@pytest.mark.usefixtures("ran")
def test_the_commands_write_what_the_text_says(folder: Path) -> None:
    K = np.load(folder / "K_matrix.npy")
    assert (K.shape, K.dtype) == ((3, 3), np.float64)
    assert K[0, 0] == 3659.5
    several = {path.name for path in folder.glob("flight-k/K_matrix.*.npy")}
    assert several > {"K_matrix.dji-m3t-wide-8000x6000.npy", "K_matrix.dji-m3t-thermal-640x512.npy"}
    require(json.loads((folder / "report.json").read_text()), "report-1", source="report.json")
    require(json.loads((folder / "K_matrix.json").read_text()), "report-1", source="K_matrix.json")


@pytest.mark.usefixtures("ran")
def test_colmap_is_given_the_images_and_their_k(folder: Path) -> None:
    words = (folder / "colmap.log").read_text().splitlines()
    assert words[0] == "feature_extractor"
    assert words[words.index("--ImageReader.camera_params") + 1].startswith("3659.5,3655.0,2731.75,1846.5,")
    listed = (folder / words[words.index("--image_list_path") + 1]).read_text().split()
    assert listed == ["DJI_0001.JPG", "DJI_0002.JPG"]


@pytest.mark.usefixtures("ran")
def test_the_registry_stands_in_where_the_images_have_no_k(folder: Path, tmp_path: Path) -> None:
    write_jpeg(tmp_path / "input/a.jpg", (5472, 3648), exif=ExifTags(make="DJI", model="FC6310R"))
    done = run(f"calibrary extract --registry {folder / 'fleet'}", tmp_path)
    assert done.returncode == 0, done.stderr
    assert np.load(tmp_path / "K_matrix.npy")[0, 0] == 3659.5


@pytest.mark.usefixtures("ran")
def test_the_board_may_be_kept_fixed_and_pages_are_written(folder: Path) -> None:
    assert "a solver may keep it fixed" in (folder / "board.html").read_text(encoding="utf-8")
    for page in ("survey.html", "diff.html", "fleet-pages/index.html"):
        assert (folder / page).read_text(encoding="utf-8").startswith("<!doctype html>")
    assert (folder / "board.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize("command", [command for command in COMMANDS if command.startswith("make ")])
def test_every_make_target_has_a_recipe(command: str) -> None:
    done = subprocess.run([*command.split(), "-n"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "calibrary" in done.stdout or "pytest" in done.stdout


@pytest.mark.thorough
def test_pip_install_gives_the_package_and_the_command(tmp_path: Path) -> None:
    assert 'pip install "calibrary[all,opencv]"' in COMMANDS
    flags = ["--quiet", "--no-deps", "--no-index", "--no-build-isolation", "--target", str(tmp_path / "env")]
    uv = shutil.which("uv")
    pip = (
        [uv, "pip", "install", "--python", sys.executable] if uv else [sys.executable, "-m", "pip", "install"]
    )
    done = subprocess.run([*pip, *flags, "."], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "env/bin/calibrary").is_file()
    where = "import calibrary.catalogue as home; print(home.__file__)"
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "env")}
    imported = subprocess.run(
        [sys.executable, "-c", where], env=environment, capture_output=True, text=True, check=True
    )
    assert imported.stdout.startswith(str(tmp_path))


@pytest.mark.usefixtures("ran")
@pytest.mark.parametrize("code", [text for kind, text in BLOCKS if kind == "python"])
def test_python_prints_what_stands_below_it(folder: Path, code: str) -> None:
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == re.findall(r"(?m)^# (.*)$", code)


def test_what_mypy_reads_is_the_python_of_the_page() -> None:
    """`make lint` reads it strictly."""
    [shown] = [text for kind, text in BLOCKS if kind == "python"]
    assert (ROOT / "tests/typed_readme.py").read_text(encoding="utf-8") == shown


def test_the_signature_is_the_functions() -> None:
    parameters = inspect.signature(calibrary.extract_intrinsic_matrix).parameters.values()
    printed = ", ".join(p.name if p.default is p.empty else f"{p.name}={p.default}" for p in parameters)
    assert f"`extract_intrinsic_matrix({printed})`" in re.sub(r"\s+", " ", README)


def test_every_block_is_of_a_kind_that_is_run() -> None:
    assert {kind for kind, _ in BLOCKS} == {"sh", "python"}


def test_every_relative_link_leads_to_a_file() -> None:
    targets = re.findall(r"\]\(([^)#]+)\)", README)
    assert [target for target in targets if "://" not in target and not (ROOT / target).is_file()] == []
    assert {"DESIGN.md", "CONTRIBUTING.md", "CHANGELOG.md", "LICENSE"} <= set(targets)


def test_every_flag_named_is_one_of_the_commands() -> None:
    printed = re.sub(r"(?ms)^```.*?^```$", "", README)
    named = re.findall(r"(?<![\w-])--[a-z][a-z-]*", printed)
    assert set(named) <= set(flags_of(build_parser()))


def test_the_exit_codes_are_the_commands() -> None:
    table = re.findall(r"(?m)^\| (\d+) \| ", README)
    assert table == re.findall(r"(?m)^  (\d+)  ", EPILOG)


def test_the_formats_named_are_read() -> None:
    for name, module in (("Agisoft XML", "agisoft_xml"), ("OpenCV YAML", "opencv_storage")):
        assert name in README
        assert module in {each.name for each in formats()}


def test_every_number_quoted_is_the_codes(folder: Path) -> None:
    report = json.loads((folder / "result/K_matrix.json").read_text())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    catalogue = list(load_catalogue())
    # Rounded down, so that a camera that is added to the catalogue is not added here too.
    cameras, makers = len(catalogue) // 100 * 100, len({camera.make for camera in catalogue}) // 10 * 10
    start = seed(calibrary.CameraKey(), (4000, 3000)).intrinsics.fx / 4000
    assert FLEET.focal_symmetry_max == SOURCE.focal_symmetry_max
    assert FLEET.principal_point_drift_max == SOURCE.principal_point_drift_max
    assert FLEET.known_camera_tolerance is not None
    assert FLEET.focal_symmetry_proven is not None
    numbers: dict[str, list[float]] = {
        "the files of the demonstration, and the cameras in them": [report["images"], len(report["cameras"])],
        "the catalogue's cameras and their makers": [cameras, makers],
        "the sensor that is assumed": [*DEFAULT_SENSOR_MM],
        "the largest error a conversion may leave": [DEFAULT_MAX_ERROR_PX],
        "the band of the source policy": [*SOURCE.focal_over_width],
        "where a self-calibration starts": [start],
        "limits in per cent": [
            100 * FLEET.known_camera_tolerance,
            100 * FLEET.focal_symmetry_proven,
            100 * FLEET.focal_symmetry_max,
            100 * FLEET.principal_point_drift_max,
        ],
        "a matrix's sides": [3],
        "the exit codes": [0, 1, 2, 3, 4],
        "a film's width": [35],
        "half of W and H, and half a pixel": [2, 0.5],
    }
    known = {f"{number:g}" for group in numbers.values() for number in group}
    known.add(project["requires-python"].removeprefix(">="))
    assert set(re.findall(r"(?<![\w.-])\d+(?:\.\d+)?", PROSE)) <= known
    printed = re.sub(r"\s+", " ", README)
    assert f"{report['images']} files by {len(report['cameras'])} cameras" in printed
    assert f"over {cameras} cameras by over {makers} makers" in printed


def test_the_picture_is_what_the_command_says(folder: Path, tmp_path: Path) -> None:
    script = [
        sys.executable,
        str(ROOT / "docs/make_pictures.py"),
        str(tmp_path),
        "--flight",
        str(folder / "flight"),
    ]
    subprocess.run(script, check=True, capture_output=True)
    shown, drawn = (texts(path / "extract.svg") for path in (ROOT / "docs", tmp_path))
    assert shown == drawn, "the output has changed: make pictures"
    assert (ROOT / "docs/extract.svg").stat().st_size < 200_000


def test_the_picture_fetches_nothing() -> None:
    picture = (ROOT / "docs/extract.svg").read_text(encoding="utf-8")
    assert re.findall(r"(?:https?:)?//[^\s\"')]+", picture) == ["http://www.w3.org/2000/svg"]


def test_the_readme_is_short() -> None:
    assert len(README.splitlines()) <= 160


def flags_of(parser: argparse.ArgumentParser) -> Iterator[str]:
    """Every flag of a command and of the commands below it."""
    for action in parser._actions:
        yield from action.option_strings
        if isinstance(action, argparse._SubParsersAction):
            for below in action.choices.values():
                yield from flags_of(below)


def texts(path: Path) -> list[str]:
    tree = ET.fromstring(path.read_text(encoding="utf-8"))  # noqa: S314  our own picture
    return [element.text or "" for element in tree.iter("{http://www.w3.org/2000/svg}text")]
