"""Several registries asked in their order, below them the catalogue: the first that answers, and what others say.

A lower layer never takes the place of a higher one that answers, whatever its K. Where it has a K outside the
tolerance of both, that is mentioned.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from datetime import date, datetime
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Final, Protocol

from msgspec import Struct

from calibrary.calibration import CameraKey
from calibrary.catalogue import shipped_with
from calibrary.errors import RegistryError
from calibrary.known_camera import KnownCamera
from calibrary.records import Record, replace
from calibrary.registry.contradictions import USUAL
from calibrary.registry.entry import Entry, Status
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.paths import match_key
from calibrary.registry.published.address import is_address, normalised
from calibrary.registry.reader import open_snapshot
from calibrary.registry.resolution import RejectedEntry, Resolution, resolve
from calibrary.registry.snapshot import Snapshot

if TYPE_CHECKING:
    from calibrary.registry.published.read import Published

__all__ = [
    "CATALOGUE",
    "Asked",
    "AskedLayer",
    "Layer",
    "LayerKind",
    "Layers",
    "Place",
    "distinctive_words",
    "layer_of_snapshot",
    "open_layers",
]

CATALOGUE: Final = "catalogue"
Place = str | Path
"""A folder, or the address of a published registry."""


class LayerKind(StrEnum):
    """What a layer is."""

    GIT = "git"
    FOLDER = "folder"
    PUBLISHED = "published"
    CATALOGUE = "catalogue"


class Asked(Protocol):
    """What answers for cameras."""

    def resolve(self, key: CameraKey, *, on: date | None = None) -> Resolution | None:
        """The entry that is used for a camera."""

    def near(self, key: CameraKey, *, on: date | None = None) -> tuple[RejectedEntry, ...]:
        """The entries of its make and model that do not fit it, and why not."""

    def is_dated(self, key: CameraKey) -> bool:
        """Whether what answers may depend on the day."""


class AskedLayer(Record):
    """A layer as reports name it.

    Attributes:
        name: folder, address, or "catalogue".
        kind: what it is.
        commit: that was read; None for a plain folder and the catalogue.
        read: when a published registry was last read from its server.
    """

    name: str
    kind: LayerKind
    commit: ObjectId | None
    read: datetime | None


class Layer(Struct, kw_only=True, eq=False):
    """One registry of several.

    Attributes:
        name: folder, address, or "catalogue".
        kind: what it is.
        snapshot: its entries, where it is on this machine.
        opening: gives what answers for a camera.
        published: it, once it was asked, where it is read over HTTP.
    """

    name: str
    kind: LayerKind
    opening: Callable[[CameraKey], Asked]
    snapshot: Snapshot | None = None
    published: Published | None = None
    _error: RegistryError | None = None

    def index_for(self, key: CameraKey) -> Asked:
        """What answers for a camera.

        Raises:
            RegistryError: it cannot be read; once that is found out, it is not tried again.
        """
        if self._error is not None:
            raise self._error
        try:
            return self.opening(key)
        except RegistryError as error:
            self._error = error
            raise

    @property
    def title(self) -> str:
        """What it is called where it is handed on: the whole path of a folder tells about a disk."""
        return Path(self.name).resolve().name if self.snapshot is not None else self.name

    @property
    def commit(self) -> str | None:
        """That was read."""
        if self.published is not None:
            return self.published.commit
        return self.snapshot.commit if self.snapshot is not None else None

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a person should know of it."""
        return self.published.warnings if self.published is not None else ()

    def report(self) -> AskedLayer:
        """As reports name it."""
        read = self.published.read if self.published is not None else None
        return AskedLayer(name=self.name, kind=self.kind, commit=self.commit, read=read)


