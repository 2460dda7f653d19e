"""Any entry that a registry may hold has a page, whatever its numbers and names are."""

from __future__ import annotations

from datetime import UTC, datetime

import numpy as np
from hypothesis import given, settings

from calibrary.jobs.site.building import entry_files
from calibrary.jobs.site.camera_page import steps
from calibrary.jobs.site.folder import Place
from calibrary.policy import FLEET
from calibrary.registry.entry import Entry
from calibrary.registry.git.history import Revision
from calibrary.registry.git.writing import Person
from calibrary.registry.history import EntryRevision
from tests.registry.entries import entries
from tests.thorough import examples

SOMEBODY = Person(name="Ada Keeper", email="ada@example.com")
NOON = datetime(2026, 5, 1, 12, tzinfo=UTC)


def revised(number: int, entry: Entry, before: Entry | None) -> EntryRevision:
    revision = Revision(
        commit=f"{number:040x}",
        parents=(),
        path=entry.path,
        oid=f"{number:040x}",
        author=SOMEBODY,
        authored=NOON,
        committer=SOMEBODY,
        committed=NOON,
        message="Calibrate",
    )
    return EntryRevision(revision=revision, entry=entry, before=before)


@settings(max_examples=examples(4))
@given(entries(), entries())
def test_any_entry_has_a_page(old: Entry, new: Entry) -> None:
    place = Place.of(new.path, proper=True)
    revisions = (revised(2, new, old), revised(1, old, None))
    with np.errstate(all="ignore"):
        content = entry_files(
            new,
            data=b"",
            id_=new.id,
            place=place,
            revisions=revisions,
            changes=steps(new.id, revisions, FLEET),
        )
    pages = [data for address, data in content.items() if address.endswith(".html")]
    assert pages
    assert all(page.rstrip().endswith(b"</html>") for page in pages)
