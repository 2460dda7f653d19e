"""What stands against an entry before it is written."""

from __future__ import annotations

from pathlib import Path

import pytest

from calibrary.keep.admission import objections, stands_against
from calibrary.keep.beginning import begin
from calibrary.keep.keeper import Keeper, note_of
from calibrary.records import replace
from calibrary.registry.entry import Alias, Entry, Status
from calibrary.registry.firmware import FirmwareRange
from calibrary.registry.git.repository import Repository
from tests.registry.entries import an_entry
from tests.registry.git.repositories import nobodys_git

__all__ = ["nobodys_git"]


@pytest.fixture
def keeper(tmp_path: Path) -> Keeper:
    return begin(tmp_path / "fleet", bare=True).keeper


def put(keeper: Keeper, *entries: Entry) -> None:
    keeper.save([(entry, None) for entry in entries], note_of("Add", entries))


def rules(keeper: Keeper, *entries: Entry) -> list[str]:
    return [finding.rule for finding in stands_against(objections(keeper, entries))]


def test_a_good_entry_meets_nothing(keeper: Keeper) -> None:
    assert rules(keeper, an_entry()) == []


def test_a_range_that_overlaps_anothers_is_objected_to(keeper: Keeper) -> None:
    put(keeper, an_entry(firmware=FirmwareRange(min="01.08", max="01.09")))
    assert "overlap" in rules(keeper, an_entry(firmware=FirmwareRange(min="01.09")))


def test_entries_of_one_commit_are_seen_together(keeper: Keeper) -> None:
    one, other = (an_entry(firmware=FirmwareRange(min=low, max="01.09")) for low in ("01.07", "01.08"))
    assert "overlap" in rules(keeper, one, other)


def test_a_name_that_is_another_cameras_is_objected_to(keeper: Keeper) -> None:
    put(keeper, an_entry(model="FC330"))
    assert rules(keeper, an_entry(aliases=(Alias(make="DJI", model="FC330"),))) == ["alias"]


def test_what_it_supersedes_has_to_be_there(keeper: Keeper) -> None:
    old = an_entry(model="FC330", status=Status.RETIRED)
    newer = an_entry(supersedes=old.id)
    assert rules(keeper, newer) == ["supersedes"]
    put(keeper, old)
    assert rules(keeper, newer) == []


def test_what_was_wrong_before_is_no_objection(keeper: Keeper) -> None:
    put(keeper, an_entry(supersedes="dji/nothing/1x1"))
    assert rules(keeper, an_entry(focal_mm=24.0)) == []


def test_other_units_of_the_model_are_not_read(keeper: Keeper, monkeypatch: pytest.MonkeyPatch) -> None:
    units = [an_entry(serial=f"{number:016x}") for number in range(5)]
    put(keeper, an_entry(), *units)
    read: list[str] = []
    blob = Repository.blob

    def counted(repo: Repository, oid: str) -> bytes:
        read.append(oid)
        return blob(repo, oid)

    monkeypatch.setattr(Repository, "blob", counted)
    measured = replace(units[0], tolerance=0.01)
    assert rules(keeper, measured) == []
    assert len(read) == 2
