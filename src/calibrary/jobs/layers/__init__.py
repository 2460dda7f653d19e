"""Layers: several registries in order of precedence, and the catalogue below them.

The first layer with an entry for a camera is used, whatever the K of lower layers. A lower layer with a K
outside the tolerance of both is reported.

>>> from calibrary.jobs.layers import open_layers
>>> layers = open_layers(["fleet"], catalogue=True)
>>> layers.resolve(calibrary.CameraKey(make="DJI", model="FC6310R", image_size=(5472, 3648))).entry.id
'dji/fc6310r/5472x3648'
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import date, datetime
from enum import StrEnum
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Final, Protocol

from msgspec import Struct

from calibrary.calibration import CameraKey
from calibrary.catalogue import shipped_with
from calibrary.errors import RegistryError
from calibrary.known_camera import KnownCamera, match_key
from calibrary.records import Record, replace
from calibrary.registry.entry import USUAL_TOLERANCE, Entry, Status
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.places import is_published
from calibrary.registry.published.address import normalised
from calibrary.registry.registry import open_snapshot
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
    """Kind of a layer."""

    GIT = "git"
    FOLDER = "folder"
    PUBLISHED = "published"
    CATALOGUE = "catalogue"


class Asked(Protocol):
    """Interface of anything that resolves cameras to entries."""

    def resolve(self, key: CameraKey, *, on: date | None = None) -> Resolution | None:
        """The entry that is used for a camera."""

    def near(self, key: CameraKey, *, on: date | None = None) -> tuple[RejectedEntry, ...]:
        """The entries of its make and model that do not fit it, with the reason."""

    def proposed_for(self, key: CameraKey, *, on: date | None = None) -> Resolution | None:
        """The proposal that would be used for a camera if it were approved; None for none, or for several."""

    def is_dated(self, key: CameraKey) -> bool:
        """Whether the result may depend on the date."""


class AskedLayer(Record):
    """A layer in reports.

    Attributes:
        name: folder, address, or "catalogue".
        kind: of the layer.
        commit: the commit that was read; None for a plain folder and the catalogue.
        read: time at which a published registry was last read from its server.
    """

    name: str
    kind: LayerKind
    commit: ObjectId | None
    read: datetime | None


@dataclass(kw_only=True, eq=False)
class Layer:
    """One registry of several.

    Attributes:
        name: folder, address, or "catalogue".
        kind: of the layer.
        snapshot: its entries, if it is on this machine.
        opening: returns the object that resolves a camera.
        published: the published registry, if it is read over HTTP and has been queried.
    """

    name: str
    kind: LayerKind
    opening: Callable[[CameraKey], Asked]
    snapshot: Snapshot | None = None
    published: Published | None = None
    _error: RegistryError | None = None

    def index_for(self, key: CameraKey) -> Asked:
        """The object that resolves a camera.

        Raises:
            RegistryError: the layer cannot be read; after a failure it is not tried again.
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
        """Name for output that is passed on, without the path of a folder, which would reveal local details."""
        return Path(self.name).resolve().name if self.snapshot is not None else self.name

    @property
    def commit(self) -> str | None:
        """The commit that was read."""
        if self.published is not None:
            return self.published.commit
        return self.snapshot.commit if self.snapshot is not None else None

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings on this layer."""
        return self.published.warnings if self.published is not None else ()

    def report(self) -> AskedLayer:
        """The layer as a record for reports."""
        read = self.published.read if self.published is not None else None
        return AskedLayer(name=self.name, kind=self.kind, commit=self.commit, read=read)


class Layers(Struct, frozen=True, eq=False):
    """Registries in order of precedence.

    Attributes:
        layers: the layers, first has precedence.
    """

    layers: tuple[Layer, ...]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings on the layers that were queried."""
        return tuple(warning for layer in self.layers for warning in layer.warnings)

    def resolve(self, key: CameraKey, *, on: date | None = None) -> Resolution | None:
        """The entry of the first layer that has one, with contradictions from lower layers.

        The catalogue is used only for cameras without any entry in a registry: if there is a draft or a retired
        entry, the user must decide.

        Raises:
            RegistryError: a higher layer cannot be read, or has several entries that fit equally well.
        """
        for at, layer in enumerate(self.layers):
            if layer.kind is LayerKind.CATALOGUE and self.near(key, on=on):
                continue
            found = layer.index_for(key).resolve(key, on=on)
            if found is not None:
                below = [_against(found, lower, key, on) for lower in self.layers[at + 1 :]]
                return replace(
                    self._with_layer_name(found, layer, key),
                    disagreements=tuple(text for text in below if text),
                )
        return None

    def near(self, key: CameraKey, *, on: date | None = None) -> tuple[RejectedEntry, ...]:
        """The entries of all layers that do not fit a camera, with the reason.

        Raises:
            RegistryError: a layer cannot be read.
        """
        return tuple(one for layer in self.layers for one in layer.index_for(key).near(key, on=on))

    def proposed_for(self, key: CameraKey, *, on: date | None = None) -> Resolution | None:
        """The proposal that would be used if it were approved, of the first registry on this machine that has one."""
        local = (layer for layer in self.layers if layer.snapshot is not None)
        found = (layer.index_for(key).proposed_for(key, on=on) for layer in local)
        return next((one for one in found if one is not None), None)

    def is_dated(self, key: CameraKey) -> bool:
        """Whether the result for a camera may depend on the date.

        Raises:
            RegistryError: a layer above the one with the result cannot be read.
        """
        for layer in self.layers:
            index = layer.index_for(key)
            if index.is_dated(key):
                return True
            if index.resolve(key) is not None:
                return False
        return False

    def layer_of(self, resolution: Resolution | None) -> Layer:
        """The layer of a resolution; the first layer for None."""
        named = (layer for layer in self.layers if resolution is not None and layer.name == resolution.layer)
        return next(named, self.layers[0])

    def _with_layer_name(self, found: Resolution, layer: Layer, key: CameraKey) -> Resolution:
        """The resolution with the name of its layer, unless there is only a single folder."""
        is_alone = len([one for one in self.layers if one.kind is not LayerKind.CATALOGUE]) == 1
        if is_alone and layer.kind in {LayerKind.GIT, LayerKind.FOLDER}:
            return replace(found, layer=layer.name)
        calibration = found.calibration
        made = calibration.provenance
        why = found.why
        if layer.kind is not LayerKind.CATALOGUE:
            made = replace(made, source=f"{layer.title} {found.path}")
        elif key.serial is None and any(one.kind is LayerKind.PUBLISHED for one in self.layers):
            why += "; a published registry finds the entry of a unit by its serial number alone: --serial"
        return replace(
            found,
            layer=layer.name,
            why=f"{why}; from {_whence(layer)}",
            calibration=replace(calibration, provenance=made),
        )


