"""What tests cost, in seconds of CPU: each at most one, unless ``dear.csv`` lists it with its reason.

A row names a test, or a file for each of its tests, and the seconds that it may take. What several tests share, a
fixture of a file or of the session, may take four or is listed by its own name, and no test pays for it. A process
that a test starts counts when it has ended. Processors differ and are shared, so only what takes four times as much
fails.
"""

from __future__ import annotations

import csv
import os
from collections import defaultdict
from collections.abc import Generator, Iterable
from pathlib import Path

import pytest

DEAR = Path(__file__).with_name("dear.csv")
USUAL_S = 1.0
SHARED_S = 4.0
"""Of what several tests share."""
FACTOR = 4.0
"""From what is allowed to what fails."""


def read_dear(path: Path = DEAR) -> dict[str, float]:
    """Seconds by the name of a test, a file or a fixture."""
    with path.open(encoding="utf-8", newline="") as rows:
        return {row["name"]: float(row["seconds"]) for row in csv.DictReader(rows)}


def complaint(dear: dict[str, float], cost: float, *names: str, usual: float = USUAL_S) -> str | None:
    """What is said of something too dear; its limit is that of the first of its names that is listed."""
    limit = next((dear[name] for name in names if name in dear), usual)
    if cost <= FACTOR * limit:
        return None
    return f"{names[0]} took {cost:.1f} s of CPU and may take {limit:g}: make it cheaper, or list it in {DEAR.name}"


def by_room(costs: Iterable[tuple[str, float]]) -> str:
    """The sum of all tests and that of each room, the dearest first."""
    rooms: defaultdict[str, float] = defaultdict(float)
    for test, seconds in costs:
        rooms[test.removeprefix("tests/").partition("::")[0].partition("/")[0]] += seconds
    dearest = sorted(rooms.items(), key=lambda room: -room[1])
    parts = ", ".join(f"{room} {seconds:.0f}" for room, seconds in dearest if seconds >= 1)
    return f"{sum(rooms.values()):.0f} s of CPU: {parts}"


def used() -> float:
    """Seconds of CPU of this process and of those that it waited for."""
    return sum(os.times()[:4])


class Meter:
    """A plugin of pytest: measures each test and each shared fixture, and fails what is too dear."""

    def __init__(self, dear: dict[str, float], *, fails: bool) -> None:
        self._dear, self._fails = dear, fails
        self._start = self._shared = 0.0

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self) -> Generator[None, object, object]:
        """From here on a test pays."""
        self._start, self._shared = used(), 0.0
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: pytest.FixtureDef[object]) -> Generator[None, object, object]:
        """What is shared is made once, by whichever test comes first, and it does not pay for it."""
        if fixturedef.scope == "function":
            return (yield)
        start, before = used(), self._shared
        made = yield
        cost = used() - start - (self._shared - before)
        self._shared += cost
        self._fail_if_dear(cost, f"{fixturedef.baseid}::{fixturedef.argname}", usual=SHARED_S)
        return made

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Generator[None, object, object]:
        """The test, with what it alone was given."""
        result = yield
        test = item.nodeid.partition("[")[0]
        self._fail_if_dear(used() - self._start - self._shared, item.nodeid, test, test.partition("::")[0])
        return result

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_teardown(self, item: pytest.Item) -> None:
        """The report has all of it: CI waits for what is shared, too."""
        item.user_properties.append(("cpu", round(used() - self._start, 3)))

    def _fail_if_dear(self, cost: float, *names: str, usual: float = USUAL_S) -> None:
        said = complaint(self._dear, cost, *names, usual=usual)
        if said is not None and self._fails:
            pytest.fail(said, pytrace=False)
