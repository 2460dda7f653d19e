"""What stands against an entry before it is written."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from calibrary.records import replace
from calibrary.registry.entry import Alias, Entry, Status
from calibrary.registry.fields import differences
from calibrary.registry.firmware import FirmwareRange
from calibrary.registry.git.repository import Repository
from calibrary.registry.init import init
from calibrary.registry.proposals import checked, message_of
from calibrary.registry.registry import Registry
from calibrary.registry.stating import Change
from calibrary.validation import Severity
from tests.registry.entries import an_entry, put_entries
from tests.registry.git.repositories import nobodys_git

__all__ = ["nobodys_git"]


@pytest.fixture
def registry(tmp_path: Path) -> Registry:
    return Registry.open(init(tmp_path / "fleet", bare=True).place)


def put(registry: Registry, *entries: Entry) -> None:
    put_entries(registry, [(entry, None) for entry in entries], message_of("Add", entries))


def rules(registry: Registry, *entries: Entry) -> list[str]:
    proposals = checked(
        registry.snapshot(),
        [
            Change(action="approve", before=None, after=entry, fields=differences(None, entry))
            for entry in entries
        ],
    )
    return [finding.rule for finding in proposals.findings if finding.severity is Severity.ERROR]


def test_a_good_entry_meets_nothing(registry: Registry) -> None:
    assert rules(registry, an_entry()) == []


def test_a_range_that_overlaps_anothers_is_objected_to(registry: Registry) -> None:
    put(registry, an_entry(firmware=FirmwareRange(min="01.08", max="01.09")))
    assert "overlap" in rules(registry, an_entry(firmware=FirmwareRange(min="01.09")))


def test_entries_of_one_commit_are_seen_together(registry: Registry) -> None:
    one, other = (an_entry(firmware=FirmwareRange(min=low, max="01.09")) for low in ("01.07", "01.08"))
    assert "overlap" in rules(registry, one, other)


def test_a_name_that_is_another_cameras_is_objected_to(registry: Registry) -> None:
    put(registry, an_entry(model="FC330"))
    assert rules(registry, an_entry(aliases=(Alias(make="DJI", model="FC330"),))) == ["alias"]


def test_what_it_supersedes_has_to_be_there(registry: Registry) -> None:
    old = an_entry(model="FC330", status=Status.RETIRED)
    newer = an_entry(supersedes=old.id)
    assert rules(registry, newer) == ["supersedes"]
    put(registry, old)
    assert rules(registry, newer) == []


def test_what_was_wrong_before_is_no_objection(registry: Registry) -> None:
    put(registry, an_entry(supersedes="dji/nothing/1x1"))
    assert rules(registry, an_entry(focal_mm=24.0)) == []


def test_other_units_of_the_model_are_not_read(registry: Registry, monkeypatch: pytest.MonkeyPatch) -> None:
    units = [an_entry(serial=f"{number:016x}") for number in range(5)]
    put(registry, an_entry(), *units)
    others = {registry.snapshot().cameras[one.path] for one in units[1:]}
    read: list[str] = []
    objects = Repository.objects

    def noted(repo: Repository, oids: Sequence[str], kind: bytes = b"blob") -> Iterator[bytes]:
        read.extend(oids)
        return objects(repo, oids, kind)

    monkeypatch.setattr(Repository, "objects", noted)
    measured = replace(units[0], tolerance=0.01)
    assert rules(registry, measured) == []
    assert read
    assert not others & {*read}
