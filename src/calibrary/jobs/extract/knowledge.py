"""What is known of a camera before its images are heard: the fleet's registry, then the catalogue."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path

from calibrary.calibration import Calibration
from calibrary.catalogue import Catalogue, load_catalogue
from calibrary.errors import RegistryError
from calibrary.evidence.metadata import ImageMetadata
from calibrary.jobs.exchange.identity import identified
from calibrary.jobs.exchange.layers import Asked, Layers, Place, open_layers
from calibrary.jobs.images.accumulator import ByDay, Names
from calibrary.known_camera import KnownCamera
from calibrary.records import replace
from calibrary.registry.locking import locked
from calibrary.registry.paths import in_use_path
from calibrary.registry.published.address import is_address
from calibrary.registry.reader import open_snapshot, uncommitted
from calibrary.registry.resolution import RejectedEntry, Resolution
from calibrary.registry.snapshot import Snapshot

__all__ = ["Knowledge", "Known"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Known:
    """What is known of one camera.

    Attributes:
        camera: its row of the catalogue, None for an unknown camera.
        siblings: the other cameras that share its Model.
        why: how the row was told, or why there is none.
        resolution: the registry's entry, its K at the image's size.
        near: where there is none, the registry's entries of this model and why not they.
    """

    camera: KnownCamera | None = None
    siblings: tuple[KnownCamera, ...] = ()
    why: str | None = None
    resolution: Resolution | None = None
    near: tuple[RejectedEntry, ...] = ()

    @property
    def calibration(self) -> Calibration | None:
        """The registry's K at the image's size, where it has one."""
        return self.resolution.calibration if self.resolution is not None else None

    @property
    def title(self) -> str | None:
        """What people call the camera."""
        return self.camera.title if self.camera is not None else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Knowledge:
    """The registry, where one is given, and the catalogue.

    Attributes:
        catalogue: of known cameras.
        registry: the fleet's own.
        on: the day that entries must be valid on for images that state none; None asks nothing of theirs.
        warnings: what a person should know of the registry before resting on it.
    """

    catalogue: Catalogue
    registry: Asked | None = None
    on: date | None = None
    warnings: tuple[str, ...] = ()

    @classmethod
    def load(cls, registry: Place | Sequence[Place] | None, lock: Path | None = None) -> Knowledge:
        """Read the catalogue and list the registry.

        Args:
            registry: a registry in git, bare or checked out, of which what is committed is used; a plain folder of
                files; the address of a published one; or several of them, of which the first that answers is used.
            lock: the file that pins entries of it; no others are used then.

        Raises:
            RegistryError: there is no registry at the path, or what the lock pins cannot be had as it was.
            InputError: the lock cannot be read.
        """
        places = (
            () if registry is None else (registry,) if isinstance(registry, str | Path) else tuple(registry)
        )
        if not places:
            return cls(catalogue=load_catalogue())
        catalogue, today = load_catalogue(), date.today()
        if lock is not None:
            if len(places) > 1 or is_address(str(places[0])):
                raise RegistryError(
                    f"{lock}: a lock is of one registry on this machine; name its folder alone"
                )
            pinned = locked(open_snapshot(Path(places[0])), lock)
            return cls(catalogue=catalogue, registry=pinned.index, on=today, warnings=pinned.warnings)
        layers = open_layers(places, many=True)
        return cls(catalogue=catalogue, registry=layers, on=today, warnings=_warnings(layers))

    @property
    def warnings_of_layers(self) -> tuple[str, ...]:
        """What became known of registries by asking them: that one cannot be reached, and how old its copy is."""
        return self.registry.warnings if isinstance(self.registry, Layers) else ()

    @property
    def has_registry(self) -> bool:
        """Whether a registry was given."""
        return self.registry is not None

    def by_day(self, metadata: ImageMetadata, days: ByDay) -> Iterator[tuple[Known, Names]]:
        """What is known of the camera that took some images, and which of them it holds for.

        It is one thing for all of them, but where an entry is valid for some days only: the image's own counts.

        Args:
            metadata: of all of them.
            days: the images by the day they were taken on.

        Raises:
            RegistryError: as of :meth:`of`.
        """
        if self.registry is None or not self.registry.is_dated(identified(metadata, self.catalogue).key):
            yield self.of(metadata), Names.joined([*days.values()])
            return
        found: dict[tuple[str | None, str, str | None] | None, tuple[Known, list[Names]]] = {}
        for day, own in days.items():
            known = replace(self, on=day or self.on).of(metadata)
            entry = known.resolution
            answer = (entry.layer, entry.path, entry.revision) if entry is not None else None
            found.setdefault(answer, (known, []))[1].append(own)
        yield from ((known, Names.joined(parts)) for known, parts in found.values())

    def of(self, metadata: ImageMetadata) -> Known:
        """What is known of the camera that took an image on the day that is asked for.

        Raises:
            RegistryError: two of the registry's entries fit the camera equally well, or one that may fit cannot
                be read.
        """
        told = identified(metadata, self.catalogue)
        known = Known(camera=told.camera, siblings=told.siblings, why=told.why)
        if self.registry is None:
            return known
        key = told.key
        resolution = self.registry.resolve(key, on=self.on)
        near = self.registry.near(key, on=self.on) if resolution is None else ()
        return replace(known, resolution=resolution, near=near)


def _warnings(layers: Layers) -> tuple[str, ...]:
    """What is known of registries before they are asked."""
    git = [layer.snapshot for layer in layers.layers if layer.snapshot is not None]
    return tuple(warning for snapshot in git for warning in _not_used(snapshot))


def _not_used(snapshot: Snapshot) -> tuple[str, ...]:
    """A person who edits a file and sees nothing come of it should not have to guess why."""
    waiting = snapshot.waiting(
        in_use_path(path) for path in snapshot.proposed if in_use_path(path) in snapshot.paths
    )
    pending = () if waiting is None else (waiting,)
    edited = uncommitted(snapshot.repo) if snapshot.repo is not None else ()
    if not edited:
        return pending
    more = f" and {len(edited) - 1} more" if len(edited) > 1 else ""
    return (
        f"the registry is used as committed; {edited[0]}{more} differs in its work tree and is not committed "
        "('calibrary registry add FILE' does that)",
        *pending,
    )
