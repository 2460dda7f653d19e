"""The flight, written once for all who look at it."""

from __future__ import annotations

from pathlib import Path
from typing import TypeAlias

import pytest

from calibrary.jobs.demo import DemoImage, write_flight

Flight: TypeAlias = tuple[Path, list[DemoImage]]


@pytest.fixture(scope="session")
def flight(tmp_path_factory: pytest.TempPathFactory) -> Flight:
    out = tmp_path_factory.mktemp("flight")
    return out, write_flight(out)
