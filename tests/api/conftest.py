"""Fixtures of the door's tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.api.workshop import furnish


@pytest.fixture(scope="session")
def furnished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a file for every example; made once, not to be changed."""
    folder = tmp_path_factory.mktemp("workshop")
    furnish(folder)
    return folder
