"""What is shipped: the four rooms at the top of the repository arrive whole, inside one import name.

``make dist`` runs this file on what it has built in dist/; a thorough run of the suite builds its own.
"""

from __future__ import annotations

import email
import email.message
import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path

import pytest

from tests.house.project import CORE, ROOMS, ROOT, files_of

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]

PAPERS = (
    "CHANGELOG.md",
    "CONTRIBUTING.md",
    "DESIGN.md",
    "LICENSE",
    "Makefile",
    "NOTICE",
    "README.md",
    "pyproject.toml",
    "requirements-dev.lock",
)

pytestmark = [pytest.mark.thorough] if "CALIBRARY_DIST" not in os.environ else []

IMPORT_EVERYTHING = """
import json, pkgutil, sys
sys.path.insert(0, sys.argv[1])
import calibrary
names = [module.name for module in pkgutil.walk_packages(calibrary.__path__, "calibrary.")]
names = [name for name in names if not name.endswith("__main__")]
modules = {name: __import__(name, fromlist=["x"]).__file__ for name in names}
print(json.dumps({"calibrary": calibrary.__file__, **modules}))
"""


def build(source: Path, destination: Path, target: str, kernel: str = "0") -> Path:
    command = [sys.executable, "-m", "hatchling", "build", "-t", target, "-d", str(destination)]
    environment = {**os.environ, "CALIBRARY_KERNEL": kernel}
    subprocess.run(command, cwd=source, check=True, capture_output=True, env=environment)
    (built,) = destination.glob("*.whl" if target == "wheel" else "*.tar.gz")
    return built