def _whence(layer: Layer) -> str:
    """Origin of a resolution in words."""
    if layer.kind is LayerKind.CATALOGUE:
        return "the catalogue that ships with calibrary"
    at = f" at commit {layer.commit[:12]}" if layer.commit is not None else ""
    if layer.kind is LayerKind.FOLDER:
        return f"the folder {layer.title}"
    return f"the {'published ' if layer.kind is LayerKind.PUBLISHED else ''}registry {layer.title}{at}"


def open_layers(
    places: Sequence[Place], *, at: str | None = None, catalogue: bool = False, many: bool = False
) -> Layers:
    """Open registries in order of precedence; a published one is read when it is first queried.

    Args:
        places: folders and addresses.
        at: revision, only for a single registry in git.
        catalogue: whether to add the shipped catalogue as the last layer.
        many: whether to list folders once, for callers that resolve many cameras.

    Raises:
        RegistryError: a folder or address is not a registry, or ``at`` is given with several registries.
    """
    if at is not None and (len(places) != 1 or is_published(str(places[0]))):
        raise RegistryError(f"{at}: a revision is of one registry in git; name its folder alone")
    layers = [
        _published(str(place))
        if is_published(str(place))
        else layer_of_snapshot(open_snapshot(Path(place), at), many=many)
        for place in places
    ]
    if catalogue:
        layers.append(Layer(name=CATALOGUE, kind=LayerKind.CATALOGUE, opening=_of_catalogue))
    return Layers(tuple(layers))


def layer_of_snapshot(snapshot: Snapshot, *, many: bool = False) -> Layer:
    """Make a layer from a registry on this machine."""
    index = snapshot.index() if many else None
    return Layer(
        name=str(snapshot.place),
        kind=LayerKind.FOLDER if snapshot.repo is None else LayerKind.GIT,
        snapshot=snapshot,
        opening=lambda key: index or snapshot.index_for(key),
    )


def _published(address: str) -> Layer:
    def opening(key: CameraKey) -> Asked:
        if layer.published is None:
            from calibrary.registry.published.read import Published

            layer.published = Published(layer.name)
        return layer.published.index_for(key)

    layer = Layer(name=normalised(address), kind=LayerKind.PUBLISHED, opening=opening)
    return layer


def _of_catalogue(key: CameraKey) -> _OfCatalogue:
    """The catalogue's cameras of a make and model as entries, by path."""
    return _named_in_catalogue((match_key(key.make or ""), match_key(key.model or "")))


@lru_cache(maxsize=256)
def _named_in_catalogue(name: tuple[str, str]) -> _OfCatalogue:
    from calibrary.jobs.layers.catalogue_entries import catalogue_entries

    rows = [camera for camera in shipped_with(distinctive_words(name[1])) if name in _names(camera)]
    return _OfCatalogue({f"{CATALOGUE}/{entry.id}": entry for entry in catalogue_entries(rows)[0]})


def distinctive_words(model: str) -> list[str]:
    """Words that a maker's file contains if it has a camera with this Model, as for match_key; x may be × there."""
    return re.findall("[0-9a-wyz]+", model)


def _names(camera: KnownCamera) -> set[tuple[str, str]]:
    makes = (camera.make, *camera.other_makes)
    return {(match_key(make), match_key(model)) for make in makes for model in camera.models}


class _OfCatalogue(Struct, frozen=True):
    """Resolves cameras of one make and model in the catalogue; gives none if several cameras are possible."""

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

    def proposed_for(self, key: CameraKey, *, on: date | None = None) -> None:
        """The catalogue proposes nothing."""

    def is_dated(self, key: CameraKey) -> bool:  # noqa: ARG002  as Asked
        return False


def _against(found: Resolution, below: Layer, key: CameraKey, on: date | None) -> str | None:
    """Contradiction of a lower layer to a resolution, in words; None if it has no entry or agrees."""
    try:
        other = below.index_for(key).resolve(key, on=on)
    except RegistryError as error:
        return f"{below.title} could not be compared: {error}"
    if other is None:
        return None
    own, its = found.calibration.intrinsics, other.calibration.intrinsics
    off = max(its.fx / own.fx - 1.0, its.fy / own.fy - 1.0, key=abs)
    tolerance = max(one.entry.tolerance or USUAL_TOLERANCE for one in (found, other))
    if abs(off) <= tolerance:
        return None
    return (
        f"{below.title} has another K: fx = {its.fx:.1f} px in {other.path}, {off:+.1%} from the one used; "
        f"{found.path} is used because its registry comes first"
    )
