"""What is known about a camera before its images are evaluated: from the fleet's registry and the catalogue."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING

from calibrary.calibration import Calibration
from calibrary.catalogue import Catalogue, identified, load_catalogue
from calibrary.errors import InputError, RegistryError
from calibrary.evidence.metadata import ImageMetadata
from calibrary.jobs.images.accumulator import ByDay, Names
from calibrary.jobs.images.listing import Listing
from calibrary.jobs.images.reading import Question, here, read_images
from calibrary.known_camera import KnownCamera
from calibrary.records import replace

if TYPE_CHECKING:
    from calibrary.jobs.layers import Asked, Place
    from calibrary.registry.resolution import RejectedEntry, Resolution
    from calibrary.registry.snapshot import Snapshot


@dataclass(frozen=True, kw_only=True)
class Known:
    """What is known about one camera.

    Attributes:
        camera: its row of the catalogue, None for an unknown camera.
        siblings: the other cameras with the same EXIF Model.
        why: how the row was found, or why there is none.
        resolution: the registry entry, with K at the image's size.
        proposed: the measured K that waits for approval, at the image's size.
        near: if there is no entry, those of this model, with the reason why they do not apply.
    """

    camera: KnownCamera | None = None
    siblings: tuple[KnownCamera, ...] = ()
    why: str | None = None
    resolution: Resolution | None = None
    proposed: Resolution | None = None
    near: tuple[RejectedEntry, ...] = ()

    @property
    def calibration(self) -> Calibration | None:
        """The registry's K at the image's size, or None."""
        return self.resolution.calibration if self.resolution is not None else None

    @property
    def title(self) -> str | None:
        """Common name of the camera."""
        return self.camera.title if self.camera is not None else None


@dataclass(frozen=True, kw_only=True)
class Knowledge:
    """The catalogue, and the registry if one is given.

    Attributes:
        catalogue: of known cameras.
        registry: the fleet's registry.
        on: date on which entries must be valid, for images without a date; None to ignore validity for these.
        warnings: on the registry.
    """

    catalogue: Catalogue
    registry: Asked | None = None
    on: date | None = None
    warnings: tuple[str, ...] = ()

    @classmethod
    def load(cls, registry: Place | Sequence[Place] | None, lock: Path | None = None) -> Knowledge:
        """Read the catalogue and list the registry.

        Args:
            registry: a registry in git (bare or checked out; the committed state is used), a plain folder of
                files, the address of a published registry, or several of these in order of precedence.
            lock: file that pins entries; no others are used then.

        Raises:
            RegistryError: there is no registry at the path, or the pinned entries are not available unchanged.
            InputError: the lock cannot be read.
        """
        places = (
            () if registry is None else (registry,) if isinstance(registry, str | Path) else tuple(registry)
        )
        if not places:
            return cls(catalogue=load_catalogue())
        # What opens a registry is half of the load time of a run, and many runs have none.
        from calibrary.jobs.layers import open_layers  # noqa: PLC0415  the reason above
        from calibrary.registry.locking import locked  # noqa: PLC0415  the reason above
        from calibrary.registry.places import is_published  # noqa: PLC0415  the reason above
        from calibrary.registry.registry import open_snapshot  # noqa: PLC0415  the reason above

        found: Asked
        if lock is None:
            found = layers = open_layers(places, many=True)
            snapshots = [layer.snapshot for layer in layers.layers if layer.snapshot is not None]
            warnings = tuple(warning for snapshot in snapshots for warning in _uncommitted(snapshot))
        elif len(places) > 1 or is_published(str(places[0])):
            raise RegistryError(f"{lock}: a lock is of one registry on this machine; name its folder alone")
        else:
            pinned = locked(open_snapshot(Path(places[0])), lock)
            found, warnings = pinned.index, pinned.warnings
        return cls(catalogue=load_catalogue(), registry=found, on=date.today(), warnings=warnings)

    def warnings_on(self, used: Collection[Resolution]) -> Iterator[str]:
        """Warnings on the registries that were asked, and on what waits in place of the entries that are used."""
        from calibrary.jobs.layers import Layers  # noqa: PLC0415  loaded already

        if not isinstance(self.registry, Layers):
            return
        yield from self.registry.warnings
        for layer in self.registry.layers:
            paths = dict.fromkeys(one.path for one in used if one.layer == layer.name)
            if layer.snapshot is not None and (waiting := layer.snapshot.waiting(paths)) is not None:
                yield waiting

    @property
    def has_registry(self) -> bool:
        """Whether a registry was given."""
        return self.registry is not None

    def by_day(self, metadata: ImageMetadata, days: ByDay) -> Iterator[tuple[Known, Names]]:
        """Yield what is known about the camera of some images, with the images that it applies to.

        There are several results only if an entry is valid for some of the dates.

        Args:
            metadata: of all images.
            days: the images by date.

        Raises:
            RegistryError: as for :meth:`of`.
        """
        if self.registry is None or not self.registry.is_dated(identified(metadata, self.catalogue).key):
            yield self.of(metadata), Names.joined([*days.values()])
            return
        found: dict[tuple[str | None, str, str | None] | None, tuple[Known, list[Names]]] = {}
        for day, own in days.items():
            known = replace(self, on=day or self.on).of(metadata)
            entry = known.resolution
            answer = (entry.layer, entry.path, str(entry.entry.validity)) if entry is not None else None
            found.setdefault(answer, (known, []))[1].append(own)
        yield from ((known, Names.joined(parts)) for known, parts in found.values())

    def of(self, metadata: ImageMetadata) -> Known:
        """What is known about the camera of an image, for the date ``on``.

        Raises:
            RegistryError: two registry entries fit the camera equally well, or one that may fit cannot be read.
        """
        identity = identified(metadata, self.catalogue)
        known = Known(camera=identity.camera, siblings=identity.siblings, why=identity.why)
        if self.registry is None:
            return known
        key = identity.key
        resolution = self.registry.resolve(key, on=self.on)
        near = self.registry.near(key, on=self.on) if resolution is None else ()
        proposed = self.registry.proposed_for(key, on=self.on)
        if proposed is not None and not proposed.calibration.grade.is_measured:
            proposed = None
        return replace(known, resolution=resolution, proposed=proposed, near=near)


def _uncommitted(snapshot: Snapshot) -> Iterator[str]:
    """A warning on edits that are not committed, and so not used."""
    from calibrary.registry.registry import uncommitted  # noqa: PLC0415  loaded already

    edited = uncommitted(snapshot.repo) if snapshot.repo is not None else ()
    if edited:
        more = f" and {len(edited) - 1} more" if len(edited) > 1 else ""
        yield (
            f"the registry is used as committed; {edited[0]}{more} differs in its work tree and is not committed "
            "('calibrary registry add FILE' does that)"
        )


def flight_entries(
    snapshot: Snapshot, folder: Path, *, recursive: bool = False
) -> tuple[list[str], list[str]]:
    """Find the entries that extract would use for these images.

    Returns:
        Paths of the entries, and a sentence for each camera without one.

    Raises:
        InputError: the folder contains no images.
        RegistryError: the registry cannot be read.
    """
    images = Listing([folder], recursive=recursive)
    if images.known == 0:
        raise InputError("holds no images, and names no entry", source=str(folder))
    knowledge = Knowledge(catalogue=load_catalogue(), registry=snapshot.index(), on=date.today())
    paths: dict[str, None] = {}
    unanswered = []
    question = Question(days=True, list_all=images.known is not None)
    reading = read_images(images, question, engine=here(0, known=images.known))
    states = reading.images.settled().by_day
    dated = (
        (metadata, known)
        for metadata, days in states.items()
        for known, _ in knowledge.by_day(metadata, days)
    )
    for metadata, known in dated:
        if known.resolution is not None and not known.resolution.is_of_its_day:
            paths[known.resolution.path] = None
            continue
        if known.resolution is not None:
            unanswered.append(
                f"{known.resolution.path}: {known.resolution.why}; a lock pins one revision of an entry, that of now"
            )
            continue
        named = " ".join(text for text in (metadata.make, metadata.model) if text)
        near = f" ({known.near[0].path}: {known.near[0].reason})" if known.near else ""
        unanswered.append(f"no entry applies to {named or 'an image that names no camera'}{near}")
    return list(paths), unanswered
