"""A registry as a plain folder."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from calibrary.errors import RegistryError
from calibrary.registry.entry_yaml import LARGEST_ENTRY, entry_yaml
from calibrary.registry.registry import open_snapshot
from calibrary.registry.snapshot import paths_below, read_entry_file
from tests.registry.entries import KEY, an_entry


@pytest.fixture
def registry(tmp_path: Path) -> Path:
    path = tmp_path / an_entry().path
    path.parent.mkdir(parents=True)
    path.write_bytes(entry_yaml(an_entry()))
    return tmp_path


def test_entries_are_found_and_other_files_left_alone(registry: Path) -> None:
    for name in (".5472x3648.yaml.swp", ".hidden.yaml", "README.md"):
        (registry / "cameras/dji" / name).write_text("{")
    snapshot = open_snapshot(Path(f"folder:{registry}"))
    assert [*snapshot.paths] == [an_entry().path]
    assert len(snapshot.strays) == 3
    found = snapshot.index().resolve(KEY)
    assert found is not None
    assert found.entry == an_entry()


def test_the_folder_one_stands_in_is_one_as_well(registry: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(registry)
    assert paths_below(Path()) == [an_entry().path]
    assert paths_below(Path("./")) == [an_entry().path]


def test_a_folder_without_cameras_is_no_registry(tmp_path: Path) -> None:
    with pytest.raises(RegistryError, match="a folder 'cameras'"):
        open_snapshot(Path(f"folder:{tmp_path}"))


def test_links_are_not_followed(registry: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    outside = tmp_path_factory.mktemp("outside")
    (outside / "secret.yaml").write_text("{}")
    (registry / "cameras/loop").symlink_to(registry / "cameras")
    (registry / "cameras/dji/link.yaml").symlink_to(outside / "secret.yaml")
    assert "cameras/loop/dji/link.yaml" not in paths_below(registry)
    with pytest.raises(RegistryError, match="regular file"):
        read_entry_file(registry, "cameras/dji/link.yaml")


def test_what_is_no_file_or_too_large_is_refused(registry: Path) -> None:
    os.mkfifo(registry / "cameras/pipe.yaml")
    (registry / "cameras/large.yaml").write_bytes(b"#" * (LARGEST_ENTRY + 1))
    for name, message in (("pipe", "regular file"), ("large", "larger than"), ("gone", "regular file")):
        with pytest.raises(RegistryError, match=message):
            read_entry_file(registry, f"cameras/{name}.yaml")
