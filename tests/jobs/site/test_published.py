"""A site and the files that programs read, in one folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrary.errors import InputError
from calibrary.jobs.site.building import build
from calibrary.registry.published.write import publish
from calibrary.registry.registry import open_snapshot
from tests.registry.published.publications import files_of

PAGES = ("index.html", "cameras/", "changes/", "files/")


@pytest.fixture
def out(registry: Path, tmp_path: Path) -> Path:
    """Published first, then with a site."""
    publish(open_snapshot(registry), tmp_path / "out")
    build(registry, tmp_path / "out", workers=1)
    return tmp_path / "out"


@pytest.mark.thorough
def test_each_is_written_again_without_touching_the_other(out: Path, registry: Path) -> None:
    before = files_of(out)
    published = {path: (out / path).stat().st_mtime_ns for path in before if not path.startswith(PAGES)}
    build(registry, out, workers=1)
    assert {path: (out / path).stat().st_mtime_ns for path in published} == published
    assert publish(open_snapshot(registry), out).removed == 0
    assert files_of(out) == before


@pytest.mark.thorough
def test_both_orders_end_alike(out: Path, registry: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    build(registry, other, workers=1)
    publish(open_snapshot(registry), other)
    build(registry, other, workers=1)
    assert files_of(other) == files_of(out)


@pytest.mark.thorough
def test_what_is_neither_is_still_refused(out: Path, registry: Path) -> None:
    (out / "letter.txt").write_text("dear")
    with pytest.raises(InputError, match=r"letter\.txt"):
        build(registry, out, workers=1)
