"""The flight under the name these tests know it by."""

from __future__ import annotations

from pathlib import Path
from typing import TypeAlias

import pytest

from calibrary.jobs.demo.flight import DemoImage

Flight: TypeAlias = tuple[Path, list[DemoImage]]


@pytest.fixture(scope="session")
def flight(demo_flight: Flight) -> Flight:
    return demo_flight
