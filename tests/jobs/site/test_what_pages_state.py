"""What the page of an entry states: every fact that the entry does, and a row for each of its revisions."""

from __future__ import annotations

from datetime import date

from calibrary.jobs.site.camera_page import _fields, _provenance, _row, downloads
from calibrary.jobs.site.folder import Place
from calibrary.known_camera import hash_serial
from calibrary.records import replace
from calibrary.registry.entry import Alias, Entry, Validity
from calibrary.registry.firmware import FirmwareRange
from calibrary.registry.git.history import Revision
from calibrary.registry.history import EntryRevision
from calibrary.view import Badge, KeyValues
from tests.jobs.site.test_any_entry import revised
from tests.registry.entries import FILE, KEY, an_entry


def stated(entry: Entry) -> dict[str, object]:
    block = next(iter(_provenance(entry)))
    assert isinstance(block, KeyValues)
    return dict(block.items)


def test_what_an_entry_states_of_its_use_stands_on_its_page_and_nothing_else() -> None:
    serial = hash_serial("DJI", "0K8TGAM0125")
    whole = an_entry(
        replace(KEY, serial=serial),
        firmware=FirmwareRange(min="01.00"),
        validity=Validity(first=date(2026, 1, 1), last=date(2026, 12, 31)),
        tolerance=0.01,
        supersedes="dji/old/5472x3648",
        aliases=(Alias(make="Other", model="Name"), Alias(make="Other", model="Two")),
    )
    bare = stated(an_entry())
    assert {name: text for name, text in stated(whole).items() if name not in bare} == {
        "for firmware": str(FirmwareRange(min="01.00")),
        "valid": str(whole.validity),
        "tolerance": "± 1.00% of fx",
        "serial number": f"hash {serial}",
        "supersedes": "dji/old/5472x3648",
        "also called": "Other Name, Other Two",
    }


def row(one: EntryRevision) -> list[object]:
    return [
        cell.text if isinstance(cell, Badge) else cell
        for cell in _row(one, {}, Place.of(KEY_PATH, proper=True))
    ]


KEY_PATH = an_entry().path


def test_a_revision_is_told_with_its_author_its_k_and_what_it_changed() -> None:
    old = an_entry(provenance=replace(FILE, firmware="01.02"))
    new = replace(old, label="P4R-03")
    moved = an_entry(fx=3660.0, provenance=replace(FILE, firmware="01.02"))
    head = ["2026-05-01", "Ada Keeper", "written", "calibrated", "01.02"]
    assert row(revised(1, old, None)) == [*head, "3661.25", "–", "–", "–", "first entry", "Calibrate"]
    assert row(revised(2, new, old)) == [*head, "3661.25", "–", "–", "–", "label", "Calibrate"]
    assert row(revised(3, moved, new))[5:9] == ["3660.00", "−1.25", "–", "–"]


def test_a_revision_without_an_entry_says_whether_it_was_removed_or_cannot_be_read() -> None:
    one = revised(1, an_entry(), None)
    removed: Revision = replace(one.revision, oid=None)
    nothing = ["–"] * 7
    assert row(EntryRevision(revision=one.revision))[2:10] == ["unreadable", *nothing]
    assert row(EntryRevision(revision=removed))[2:10] == ["removed", *nothing]


def test_a_change_is_told_field_by_field_and_a_removal_without_fields() -> None:
    old = an_entry(label="P4R-03")
    before, after = revised(1, old, None), revised(2, replace(old, label=None, tags=("lab",)), old)
    assert [[*one] for one in _fields(after, before).rows] == [
        ["label", "P4R-03", "–"],
        ["tags", "–", "lab"],
    ]
    assert _fields(EntryRevision(revision=before.revision), before).rows == ()


def test_a_format_that_cannot_hold_the_lens_is_listed_with_the_reason_and_the_others_have_a_file() -> None:
    found = {one.format: one for one in downloads(an_entry(), b"schema")}
    assert found["entry"].data == b"schema"
    assert found["opencv_storage"].name == "fc6310r-5472x3648-opencv_storage.yml"
    assert b"camera_matrix" in found["opencv_storage"].data
    # Pix4D has one focal length, and Kalibr's radtan no k3.
    for name, why in (
        ("pix4d_cam", "has no place for an fx − fy of 2.5 px"),
        ("kalibr", "has no brown model"),
    ):
        none = found[name]
        assert (none.name, none.data) == (None, b"")
        assert none.remark == f"{why}; calibrary convert fits the nearest and says how far it is off"
