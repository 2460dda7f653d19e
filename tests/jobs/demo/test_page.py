"""The page of the demonstration flight lets nothing private out."""

from __future__ import annotations

from pathlib import Path

from calibrary.jobs.demo.flight import DemoImage
from calibrary.jobs.extract.run import run
from calibrary.jobs.extract.told import told
from calibrary.pages import render_page
from tests.jobs.extract.fleet import plan


def test_nothing_private_is_in_the_page(flight: tuple[Path, list[DemoImage]], tmp_path: Path) -> None:
    folder, images = flight
    outcome = run(folder, recursive=True)
    page = render_page(told(plan(outcome, tmp_path / "K_matrix.npy", None)))
    private = {text for image in images for text in image.private}
    assert len(private) > 20
    assert [text for text in private if text in page] == []
    assert len(page) < 400_000
