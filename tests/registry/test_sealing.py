"""The verdict on a calibration goes with its entry, whatever is written over, edited or combined."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from calibrary.jobs.fleet import open_registry
from calibrary.records import replace
from calibrary.registry.entry import VERDICT_BLOCK, Entry, Status, noted, seal, sealed
from calibrary.registry.init import init
from calibrary.registry.resolution import resolve
from tests.registry.entries import an_entry

PROVISIONAL = "start: not good enough to be approved"


def judged(verdict: str, *, reasons: tuple[str, ...] = ("few-views",), **fields: Any) -> Entry:
    entry = an_entry(**fields)
    block = seal(entry.calibration, verdict, list(reasons), {})
    return replace(entry, extensions={VERDICT_BLOCK: block})


@pytest.mark.parametrize(
    ("entry", "verdict"),
    [
        (judged("fixed"), "fixed"),
        (judged("start"), "start"),
        (judged("none"), "none"),
        (judged("splendid"), "splendid"),
        # The words of entries from before a verdict said what K is good for.
        (judged("pass"), "fixed"),
        (judged("provisional"), "start"),
        (judged("refuse"), "none"),
        (an_entry(), None),
        (an_entry(notes=(PROVISIONAL,)), "start"),
        (an_entry(notes=("start: until the lab has time",)), None),
        (judged("fixed", notes=(PROVISIONAL,)), "start"),
        # As earlier entries have it: without the digest of what was judged.
        (replace(an_entry(), extensions={VERDICT_BLOCK: {"verdict": "start"}}), "start"),
        (replace(an_entry(), extensions={VERDICT_BLOCK: ["start"]}), None),
        # The verdict is on another K.
        (replace(an_entry(fx=3700.0), extensions=judged("fixed").extensions), None),
    ],
)
def test_the_verdict_on_an_entry(entry: Entry, verdict: str | None) -> None:
    found = sealed(entry)
    assert (found.verdict if found is not None else None) == verdict
    assert noted(entry).shortfall == (verdict if verdict != "fixed" else None)


@pytest.mark.parametrize(
    ("verdict", "usable"), [("fixed", True), ("provisional", True), ("refuse", False), ("splendid", False)]
)
def test_only_a_verdict_that_is_known_to_allow_it_makes_k_usable(verdict: str, usable: bool) -> None:
    found = sealed(judged(verdict))
    assert found is not None
    assert found.is_usable is usable


def test_a_start_stays_one_where_its_notes_were_removed() -> None:
    entry = judged("start")
    found = resolve({entry.path: entry}, entry.calibration.camera)
    assert found is not None
    for calibration in (noted(entry), found.calibration):
        assert calibration.shortfall == "start"
        assert "few-views: of its calibration" in calibration.notes
    assert noted(judged("fixed")) == judged("fixed").calibration


def test_another_k_does_not_inherit_the_verdict(tmp_path: Path) -> None:
    init(tmp_path / "fleet")
    fleet = open_registry(tmp_path / "fleet")
    fleet.propose_entries([replace(judged("fixed"), status=Status.DRAFT)]).write()
    for fx, verdict in ((3661.25, "fixed"), (3700.0, None)):
        [one] = open_registry(tmp_path / "fleet").propose_entries([an_entry(fx=fx)]).proposals.items
        found = sealed(one.after)
        assert (found.verdict if found is not None else None) == verdict
        assert (VERDICT_BLOCK in one.after.extensions) == (verdict is not None)
