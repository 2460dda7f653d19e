"""Commands are tested for what they write, not for how a plot looks."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.pages.sketches import sketched


@pytest.fixture(autouse=True)
def plain() -> Iterator[None]:
    """No plot of a page is drawn in full."""
    with sketched():
        yield
