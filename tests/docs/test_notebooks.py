"""The notebooks of the manual run in a Python of their own, and print what they show."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import Flight
from tests.house.project import ROOT
from tests.thorough import every

NOTEBOOKS = sorted((ROOT / "docs/notebooks").glob("*.ipynb"))


def printed(notebook: Any) -> list[str]:
    """The text of every output: what was printed, and how values show themselves."""
    outputs = [output for cell in notebook.cells for output in cell.get("outputs", ())]
    return [
        output.get("text") or output["data"].get("text/html") or output["data"]["text/plain"]
        for output in outputs
    ]


@pytest.mark.parametrize("path", every(2, NOTEBOOKS), ids=lambda path: path.stem)
# What Jupyter's own libraries tell one another.
@pytest.mark.filterwarnings("ignore")
def test_a_notebook_prints_what_it_shows(path: Path, tmp_path: Path, demo_flight: Flight) -> None:
    import nbformat
    from nbclient import NotebookClient

    shutil.copytree(demo_flight[0], tmp_path / "flight", copy_function=os.link)
    shown = nbformat.read(path, as_version=4)  # type: ignore[no-untyped-call]
    run = nbformat.read(path, as_version=4)  # type: ignore[no-untyped-call]
    for cell in run.cells:
        cell.pop("outputs", None)
        if cell.cell_type == "code":
            cell.outputs = []
    NotebookClient(
        run, timeout=300, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    ).execute()
    assert printed(run) == printed(shown)
    assert len(printed(shown)) >= 2


def test_there_are_notebooks_of_a_flight_and_of_a_drift() -> None:
    assert [path.stem for path in NOTEBOOKS] == ["drift", "flight"]
