"""The readers of docs/publishing.md read what was published."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from calibrary.calibration import CameraKey
from calibrary.registry.published.layout import camera_path
from tests.registry.published.publications import FLEET, commit, nobodys_git, published
from tests.registry.published.server import Server, serving

__all__ = ["nobodys_git"]

TEXT = (Path(__file__).parents[3] / "docs/publishing.md").read_text(encoding="utf-8")
NAMES = ["FC6310R", "Canon  EOS 5D Mark IV ", "A/B & c_d", ".x.-", "M3T-é", "Kamera 10"]


def block(language: str) -> str:
    """The first block of the page in a language."""
    found = re.search(rf"^```{language}\n(.*?)^```", TEXT, re.DOTALL | re.MULTILINE)
    assert found is not None
    return found[1]


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Server]:
    commit(tmp_path / "fleet", *FLEET)
    published(tmp_path / "fleet", tmp_path / "out")
    with serving(tmp_path / "out") as server:
        yield server


def test_the_python_reader_finds_the_entry(server: Server) -> None:
    names: dict[str, Any] = {}
    exec(block("python").replace("https://cameras.example.com/", server.url), names)  # noqa: S102  our own page
    own = FLEET[0].calibration
    assert names["camera"]["intrinsics"]["fx"] in {own.intrinsics.fx, 3640.0}
    assert names["camera"]["camera"]["image_size"] == [5472, 3648]
    for name in NAMES:
        assert f"models/{names['part']('DJI')}/{names['part'](name)}.json" == camera_path(
            CameraKey(make="DJI", model=name)
        )


def test_the_javascript_reader_finds_and_verifies_it(server: Server, tmp_path: Path) -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    asked = 'calibration("DJI", "FC6310R", [4864, 3648]).then((e) => console.log(e.intrinsics.fx));'
    shown = "".join(f"console.log(part({name!r}));" for name in NAMES)
    script = tmp_path / "reader.mjs"
    script.write_text(f"{block('js').replace('https://cameras.example.com/', server.url)}{shown}{asked}")
    done = subprocess.run([node, str(script)], capture_output=True, text=True, check=False, timeout=60)
    assert done.stderr == ""
    *parts, fx = done.stdout.split("\n")[:-1]
    assert float(fx) == FLEET[1].calibration.intrinsics.fx
    paths = [camera_path(CameraKey(make="DJI", model=name)) for name in NAMES]
    assert [f"models/dji/{part}.json" for part in parts] == paths


def test_the_c_plus_plus_rule_gives_the_paths_of_the_page(tmp_path: Path) -> None:
    compiler = shutil.which("c++") or shutil.which("g++")
    if compiler is None:
        pytest.skip("no C++ compiler is installed")
    names = ["canon eos 5d mark iv", "bild & flug", "kamera/2", ".x.-"]
    shown = "".join(f'std::puts(part("{name}").c_str());' for name in names)
    source = tmp_path / "part.cpp"
    source.write_text(f"#include <cstdio>\n#include <string>\n{block('cpp')}int main() {{ {shown} }}\n")
    subprocess.run([compiler, "-std=c++11", "-o", str(tmp_path / "part"), str(source)], check=True)
    out = subprocess.run([str(tmp_path / "part")], capture_output=True, text=True, check=True).stdout
    assert out.split() == [
        camera_path(CameraKey(make="x", model=name)).rpartition("/")[2].removesuffix(".json")
        for name in names
    ]


def test_the_paths_that_the_page_names_are_right() -> None:
    for make, model, path in (
        ("Canon", "Canon EOS 5D Mark IV", "models/canon/canon_eos_5d_mark_iv.json"),
        ("Bild & Flug", "Kamera/2", "models/bild_~26_flug/kamera~2f2.json"),
    ):
        assert camera_path(CameraKey(make=make, model=model)) == path
        assert path in TEXT
