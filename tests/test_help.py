"""``help(calibrary)`` and that of every public name."""

from __future__ import annotations

import pydoc

import pytest

import calibrary

NAMES = [name for name in calibrary.__all__ if not name.startswith("__")]


def test_the_package_explains_itself() -> None:
    told = pydoc.plain(pydoc.render_doc(calibrary))
    assert [name for name in NAMES if name not in told] == []


@pytest.mark.parametrize("name", NAMES)
def test_every_public_name_explains_itself(name: str) -> None:
    assert len(pydoc.plain(pydoc.render_doc(getattr(calibrary, name)))) > 100
