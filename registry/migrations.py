"""Documents of older schema versions brought to the present one when they are read; newer ones are refused."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Final, TypeAlias

from calibrary.errors import ParseError
from calibrary.strictyaml import YamlValue

__all__ = ["CURRENT", "MIGRATIONS", "migrated"]

Document: TypeAlias = "dict[str, YamlValue]"

CURRENT: Final = 1


def _from_first_cut(document: Document) -> Document:
    """Version 0 had one firmware, one note, and no digest. It called itself entry-1; the missing digest tells it."""
    changed: Document = {**document, "schema": "calibrary/entry-1"}
    camera = document.get("camera")
    if isinstance(camera, dict) and isinstance(firmware := camera.get("firmware"), str):
        changed["camera"] = {**camera, "firmware": {"min": firmware, "max": firmware}}
    if "notes" in document and not isinstance(notes := document["notes"], list):
        changed["notes"] = [notes] if notes is not None else []
    return changed


MIGRATIONS: Final[Mapping[int, Callable[[Document], Document]]] = {0: _from_first_cut}
"""How a document of one version becomes one of the next, by the version it is of."""


def migrated(value: YamlValue, *, source: str) -> Document:
    """The document in the present version; what is not one is left for the schema to complain of.

    Raises:
        ParseError: it is no map, names no version, or one that is newer than this program.
    """
    if not isinstance(value, dict):
        raise ParseError("is no map of an entry's fields", source=source)
    found = _version(value, source)
    if found > CURRENT:
        raise ParseError(
            f"is of schema version {found}, and this calibrary reads versions up to {CURRENT}; "
            "upgrade it (pip install --upgrade calibrary)",
            source=source,
            place="schema",
        )
    for step in range(found, CURRENT):
        value = MIGRATIONS[step](value)
    return value


def _version(document: Document, source: str) -> int:
    name = document.get("schema")
    told = re.fullmatch(r"calibrary/entry-(\d{1,9})", name) if isinstance(name, str) else None
    if told is None:
        found = f"{name!r:.60}, wanted" if "schema" in document else "missing; wanted"
        raise ParseError(
            f"schema is {found} 'calibrary/entry-{CURRENT}': is this a registry's entry?", source=source
        )
    stated = int(told[1])
    return 0 if stated == 1 and "digest" not in document else stated
