"""Registries to publish, and what their files contain."""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import date
from pathlib import Path
from types import MappingProxyType
from typing import Any

from calibrary.known_camera import hash_serial
from calibrary.registry.configuration import configuration_yaml, parse_configuration
from calibrary.registry.entry import Alias, Entry, Status, Validity
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.firmware import FirmwareRange
from calibrary.registry.git.repository import create
from calibrary.registry.git.writing import FileChange, write
from calibrary.registry.places import PUBLISHED_FILE
from calibrary.registry.published.write import Publication, publish
from calibrary.registry.registry import Registry, open_snapshot
from calibrary.registry.stating import founded
from tests.registry.entries import an_entry, statements_on
from tests.registry.git.repositories import nobodys_git

__all__ = [
    "FLEET",
    "UNIT",
    "camera",
    "commit",
    "document",
    "files_of",
    "listed",
    "manifest",
    "nobodys_git",
    "published",
    "rows_of",
]

UNIT = hash_serial("DJI", "0V2LG3H0")
FLEET = (
    an_entry(focal_mm=None),
    an_entry(focal_mm=None, size=(4864, 3648)),
    an_entry(focal_mm=None, fx=3655.5, serial=UNIT),
    an_entry(focal_mm=None, fx=3640.0, firmware=FirmwareRange(min="01.09")),
    an_entry(
        model="FC330", focal_mm=3.61, size=(4000, 3000), fx=2290.0, status=Status.RETIRED, reason="dropped"
    ),
    an_entry(make="Bild & Flug", model="Weiß/Kamera", aliases=(Alias(make="Other", model="P4 RTK"),)),
    an_entry(model="DRAFT", status=Status.DRAFT),
)
"""A model at two sizes with a unit and a firmware, a retired one, one of two names, and a draft."""

SPRING, AUTUMN = Validity(first=date(2026, 3, 1), last=date(2026, 8, 31)), Validity(first=date(2026, 9, 1))


def commit(
    folder: Path,
    *entries: Entry,
    raw: Mapping[str, bytes | None] = MappingProxyType({}),
    message: str = "Put it there\n",
) -> str:
    """Put entries and other files into a registry, which is made where there is none; the commit."""
    if not folder.exists():
        repo, configuration = create(folder, durable=False), configuration_yaml()
        begun = FileChange(path="registry.yaml", data=configuration)
        write(repo, [begun, *founded(repo, parse_configuration(configuration).rules)], "Begin\n")
    registry = Registry.open(folder)
    there = registry.repo.listing(registry.commit(), "")
    files: dict[str, bytes | None] = {entry.path: entry_yaml(entry) for entry in entries}
    files |= raw
    changes = [FileChange(path=path, data=data, base=there.get(path)) for path, data in files.items()]
    return write(registry.repo, [*changes, *statements_on(registry, entries)], message).commit


def dated(folder: Path) -> None:
    """One camera over a year: of unknown days, of the spring, of the autumn."""
    for fx, validity in ((3600.0, None), (3610.0, SPRING), (3620.0, AUTUMN)):
        commit(folder, an_entry(model="DATED", fx=fx, validity=validity))


def published(folder: Path, out: Path, key: Path | None = None, *, valid_days: int = 90) -> Publication:
    """The registry in a folder, published as it is."""
    return publish(open_snapshot(folder), out, sign=key, valid_days=valid_days)


def document(out: Path, path: str) -> Any:
    """What a published file contains."""
    return json.loads((out / path).read_bytes())


def manifest(out: Path) -> Any:
    """What is signed."""
    return document(out, PUBLISHED_FILE)["manifest"]


def listed(out: Path) -> Any:
    """The list of cameras."""
    return document(out, f"data/{manifest(out)['cameras']}.json")


def camera(out: Path, name: str) -> Path:
    """The file of a camera, by its name in the list."""
    return out / f"data/{listed(out)['cameras'][name]}.json"


def rows_of(out: Path, name: str) -> Any:
    """The entries of a camera."""
    return json.loads(camera(out, name).read_bytes())["entries"]


def files_of(out: Path) -> dict[str, bytes]:
    """Every file that is given out but for the manifest, by path."""
    found = {path.relative_to(out).as_posix(): path.read_bytes() for path in out.rglob("*") if path.is_file()}
    return {path: data for path, data in found.items() if path != PUBLISHED_FILE and path[0] != "."}
