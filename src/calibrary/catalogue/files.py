"""The catalogue's files: YAML of schemas/catalogue-1.schema.json to KnownCamera."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache, partial
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any, Final

from calibrary.catalogue.matching import Catalogue
from calibrary.errors import InputError, ParseError
from calibrary.known_camera import KnownCamera, Name, Text
from calibrary.records import Json, Meta, Record, from_json, to_json
from calibrary.strictyaml import line_of, load_yaml

__all__ = ["CatalogueListing", "Maker", "load_catalogue", "search_catalogue", "shipped_with"]

LARGEST_FILE: Final = 1 << 22


class Maker(Record, tag_field="schema", tag="calibrary/catalogue-1"):
    """One maker's cameras, as known before any image of them is read.

    Attributes:
        make: EXIF Make; letter case and blanks do not matter.
        references: what the first word of a source stands for.
        cameras: of this make, which is not repeated in them.

    Raises:
        InputError: a camera is of another make.
    """

    make: Name
    references: Mapping[str, Text] = {}
    cameras: Annotated[tuple[KnownCamera, ...], Meta(min_length=1)]

    def __post_init__(self) -> None:
        if any(camera.make != self.make for camera in self.cameras):
            raise InputError(f"a camera is not of {self.make}", place="cameras")

    def _wire(self, document: dict[str, Json]) -> dict[str, Json]:
        cameras: list[Json] = []
        for camera in self.cameras:
            written = to_json(camera)
            del written["make"]
            cameras.append(written)
        return document | {"cameras": cameras}

    @classmethod
    def _unwire(cls, document: dict[str, Json]) -> dict[str, Json]:
        make, cameras = document.get("make"), document.get("cameras")
        if isinstance(cameras, list):
            if any(isinstance(camera, dict) and "make" in camera for camera in cameras):
                raise InputError("is the file's make, not a key of a camera", place="cameras")
            document["cameras"] = [{"make": make, **one} if isinstance(one, dict) else one for one in cameras]
        return document

    @classmethod
    def _wire_schema(cls, schema: dict[str, Any], defs: dict[str, Any]) -> dict[str, Any]:
        camera = defs["KnownCamera"]
        del camera["properties"]["make"]
        camera["required"].remove("make")
        return schema


class CatalogueListing(Record, tag_field="schema", tag="calibrary/catalogue-listing-1"):
    """What calibrary catalogue --json prints.

    Attributes:
        cameras: known ones, of all makers.
    """

    cameras: tuple[KnownCamera, ...]


def load_catalogue(path: Path | None = None) -> Catalogue:
    """The catalogue that is shipped, or one of your own.

    Args:
        path: a YAML file, or a folder of them. None for the shipped one.

    Raises:
        InputError: nothing to read there, or two entries that are one camera.
        ParseError: a file is not YAML, or breaks the schema.
    """
    if path is None:
        return _shipped()
    sources = sorted(path.glob("*.yaml")) if path.is_dir() else [path]
    if not sources:
        raise InputError("no catalogue here: expected a YAML file, or a folder with some", source=str(path))
    return Catalogue(camera for one in sources for camera in _cameras(_content(one), one.name))


def search_catalogue(text: str) -> list[KnownCamera]:
    """What :meth:`Catalogue.search` finds in the shipped catalogue."""
    return Catalogue(shipped_with(text.split())).search(text)


def shipped_with(words: Iterable[str]) -> list[KnownCamera]:
    """The shipped cameras of the makers' files that contain every word, in any case; the others are not parsed."""
    wanted = [word.casefold() for word in words]
    return [
        camera
        for name, text in _shipped_files().items()
        if all(word in text.casefold() for word in wanted)
        for camera in _shipped_cameras(name)
    ]


@cache
def _shipped() -> Catalogue:
    return Catalogue(camera for name in _shipped_files() for camera in _shipped_cameras(name))


@cache
def _shipped_cameras(name: str) -> tuple[KnownCamera, ...]:
    return _cameras(_shipped_files()[name].encode(), name)


@cache
def _shipped_files() -> dict[str, str]:
    # Not by importlib.resources, which loads twenty modules to say the same.
    package = find_spec("calibrary.registry")
    [folder] = package.submodule_search_locations or [] if package is not None else []
    paths = sorted(Path(folder, "catalogue").glob("*.yaml"))
    return {path.name: path.read_text(encoding="utf-8") for path in paths}


def _content(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_FILE + 1)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", source=str(path)) from None
    if len(data) > LARGEST_FILE:
        raise ParseError(f"is larger than {LARGEST_FILE >> 20} MiB, expected a catalogue", source=str(path))
    return data


def _cameras(data: bytes, name: str) -> tuple[KnownCamera, ...]:
    document = load_yaml(data, source=name)
    return from_json(Maker, document, source=name, locate=partial(line_of, data)).cameras
