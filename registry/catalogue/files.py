"""The catalogue's files: YAML of schemas/catalogue-1.schema.json to KnownCamera, and back."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache, partial
from importlib.resources import files
from pathlib import Path
from typing import Final, NotRequired, TypedDict, TypeVar, cast

from calibrary.errors import InputError, ParseError
from calibrary.known_camera import KnownCamera, Projection
from calibrary.records import Json
from calibrary.registry.catalogue.matching import Catalogue
from calibrary.schemas import require
from calibrary.strictyaml import line_of, load_yaml

__all__ = ["load_catalogue", "to_json"]

SCHEMA: Final = "catalogue-1"
LARGEST_FILE: Final = 1 << 22

T = TypeVar("T", int, float)


class _Number(TypedDict):
    value: float
    source: str


class _Pair(TypedDict):
    value: list[float]
    source: str


class _Size(TypedDict):
    value: list[int]
    source: str


class _Word(TypedDict):
    value: str
    source: str


class _Flag(TypedDict):
    value: bool
    source: str


class _Camera(TypedDict):
    title: str
    models: list[str]
    other_makes: NotRequired[list[str]]
    sub_camera: NotRequired[str]
    bands: NotRequired[list[str]]
    lens: NotRequired[str]
    native_size: NotRequired[_Size]
    pitch_um: NotRequired[_Number]
    sensor_width_mm: NotRequired[_Number]
    focal_mm: NotRequired[_Number]
    zoom_mm: NotRequired[_Pair]
    focal_35mm: NotRequired[_Number]
    projection: NotRequired[_Word]
    fx_over_w: NotRequired[_Number]
    spread: NotRequired[_Number]
    exif_focal_trusted: NotRequired[_Flag]
    conflicts: NotRequired[list[str]]
    notes: NotRequired[list[str]]


class _Maker(TypedDict):
    make: str
    cameras: list[_Camera]


def load_catalogue(path: Path | None = None) -> Catalogue:
    """The catalogue that is shipped, or one of your own.

    Args:
        path: a YAML file, or a folder of them; they are held against the schema first. None for the shipped
            one, which the tests hold against it.

    Raises:
        InputError: nothing to read there, or two entries that are one camera.
        ParseError: a file is no YAML, or breaks the schema.
    """
    if path is None:
        return _shipped()
    sources = sorted(path.glob("*.yaml")) if path.is_dir() else [path]
    if not sources:
        raise InputError("no catalogue here: expected a YAML file, or a folder with some", source=str(path))
    return Catalogue(camera for source in sources for camera in _read(source))


def to_json(camera: KnownCamera) -> dict[str, Json]:
    """One entry as its file has it, and its make: what ``catalogue --json`` prints."""
    record: dict[str, Json] = {"make": camera.make, "title": camera.title, "models": list(camera.models)}
    for name in ("other_makes", "sub_camera", "bands", "lens"):
        _put(record, name, getattr(camera, name))
    for name, source in camera.sources:
        value = getattr(camera, name)
        record[name] = {"value": list(value) if isinstance(value, tuple) else value, "source": source}
    for name in ("conflicts", "notes"):
        _put(record, name, getattr(camera, name))
    return record


@cache
def _shipped() -> Catalogue:
    makers = {item.name: item for item in files(__package__).iterdir() if item.name.endswith(".yaml")}
    documents = (load_yaml(makers[name].read_bytes(), source=name) for name in sorted(makers))
    return Catalogue(camera for maker in documents for camera in _cameras(cast("_Maker", maker)))


def _read(path: Path) -> Iterator[KnownCamera]:
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_FILE + 1)
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", source=str(path)) from None
    if len(data) > LARGEST_FILE:
        raise ParseError(f"is larger than {LARGEST_FILE >> 20} MiB, expected a catalogue", source=str(path))
    maker = load_yaml(data, source=path.name)
    require(maker, SCHEMA, source=path.name, locate=partial(line_of, data))
    return _cameras(cast("_Maker", maker))


def _cameras(maker: _Maker) -> Iterator[KnownCamera]:
    """The entries of a file that holds to the schema."""
    for entry in maker["cameras"]:
        yield _camera(maker["make"], entry)


def _camera(make: str, entry: _Camera) -> KnownCamera:
    return KnownCamera(
        make=make,
        models=tuple(entry["models"]),
        other_makes=tuple(entry.get("other_makes", ())),
        title=entry["title"],
        sub_camera=entry.get("sub_camera"),
        bands=tuple(entry.get("bands", ())),
        lens=entry.get("lens"),
        native_size=_pair(entry["native_size"]["value"]) if "native_size" in entry else None,
        pitch_um=_number(entry.get("pitch_um")),
        sensor_width_mm=_number(entry.get("sensor_width_mm")),
        focal_mm=_number(entry.get("focal_mm")),
        zoom_mm=_pair(entry["zoom_mm"]["value"]) if "zoom_mm" in entry else None,
        focal_35mm=_number(entry.get("focal_35mm")),
        projection=Projection(entry["projection"]["value"] if "projection" in entry else "perspective"),
        fx_over_w=_number(entry.get("fx_over_w")),
        spread=_number(entry.get("spread")),
        conflicts=tuple(entry.get("conflicts", ())),
        notes=tuple(entry.get("notes", ())),
        sources=tuple((name, claim["source"]) for name, claim in entry.items() if isinstance(claim, dict)),
        exif_focal_trusted=entry["exif_focal_trusted"]["value"] if "exif_focal_trusted" in entry else True,
    )


def _number(claim: _Number | None) -> float | None:
    return float(claim["value"]) if claim is not None else None


def _pair(values: Sequence[T]) -> tuple[T, T]:
    first, second = values
    return first, second


def _put(record: dict[str, Json], name: str, value: str | tuple[str, ...] | None) -> None:
    if value:
        record[name] = value if isinstance(value, str) else list(value)
