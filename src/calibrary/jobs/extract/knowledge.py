"""What is known of a camera before its images are heard: the fleet's registry, then the catalogue."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING

from msgspec import Struct

from calibrary.calibration import Calibration
from calibrary.catalogue import Catalogue, load_catalogue
from calibrary.evidence.metadata import ImageMetadata
from calibrary.jobs.exchange.identity import identified
from calibrary.jobs.images.accumulator import ByDay, Names
from calibrary.known_camera import KnownCamera
from calibrary.records import replace

if TYPE_CHECKING:
    from calibrary.jobs.exchange.layers import Asked, Place
    from calibrary.registry.resolution import RejectedEntry, Resolution

__all__ = ["Knowledge", "Known"]


class Known(Struct, frozen=True, kw_only=True):
    """What is known of one camera.

    Attributes:
        camera: its row of the catalogue, None for an unknown camera.
        siblings: the other cameras that share its Model.
        why: how the row was found, or why there is none.
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


class Knowledge(Struct, frozen=True, kw_only=True):
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
        from calibrary.jobs.extract.registries import opened  # noqa: PLC0415  half of what a run would load

        found, warnings = opened(places, lock)
        return cls(catalogue=load_catalogue(), registry=found, on=date.today(), warnings=warnings)

    @property
    def warnings_of_layers(self) -> tuple[str, ...]:
        """What became known of registries by asking them: that one cannot be reached, and how old its copy is."""
        if self.registry is None:
            return ()
        from calibrary.jobs.extract.registries import warnings_of  # noqa: PLC0415  as above

        return warnings_of(self.registry)

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
        identity = identified(metadata, self.catalogue)
        known = Known(camera=identity.camera, siblings=identity.siblings, why=identity.why)
        if self.registry is None:
            return known
        key = identity.key
        resolution = self.registry.resolve(key, on=self.on)
        near = self.registry.near(key, on=self.on) if resolution is None else ()
        return replace(known, resolution=resolution, near=near)
