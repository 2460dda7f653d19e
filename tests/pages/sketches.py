"""Pages without the cost of their plots, for tests of what stands around them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

import pytest


@contextmanager
def sketched() -> Iterator[None]:
    """Plots are painted but neither laid out nor written: most of a page's time, and tests/pages looks at that."""
    from matplotlib.figure import Figure

    def save(self: Figure, file: TextIO, **_: object) -> None:
        width, height = self.get_size_inches() * self.dpi
        file.write(
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}"><path d="M0 0h9"/></svg>'
        )

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Figure, "savefig", save)
        yield
