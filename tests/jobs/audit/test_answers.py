"""What an audit says of a camera for which the registry has no single entry."""

from __future__ import annotations

from datetime import date
from pathlib import Path
from types import SimpleNamespace

import pytest

from calibrary.calibration import CameraKey
from calibrary.errors import AmbiguousEntryError, RegistryError
from calibrary.jobs.audit.age import Rule
from calibrary.jobs.audit.findings import _count, answer_to
from calibrary.jobs.audit.flights import Flown
from calibrary.jobs.audit.report import Change, UnitOverTime, Use, Verification
from calibrary.jobs.audit.told import MOST_SERIES, _time_section
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


@pytest.mark.parametrize(
    ("images", "last", "said"),
    [(1, None, "it flew (1 image)"), (2, date(2026, 5, 1), "it flew (2 images, last on 2026-05-01)")],
)
def test_what_flew_is_counted_with_its_last_day(images: int, last: date | None, said: str) -> None:
    assert _count(SimpleNamespace(images=images, last=last)) == said  # type: ignore[arg-type]


@pytest.mark.parametrize("key", [CameraKey(), CameraKey(make="DJI"), CameraKey(model="FC6310R")])
def test_a_camera_without_make_or_model_is_looked_for_nowhere(key: CameraKey) -> None:
    camera = SimpleNamespace(count=1, names=("a.jpg",))
    flown = Flown(key=key, camera=camera, first=None, last=None, example=Path("a.jpg"))  # type: ignore[arg-type]
    assert answer_to(flown, SimpleNamespace(), date(2026, 1, 2)).use is Use.NONE  # type: ignore[arg-type]


@pytest.mark.parametrize("more", [0, 2])
def test_the_units_that_a_page_leaves_out_are_counted(more: int) -> None:
    unit = UnitOverTime(
        name="one", camera=KEY, flights=(), change=Change.STEADY, by=None, std=None, reason="nothing moved"
    )
    done = Verification(images=8, minutes=5.0, left_out=0, units=(unit,) * (MOST_SERIES + more))
    counts = [
        block for block in _time_section(done).blocks if isinstance(block, str) and "more units" in block
    ]
    assert counts == ([f"{more} more units are in the JSON."] if more else [])
