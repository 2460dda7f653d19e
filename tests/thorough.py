"""How often a test repeats itself: often enough to fail where something breaks; ``make test-thorough`` is more."""

from __future__ import annotations

import os

THOROUGH = os.environ.get("HYPOTHESIS_PROFILE") == "thorough"


def examples(few: int, many: int | None = None) -> int:
    """So many: ``few`` in every run, ``many`` (by default twenty times as many) in a thorough one."""
    return (20 * few if many is None else many) if THOROUGH else few