@pytest.fixture(scope="module")
def dist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder with one wheel and one sdist."""
    if given := os.environ.get("CALIBRARY_DIST"):
        return ROOT / given
    folder = tmp_path_factory.mktemp("dist")
    for target in ("wheel", "sdist"):
        build(ROOT, folder, target)
    return folder


@pytest.fixture(scope="module")
def wheel(dist: Path) -> Path:
    (path,) = dist.glob("*.whl")
    return path


@pytest.fixture(scope="module")
def unpacked_sdist(dist: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    (path,) = dist.glob("*.tar.gz")
    folder = tmp_path_factory.mktemp("sdist")
    shutil.unpack_archive(path, folder, filter="data")
    (top,) = folder.iterdir()
    return top


@pytest.fixture(scope="module")
def unpacked_wheel(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    shutil.unpack_archive(wheel, folder, format="zip")
    return folder


@pytest.fixture(scope="module")
def metadata(unpacked_wheel: Path) -> email.message.Message:
    (path,) = unpacked_wheel.glob("*.dist-info/METADATA")
    return email.message_from_string(path.read_text())


def shipped(wheel: Path) -> dict[str, int]:
    """Name and checksum of everything in a wheel that is not its metadata."""
    with zipfile.ZipFile(wheel) as archive:
        return {info.filename: info.CRC for info in archive.infolist() if ".dist-info/" not in info.filename}


def test_the_wheel_holds_every_file_of_the_core_and_of_each_room_and_nothing_else(wheel: Path) -> None:
    expected = {f"calibrary/{path.relative_to(CORE).as_posix()}" for path in files_of(CORE)}
    for room in ROOMS:
        expected |= {f"calibrary/{path.relative_to(ROOT).as_posix()}" for path in files_of(ROOT / room)}
    assert set(shipped(wheel)) == expected


@pytest.mark.skipif(
    shutil.which("cc") is None or not Path(sysconfig.get_path("include"), "Python.h").exists(),
    reason="there is no compiler here, or Python's headers are not",
)
def test_a_compiled_wheel_is_the_pure_one_with_one_binary_for_all_versions_of_python(
    wheel: Path, tmp_path: Path
) -> None:
    compiled = build(ROOT, tmp_path / "dist", "wheel", kernel="1")
    assert compiled.name.split("-")[2:4] == ["cp311", "abi3"]
    more = shipped(compiled)
    assert more.keys() - shipped(wheel).keys() == {"calibrary/kernel/_kernel.abi3.so"}
    shutil.unpack_archive(compiled, tmp_path / "unpacked", format="zip")
    asked = (
        "import sys; sys.path.insert(0, sys.argv[1]); from calibrary import kernel; print(kernel.compiled)"
    )
    ran = subprocess.run(
        [sys.executable, "-S", "-c", f"import site; site.main(); {asked}", str(tmp_path / "unpacked")],
        capture_output=True, text=True, check=True, cwd=tmp_path,
    )  # fmt: skip
    assert ran.stdout == "True\n"


def test_the_wheel_installs_one_top_level_name(wheel: Path) -> None:
    assert {name.partition("/")[0] for name in shipped(wheel)} == {"calibrary"}


def test_the_wheel_tells_type_checkers_that_it_is_typed(wheel: Path) -> None:
    assert "calibrary/py.typed" in shipped(wheel)


@pytest.mark.parametrize("room", ROOMS)
def test_no_room_arrives_empty(wheel: Path, room: str) -> None:
    assert f"calibrary/{room}/__init__.py" in shipped(wheel)


def test_every_module_of_the_wheel_imports_from_the_wheel_alone(unpacked_wheel: Path, tmp_path: Path) -> None:
    command = [sys.executable, "-I", "-W", "error", "-c", IMPORT_EVERYTHING, str(unpacked_wheel)]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert done.returncode == 0, done.stderr
    modules: dict[str, str] = json.loads(done.stdout)
    assert {f"calibrary.{room}" for room in ROOMS} <= set(modules)
    assert [name for name, file in modules.items() if not file.startswith(str(unpacked_wheel))] == []


def test_the_metadata_says_what_pyproject_says(metadata: email.message.Message) -> None:
    assert metadata["Name"] == "calibrary"
    assert metadata["Version"] == PROJECT["version"]
    assert metadata["Requires-Python"] == ">=3.11"
    assert metadata["License-Expression"] == "Apache-2.0"
    always = [line for line in metadata.get_all("Requires-Dist", []) if "extra ==" not in line]
    assert sorted(always) == sorted(PROJECT["dependencies"])
    assert set(metadata.get_all("Provides-Extra", [])) == set(PROJECT["optional-dependencies"])


def test_the_index_shows_the_readme_without_links_that_lead_nowhere_there(
    metadata: email.message.Message,
) -> None:
    assert metadata["Description-Content-Type"] == "text/markdown"
    shown = str(metadata.get_payload())
    assert 'pip install "calibrary[all,opencv]"' in shown
    assert "calibrary extract survey" in shown
    assert re.findall(r"\]\((?!\w+://)[^)]*\)", shown) == []


def test_the_licence_travels_with_the_wheel(unpacked_wheel: Path) -> None:
    for name in ("LICENSE", "NOTICE"):
        (paper,) = unpacked_wheel.glob(f"*.dist-info/licenses/{name}")
        assert paper.read_bytes() == (ROOT / name).read_bytes()


def test_the_wheel_carries_the_listed_sensor_widths(unpacked_wheel: Path) -> None:
    path = "registry/catalogue/sensor_widths.tsv"
    assert (unpacked_wheel / "calibrary" / path).read_bytes() == (ROOT / path).read_bytes()


def test_the_wheel_declares_the_command(unpacked_wheel: Path) -> None:
    (entry_points,) = unpacked_wheel.glob("*.dist-info/entry_points.txt")
    assert "calibrary = calibrary.__main__:main" in entry_points.read_text().splitlines()


def test_the_sdist_holds_the_rooms_the_tests_and_the_papers(unpacked_sdist: Path) -> None:
    folders = (CORE, ROOT / "tests", *(ROOT / room for room in ROOMS))
    expected = {path.relative_to(ROOT) for folder in folders for path in files_of(folder)}
    expected |= {Path(name) for name in PAPERS}
    assert expected - {path.relative_to(unpacked_sdist) for path in files_of(unpacked_sdist)} == set()


def test_the_sdist_holds_nothing_that_a_checkout_has_not(unpacked_sdist: Path) -> None:
    files = {path.relative_to(unpacked_sdist) for path in files_of(unpacked_sdist)} - {Path("PKG-INFO")}
    assert {path for path in files if not (ROOT / path).is_file()} == set()
    assert {path.parts[0] for path in files} & {".venv", ".git", "build", "dist", "demo"} == set()


def test_the_wheel_built_from_the_sdist_is_the_same(
    wheel: Path, unpacked_sdist: Path, tmp_path: Path
) -> None:
    assert shipped(build(unpacked_sdist, tmp_path, "wheel")) == shipped(wheel)
