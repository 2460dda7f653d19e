"""Every labelled pair gets the verdict, the exit code and the words that it should."""

from __future__ import annotations

import pytest

from calibrary.errors import InputError
from calibrary.jobs.diff.comparison import compare
from tests.jobs.diff.pairs import PAIRS, Pair
from tests.jobs.diff.pairs_of_scale import PAIRS_OF_SCALE

ALL = (*PAIRS, *PAIRS_OF_SCALE)


@pytest.mark.parametrize("pair", ALL, ids=lambda pair: pair.name)
def test_a_labelled_pair_is_judged_as_labelled(pair: Pair) -> None:
    if pair.verdict is None:
        with pytest.raises(InputError, match=pair.says):
            compare(pair.a, pair.b)
        return
    found = compare(pair.a, pair.b)
    shown = "\n".join((*found.reasons, *found.warnings, found.advice))
    assert (found.verdict, found.alarm) == (pair.verdict, pair.alarm), shown
    assert pair.kind is None or pair.kind in {one.kind for one in found.structural}, shown
    assert pair.says in shown


def test_there_are_enough_of_them() -> None:
    assert len({pair.name for pair in ALL}) == len(ALL) >= 60
