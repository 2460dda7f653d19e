"""A lock holds the entries that a run rests on, and says which of them has moved."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from calibrary.errors import InputError, ParseError, RegistryError
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.init import init
from calibrary.registry.locking import (
    Lock,
    Pin,
    lock_yaml,
    parse_lock,
    pin_of,
    pinned,
    read_lock,
    refuse_drift,
    verify,
)
from calibrary.registry.proposals import message_of
from calibrary.registry.registry import Registry
from calibrary.rig import RigMember
from tests.registry.entries import an_entry, put_entries
from tests.registry.git.repositories import nobodys_git

__all__ = ["nobodys_git"]

COMMIT = "4f" * 20


def pin(entry: Entry) -> Pin:
    return pin_of(entry.path, entry_yaml(entry))


def lock(*entries: Entry) -> Lock:
    return Lock(registry="../fleet", commit=COMMIT, pins=tuple(map(pin, entries)))


def test_a_lock_is_read_as_it_was_written() -> None:
    held = lock(an_entry(), an_entry(model="FC220"))
    again = parse_lock(lock_yaml(held), "calibrary.lock")
    assert set(again.pins) == set(held.pins)
    assert (again.registry, again.commit) == ("../fleet", COMMIT)
    assert lock_yaml(again) == lock_yaml(held)
    assert parse_lock(lock_yaml(Lock(pins=())), "x") == Lock(pins=())


def test_the_blob_is_gits_own_whatever_the_line_ends(tmp_path: Path) -> None:
    data = entry_yaml(an_entry())
    (tmp_path / "entry").write_bytes(data)
    printed = subprocess.run(
        ["git", "hash-object", "entry"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert pin_of("cameras/x/x.yaml", data).blob == printed.stdout.strip()
    assert pin_of("cameras/x/x.yaml", data.replace(b"\n", b"\r\n")) == pin_of("cameras/x/x.yaml", data)


@pytest.mark.parametrize(
    ("now", "message"),
    [
        ([], "no longer in the registry"),
        ([an_entry(fx=3700.0)], "its numbers have changed"),
        ([an_entry(tolerance=0.02)], "the same numbers, but"),
    ],
)
def test_an_entry_that_moved_is_drift(now: list[Entry], message: str) -> None:
    [drift] = verify(lock(an_entry()), {entry.path: pin(entry) for entry in now})
    assert message in str(drift)
    with pytest.raises(
        RegistryError, match=rf"calibrary\.lock: cameras/.*{message}.*4f4f4f4f4f4f.*registry lock"
    ):
        refuse_drift(lock(an_entry()), map(pin, now), name="calibrary.lock")


def test_entries_that_are_not_pinned_may_come_and_go() -> None:
    now = {entry.path: pin(entry) for entry in (an_entry(), an_entry(model="FC220"))}
    assert verify(lock(an_entry()), now) == ()
    refuse_drift(lock(an_entry()), now.values(), name="calibrary.lock")


def test_the_camera_of_a_rig_pinned_from_git_holds(tmp_path: Path) -> None:
    member = RigMember(rig="payload", camera="nir", reference="nir")
    registry = Registry.open(init(tmp_path / "fleet").place)
    put_entries(registry, [(an_entry(rig=member), None)], message_of("Put", []))
    held = pinned(registry.snapshot(), registry.snapshot().paths)
    assert held.pins == (pin(an_entry(rig=member)),)


def test_an_entry_pinned_twice_is_refused() -> None:
    with pytest.raises(ParseError, match="twice"):
        parse_lock(lock_yaml(lock(an_entry(), an_entry())), "calibrary.lock")


@pytest.mark.parametrize("found", ['"calibrary/lock-1"', "4f4f", "entries:", "digest: "])
def test_what_is_no_lock_is_refused(found: str) -> None:
    broken = (
        lock_yaml(lock(an_entry())).decode().replace(found, "x", 1) if "4f" not in found else "commit: 4f\n"
    )
    with pytest.raises(ParseError, match=r"calibrary\.lock"):
        parse_lock(broken.encode(), "calibrary.lock")


def test_a_lock_that_is_not_there_names_what_writes_one(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="registry lock"):
        read_lock(tmp_path / "calibrary.lock")
