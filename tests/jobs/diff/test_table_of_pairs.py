"""A table of pairs over all lens models: no verdict is wrong, and the cause is named."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from calibrary.distortion import MODELS
from calibrary.errors import CalibraryError
from calibrary.jobs.diff.comparison import compare
from tests.jobs.diff.changes import CHANGES, Row, lenses, rows

LENSES = Path(__file__).with_name("lenses.csv")


def judged(pair: Row) -> tuple[bool, bool, str]:
    """Whether the verdict is right, whether the cause is named, and what is shown."""
    expected = CHANGES[pair.change]
    try:
        found = compare(pair.a, pair.b)
    except CalibraryError as error:
        said = str(error)
        return not expected.verdicts, any(word in said for word in expected.cause), said
    kinds = [one.kind.value for one in found.structural]
    shown = " | ".join((found.verdict, *kinds, *found.reasons, *found.warnings, found.advice))
    matters = found.numbers is None or found.numbers.matters
    alarm = matters if expected.alarm is None else expected.alarm
    right = found.verdict in expected.verdicts and found.alarm is alarm
    return right, any(word in shown for word in expected.cause), shown


@pytest.mark.thorough
def test_no_verdict_is_wrong_and_19_of_20_causes_are_named() -> None:
    pairs = list(rows(LENSES))
    results = [(f"{pair.lens}, {pair.change}, by {pair.through}", *judged(pair)) for pair in pairs]
    assert [(name, shown) for name, right, _, shown in results if not right] == []
    unnamed = [(name, shown) for name, _, named, shown in results if not named]
    assert len(pairs) >= 600
    assert len(unnamed) <= 0.05 * len(pairs), unnamed
    assert {pair.change for pair in pairs} == CHANGES.keys()
    assert len(Counter(pair.through for pair in pairs)) >= 12


def test_the_table_has_every_lens_model() -> None:
    assert {
        one.distortion.model for one in lenses(LENSES).values() if one.distortion is not None
    } == MODELS.keys()
