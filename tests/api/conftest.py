"""Fixtures of the door's tests."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.api.workshop import furnish
from tests.registry.git.repositories import seclude


@pytest.fixture(scope="session")
def furnished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a file for every example; made once, not to be changed."""
    folder = tmp_path_factory.mktemp("workshop")
    with pytest.MonkeyPatch.context() as patch:
        seclude(patch, tmp_path_factory.mktemp("home"))
        furnish(folder)
    return folder
