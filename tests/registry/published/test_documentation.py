"""The readers of docs/publishing.md read what was published."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.registry.published.publications import FLEET, commit, nobodys_git, published
from tests.registry.published.server import Server, serving

__all__ = ["nobodys_git"]

TEXT = (Path(__file__).parents[3] / "docs/publishing.md").read_text(encoding="utf-8")


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


def test_the_javascript_reader_finds_and_verifies_it(server: Server, tmp_path: Path) -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("node is not installed")
    asked = 'calibration("DJI", "FC6310R", [4864, 3648]).then((e) => console.log(e.intrinsics.fx));'
    script = tmp_path / "reader.mjs"
    script.write_text(f"{block('js').replace('https://cameras.example.com/', server.url)}{asked}")
    done = subprocess.run([node, str(script)], capture_output=True, text=True, check=False, timeout=60)
    assert done.stderr == ""
    assert float(done.stdout) == FLEET[1].calibration.intrinsics.fx
