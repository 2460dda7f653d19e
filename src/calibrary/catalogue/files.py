"""Reading of the catalogue's YAML files (schemas/catalogue-1.schema.json) into KnownCamera."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, Final

from calibrary.catalogue.matching import Catalogue
from calibrary.errors import InputError, ParseError
from calibrary.known_camera import KnownCamera, Name, Text
from calibrary.records import Json, Meta, Record, from_json, to_json
from calibrary.strictyaml import line_of, load_yaml

__all__ = [
    "CatalogueListing",
    "Maker",
    "camera_named",
    "load_catalogue",
    "search_catalogue",
    "shipped_catalogue",
    "shipped_folder",
    "shipped_with",
]

LARGEST_FILE: Final = 1 << 22


class Maker(Record, tag_field="schema", tag="calibrary/catalogue-1"):
    """One maker's cameras, as the catalogue file states them.

    Attributes:
        make: EXIF Make; letter case and blanks are ignored.
        references: full source by the short name that a ``source`` begins with.
        cameras: cameras of this make; the make is not repeated in them.

    Raises:
        InputError: a camera has another make.
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
    """Output of calibrary catalogue --json.

    Attributes:
        cameras: the known cameras of all makers.
    """

    cameras: tuple[KnownCamera, ...]


def load_catalogue(path: Path | None = None) -> Catalogue:
    """Load the shipped catalogue, or one of your own.

    Args:
        path: a YAML file, or a folder of them. None for the shipped one.

    Raises:
        InputError: there is nothing to read, or two entries describe the same camera.
        ParseError: a file is not YAML or violates the schema.
    """
    if path is None:
        return shipped_catalogue()
    sources = sorted(path.glob("*.yaml")) if path.is_dir() else [path]
    if not sources:
        raise InputError("no catalogue here: expected a YAML file, or a folder with some", source=str(path))
    return Catalogue(camera for one in sources for camera in _cameras(_content(one), one.name))


def search_catalogue(text: str) -> list[KnownCamera]:
    """Cameras that :meth:`Catalogue.search` finds in the shipped catalogue."""
    return Catalogue(shipped_with(text.split())).search(text)


def camera_named(name: str) -> KnownCamera:
    """The one camera of the shipped catalogue with this Model or title, or with one that contains it.

    Raises:
        InputError: no camera matches, or several do.
    """
    found, wanted = search_catalogue(name), name.strip().casefold()
    exact = [
        camera
        for camera in found
        if wanted in {camera.title.casefold(), *(model.casefold() for model in camera.models)}
    ]
    found = exact or found
    if len(found) == 1:
        return found[0]
    titles = "; ".join(camera.title for camera in found[:8]) + (" …" if len(found) > 8 else "")
    like = f"{len(found)} like it ({titles})" if found else "none like it"
    raise InputError(
        f"camera {name!r}: the catalogue has {like}; expected one Model or title of those that 'calibrary catalogue' "
        "lists"
    )


def shipped_with(words: Iterable[str]) -> list[KnownCamera]:
    """The cameras in those shipped files that contain every word, ignoring case; other files are not parsed."""
    wanted = [word.casefold() for word in words]
    return [
        camera
        for name, text in _shipped_files().items()
        if all(word in text.casefold() for word in wanted)
        for camera in _cameras(text.encode(), name)
    ]


def shipped_folder() -> Path:
    """The folder of the catalogue's files; importlib.resources would load twenty modules to give the same path."""
    return Path(__file__).parents[1] / "registry" / "catalogue"


@cache
def shipped_catalogue() -> Catalogue:
    """The shipped catalogue, read once per process."""
    return Catalogue(
        [camera for name, text in _shipped_files().items() for camera in _cameras(text.encode(), name)]
    )


@cache
def _shipped_files() -> dict[str, str]:
    return {path.name: path.read_text(encoding="utf-8") for path in sorted(shipped_folder().glob("*.yaml"))}


def _content(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_FILE + 1)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", source=str(path)) from None
    if len(data) > LARGEST_FILE:
        raise ParseError(f"is larger than {LARGEST_FILE >> 20} MiB, expected a catalogue", source=str(path))
    return data


@cache
def _cameras(data: bytes, name: str) -> tuple[KnownCamera, ...]:
    document = load_yaml(data, source=name)
    return from_json(Maker, document, source=name, locate=partial(line_of, data)).cameras
