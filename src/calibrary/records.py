"""What every record shares: how one is copied with changes, and the plain data it is written as."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeAlias, TypeVar

import msgspec

__all__ = ["Json", "replace"]

Json: TypeAlias = "bool | int | float | str | list[Json] | dict[str, Json] | None"
"""A JSON document or a part of one."""

T = TypeVar("T")


def replace(record: T, /, **changes: Any) -> T:
    """A copy of a record with some fields changed.

    Raises:
        TypeError: it has no such field.
    """
    if isinstance(record, msgspec.Struct):
        return msgspec.structs.replace(record, **changes)
    copied: T = dataclasses.replace(record, **changes)  # type: ignore[type-var]
    return copied
