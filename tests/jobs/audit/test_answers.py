"""What an audit says of a camera for which the registry has no single entry."""

from __future__ import annotations

from datetime import date
from pathlib import Path
from types import SimpleNamespace

import pytest

from calibrary.errors import AmbiguousEntryError, RegistryError
from calibrary.jobs.audit.findings import answer_to
from calibrary.jobs.audit.flights import Flown
from calibrary.jobs.audit.report import Rule
from tests.registry.entries import KEY


@pytest.mark.parametrize(
    ("error", "rule"),
    [
        (AmbiguousEntryError("2 entries match this camera alike: retire one"), Rule.SEVERAL),
        (RegistryError("cameras/a.yaml: line 3: two entries match equally well, it says"), Rule.BROKEN),
    ],
)
def test_several_entries_and_a_broken_one_are_told_apart_by_the_kind_of_error(
    error: RegistryError, rule: Rule
) -> None:
    def resolve(*_: object, **__: object) -> None:
        raise error

    camera = SimpleNamespace(count=1, names=("a.jpg",))
    flown = Flown(key=KEY, camera=camera, first=None, last=None, example=Path("a.jpg"))  # type: ignore[arg-type]
    answer = answer_to(flown, SimpleNamespace(resolve=resolve), date(2026, 1, 2))  # type: ignore[arg-type]
    assert answer.finding is not None
    assert (answer.finding.rule, answer.finding.message) == (rule, str(error))
