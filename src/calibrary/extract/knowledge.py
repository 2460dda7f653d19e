"""What is known of a camera before its images are heard: the fleet's registry, then the catalogue."""

from __future__ import annotations

from dataclasses import dataclass, replace
from datetime import date
from pathlib import Path

from calibrary.calibration import Calibration
from calibrary.errors import InputError, RegistryError
from calibrary.evidence.identity import camera_key
from calibrary.evidence.metadata import ImageMetadata
from calibrary.known_camera import KnownCamera
from calibrary.registry.catalogue import Catalogue, load_catalogue, match_image
from calibrary.registry.folder import open_folder, read_entry_file
from calibrary.registry.pins import pin_of, read_lock, refuse_drift
from calibrary.registry.resolution import Near, RegistryIndex, Resolution

__all__ = ["Knowledge", "Known"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Known:
    """What is known of one camera.

    Attributes:
        camera: its row of the catalogue, None for a camera nobody knows.
        siblings: the other cameras that share its Model.
        why: how the row was told, or why there is none.
        resolution: the registry's entry, its K at the image's size.
        near: where there is none, the registry's entries of this model and why not they.
    """

    camera: KnownCamera | None = None
    siblings: tuple[KnownCamera, ...] = ()
    why: str | None = None
    resolution: Resolution | None = None
    near: tuple[Near, ...] = ()

    @property
    def calibration(self) -> Calibration | None:
        """The registry's K at the image's size, where it has one."""
        return self.resolution.calibration if self.resolution is not None else None

    @property
    def title(self) -> str | None:
        """What people call the camera."""
        return self.camera.title if self.camera is not None else None

    @property
    def needs_no_sensor(self) -> bool:
        """Whether the size of its pixels, or its K, is known: a default sensor could only be wrong."""
        return self.calibration is not None or (self.camera is not None and self.camera.pitch_um is not None)


@dataclass(frozen=True, slots=True, kw_only=True)
class Knowledge:
    """The registry, where one is given, and the catalogue.

    Attributes:
        catalogue: of known cameras.
        registry: the fleet's own.
        on: the day that entries must be valid on; None asks nothing of theirs.
    """

    catalogue: Catalogue
    registry: RegistryIndex | None = None
    on: date | None = None

    @classmethod
    def load(cls, registry: Path | None, lock: Path | None = None) -> Knowledge:
        """Read the catalogue and list the registry.

        Args:
            registry: a registry's folder.
            lock: the file that pins entries of it; no others are used then.

        Raises:
            RegistryError: there is no registry at the path, or it has drifted from the lock.
            InputError: the lock cannot be read.
        """
        if registry is None:
            return cls(catalogue=load_catalogue())
        index = _pinned(registry, lock) if lock is not None else open_folder(registry)
        return cls(catalogue=load_catalogue(), registry=index, on=date.today())

    @property
    def has_registry(self) -> bool:
        """Whether a registry was given."""
        return self.registry is not None

    def of(self, metadata: ImageMetadata) -> Known:
        """What is known of the camera that took an image.

        Raises:
            RegistryError: two of the registry's entries fit the camera equally well, or one that may fit cannot
                be read.
        """
        match = match_image(self.catalogue, metadata)
        known = Known(camera=match.camera, siblings=match.siblings or match.candidates, why=match.reason)
        if self.registry is None:
            return known
        inferred = match.camera.sub_camera if match.camera is not None else None
        # No part of the key that groups images, but an entry may be of one firmware only.
        key = replace(camera_key(metadata, inferred), firmware=metadata.software)
        resolution = self.registry.resolve(key, on=self.on)
        near = self.registry.near(key, on=self.on) if resolution is None else ()
        return replace(known, resolution=resolution, near=near)


def _pinned(registry: Path, lock: Path) -> RegistryIndex:
    """The pinned entries of a registry and no others, each of them as it was."""
    there, held = open_folder(registry), read_lock(lock)
    pinned = {pin.path for pin in held.pins}
    files = {path: read_entry_file(registry, path) for path in there.paths if path in pinned}
    try:
        current = [pin_of(path, data) for path, data in files.items()]
    except InputError as error:
        raise RegistryError(str(error)) from None
    refuse_drift(held, current, name=str(lock))
    return RegistryIndex(files, files.__getitem__, require_digest=False)