class Layers(Struct, frozen=True, eq=False):
    """Registries in the order in which they are asked.

    Attributes:
        layers: the first answers before the others.
    """

    layers: tuple[Layer, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a person should know of those that were asked."""
        return tuple(warning for layer in self.layers for warning in layer.warnings)

    def resolve(self, key: CameraKey, *, on: date | None = None) -> Resolution | None:
        """The entry of the first layer that has one, with what the layers below say against it.

        The catalogue answers for cameras that no registry has any entry of: where one has a draft, or has retired what
        it had, a person decides.

        Raises:
            RegistryError: a layer above it cannot be read, or has several entries that fit equally well.
        """
        for at, layer in enumerate(self.layers):
            if layer.kind is LayerKind.CATALOGUE and self.near(key, on=on):
                continue
            found = layer.index_for(key).resolve(key, on=on)
            if found is not None:
                differing = tuple(
                    text for below in self.layers[at + 1 :] if (text := _against(found, below, key, on))
                )
                return replace(self._named(found, layer), disagreements=differing)
        return None

    def near(self, key: CameraKey, *, on: date | None = None) -> tuple[RejectedEntry, ...]:
        """The entries that do not fit a camera, of all layers.

        Raises:
            RegistryError: a layer cannot be read.
        """
        return tuple(one for layer in self.layers for one in layer.index_for(key).near(key, on=on))

    def is_dated(self, key: CameraKey) -> bool:
        """Whether what answers for a camera may depend on the day.

        Raises:
            RegistryError: a layer above the one that answers cannot be read.
        """
        for layer in self.layers:
            index = layer.index_for(key)
            if index.is_dated(key):
                return True
            if index.resolve(key) is not None:
                return False
        return False

    def layer_of(self, resolution: Resolution | None) -> Layer:
        """The layer that answered; the first one where none did."""
        named = (layer for layer in self.layers if resolution is not None and layer.name == resolution.layer)
        return next(named, self.layers[0])

    def _named(self, found: Resolution, layer: Layer) -> Resolution:
        """An answer that says which layer it is of, unless there is only one folder that it can be of."""
        is_alone = len([one for one in self.layers if one.kind is not LayerKind.CATALOGUE]) == 1
        if is_alone and layer.kind in {LayerKind.GIT, LayerKind.FOLDER}:
            return replace(found, layer=layer.name)
        calibration = found.calibration
        made = calibration.provenance
        if layer.kind is not LayerKind.CATALOGUE:
            made = replace(made, source=f"{layer.title} {found.path}")
        return replace(
            found,
            layer=layer.name,
            why=f"{found.why}; from {_whence(layer)}",
            calibration=replace(calibration, provenance=made),
        )


def _whence(layer: Layer) -> str:
    """What an answer is from, in words."""
    if layer.kind is LayerKind.CATALOGUE:
        return "the catalogue that ships with calibrary"
    at = f" at commit {layer.commit[:12]}" if layer.commit is not None else ""
    if layer.kind is LayerKind.FOLDER:
        return f"the folder {layer.title}"
    return f"the {'published ' if layer.kind is LayerKind.PUBLISHED else ''}registry {layer.title}{at}"


def open_layers(
    places: Sequence[Place], *, at: str | None = None, catalogue: bool = False, many: bool = False
) -> Layers:
    """Registries in the order in which they are asked; a published one is first read when it is asked.

    Args:
        places: folders and addresses.
        at: the revision of the only one, which is in git.
        catalogue: ask the shipped catalogue after all of them.
        many: list folders once, for callers that ask for many cameras.

    Raises:
        RegistryError: a folder is not a registry, an address is not one, or a revision of several is asked for.
    """
    if at is not None and (len(places) != 1 or is_address(str(places[0]))):
        raise RegistryError(f"{at}: a revision is of one registry in git; name its folder alone")
    layers = [
        _published(str(place))
        if is_address(str(place))
        else layer_of_snapshot(open_snapshot(Path(place), at), many=many)
        for place in places
    ]
    return Layers((*layers, *([_catalogue()] if catalogue else ())))


def layer_of_snapshot(snapshot: Snapshot, *, many: bool = False) -> Layer:
    """A registry on this machine as a layer."""
    index = snapshot.index() if many else None
    return Layer(
        name=str(snapshot.place),
        kind=LayerKind.FOLDER if snapshot.repo is None else LayerKind.GIT,
        snapshot=snapshot,
        opening=lambda key: index or snapshot.index_for(key),
    )


def _published(address: str) -> Layer:
    def opening(key: CameraKey) -> Asked:
        from calibrary.registry.published.read import Published  # noqa: PLC0415  HTTP, which a folder does not need

        if layer.published is None:
            layer.published = Published(layer.name)
        return layer.published.index_for(key)

    layer = Layer(name=normalised(address), kind=LayerKind.PUBLISHED, opening=opening)
    return layer


def _catalogue() -> Layer:
    return Layer(
        name=CATALOGUE, kind=LayerKind.CATALOGUE, opening=lambda key: _OfCatalogue(_catalogue_rows(key))
    )


def _catalogue_rows(key: CameraKey) -> Mapping[str, Entry]:
    """What the catalogue's cameras of a make and model would be as entries, by path."""
    from calibrary.jobs.exchange.catalogue_entries import catalogue_entries  # noqa: PLC0415  asked last, if at all

    name = (match_key(key.make or ""), match_key(key.model or ""))
    rows = [camera for camera in shipped_with(distinctive_words(name[1])) if name in _names(camera)]
    return {f"{CATALOGUE}/{entry.id}": entry for entry in catalogue_entries(rows)[0]}


def distinctive_words(model: str) -> list[str]:
    """What a maker's file contains if it has a camera of that Model, as match_key has it; x may be × there."""
    return re.findall("[0-9a-wyz]+", model)


def _names(camera: KnownCamera) -> set[tuple[str, str]]:
    makes = (camera.make, *camera.other_makes)
    return {(match_key(make), match_key(model)) for make in makes for model in camera.models}


class _OfCatalogue(Struct, frozen=True):
    """The catalogue's K's of one make and model; none where several cameras may be meant."""

    entries: Mapping[str, Entry]

    def resolve(self, key: CameraKey, *, on: date | None = None) -> Resolution | None:
        try:
            found = resolve(self.entries, key, on=on, statuses=frozenset({Status.DRAFT}))
        except RegistryError:
            return None
        if found is None:
            return None
        made = found.entry.calibration.provenance
        calibration = replace(
            found.calibration,
            provenance=replace(
                found.calibration.provenance, kind=made.kind, source=made.source, tag=made.tag
            ),
        )
        why = f"{found.why}; no registry has an entry of this camera: K is the model's nominal one, a start value"
        return replace(found, calibration=calibration, why=why, near=())

    def near(self, key: CameraKey, *, on: date | None = None) -> tuple[RejectedEntry, ...]:  # noqa: ARG002  as Asked
        return ()

    def is_dated(self, key: CameraKey) -> bool:  # noqa: ARG002  as Asked
        return False


def _against(found: Resolution, below: Layer, key: CameraKey, on: date | None) -> str | None:
    """What a lower layer says against an answer; None where it has none, or one that agrees."""
    try:
        other = below.index_for(key).resolve(key, on=on)
    except RegistryError as error:
        return f"{below.title} could not be compared: {error}"
    if other is None:
        return None
    own, its = found.calibration.intrinsics, other.calibration.intrinsics
    off = max(its.fx / own.fx - 1.0, its.fy / own.fy - 1.0, key=abs)
    tolerance = max(one.entry.tolerance or USUAL for one in (found, other))
    if abs(off) <= tolerance:
        return None
    return (
        f"{below.title} has another K: fx = {its.fx:.1f} px in {other.path}, {off:+.1%} from the one used; "
        f"{found.path} is used because its registry comes first"
    )
