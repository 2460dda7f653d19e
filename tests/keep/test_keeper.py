"""A registry and its entries: KEY@REV is the K of that camera, at that state, or an error."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrary.calibration import Provenance
from calibrary.errors import RegistryError, UnknownCameraError
from calibrary.keep.beginning import begin
from calibrary.keep.keeper import Keeper, note_of
from calibrary.keep.names import find_path, find_paths
from calibrary.records import replace
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.firmware import FirmwareRange
from calibrary.registry.git import maintenance
from calibrary.registry.git.repository import Repository
from tests.registry.entries import FILE, an_entry
from tests.registry.git.repositories import git, nobodys_git

__all__ = ["nobodys_git"]


@pytest.fixture
def keeper(tmp_path: Path) -> Keeper:
    return begin(tmp_path / "fleet").keeper


def put(keeper: Keeper, entry: Entry, base: str | None = None) -> str:
    """Write an entry; its content's id."""
    oid = keeper.save([(entry, base)], note_of("Put", [entry])).paths[entry.path]
    assert oid is not None
    return oid


def by_hand(keeper: Keeper, path: str, data: bytes) -> None:
    """Commit a file as somebody does who knows only git."""
    root = keeper.registry.repo.path
    (root / path).parent.mkdir(parents=True, exist_ok=True)
    (root / path).write_bytes(data)
    git(root, "add", ".")
    git(root, "commit", "-qm", "by hand")


def test_one_cameras_file_in_anothers_place_is_nobodys_k(keeper: Keeper) -> None:
    entry, other = an_entry(), an_entry(model="FC330")
    put(keeper, other)
    good = keeper.registry.commit()
    by_hand(keeper, other.path, entry_yaml(entry))
    for key in ("fc330", "fc330@HEAD", f"fc330@{keeper.registry.commit()}"):
        with pytest.raises(RegistryError, match=f"belongs at {entry.path}".replace("+", r"\+")):
            keeper.get(key)
    assert keeper.get(f"fc330@{good}").entry == other


def test_a_file_at_a_path_of_nobodys_is_found_by_it(keeper: Keeper) -> None:
    by_hand(keeper, "cameras/mine.yaml", entry_yaml(an_entry()))
    assert keeper.get("mine").entry == an_entry()


def test_a_key_is_found_in_any_letter_case_even_where_longer_ones_begin_alike() -> None:
    paths = [an_entry(focal_mm=None).path, an_entry().path]
    assert find_path(paths, "DJI/FC6310R/5472X3648") == paths[0]
    assert find_path(paths, "cameras/dji/fc6310r/5472x3648.yaml") == paths[0]
    assert find_paths(paths, "fc6310r") == sorted(paths)


def test_an_editors_name_does_not_hide_the_firmware_an_entry_is_of(keeper: Keeper) -> None:
    edited = replace(FILE, firmware="Adobe Lightroom Classic")
    put(keeper, with_provenance(an_entry(firmware=FirmwareRange(min="01.00", max="01.10")), edited))
    assert keeper.get("fc6310r@firmware:01.09").entry.firmware is not None
    with pytest.raises(UnknownCameraError, match="no revision"):
        keeper.get("fc6310r@firmware:02.00")


def with_provenance(entry: Entry, provenance: Provenance) -> Entry:
    return replace(entry, calibration=replace(entry.calibration, provenance=provenance))


def test_what_was_written_is_told_as_written_whatever_becomes_of_the_packing(
    keeper: Keeper, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(_: Repository, *, in_background: bool) -> None:
        raise RegistryError(f"no space, in_background={in_background}")

    monkeypatch.setattr(maintenance, "is_due", lambda _: True)
    monkeypatch.setattr(maintenance, "maintain", fails)
    entry = an_entry()
    put(keeper, entry)
    assert keeper.get("fc6310r").entry == entry
