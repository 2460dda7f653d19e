"""How often a test repeats itself: often enough to fail where something breaks; ``make test-thorough`` is more."""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import TypeVar

Case = TypeVar("Case")

THOROUGH = os.environ.get("HYPOTHESIS_PROFILE") == "thorough"


def examples(few: int, many: int | None = None) -> int:
    """So many: ``few`` in every run, ``many`` (by default twenty times as many) in a thorough one."""
    return (20 * few if many is None else many) if THOROUGH else few


def every(step: int, cases: Iterable[Case]) -> list[Case]:
    """All cases in a thorough run, else the first and every so many after it."""
    return [*cases][:: 1 if THOROUGH else step]
