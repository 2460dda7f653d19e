"""How long work reports how far it is: one signature everywhere."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

__all__ = ["Progress"]

Progress: TypeAlias = Callable[[int, int, str], None]
"""Called with (done, total, what): how many of how many, and of what, as "images"."""
