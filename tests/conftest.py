"""What all tests share: how hypothesis runs."""

from __future__ import annotations

import os

import pytest
from hypothesis import settings

# The same examples in every run, so that a change is judged by what it changed; HYPOTHESIS_PROFILE=explore
# looks for new ones. A machine busy with something else is no failure: hangs are caught by the suite's own time.
settings.register_profile("steady", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None, max_examples=1000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "steady"))


@pytest.fixture(autouse=True, scope="session")
def wide() -> None:
    """Commands do not fold lines, so that a test can look for a sentence; tests of widths set their own."""
    os.environ["COLUMNS"] = "2000"
