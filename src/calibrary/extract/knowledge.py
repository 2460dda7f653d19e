"""What is known of a camera before its images are heard: the fleet's registry, then the catalogue."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from calibrary.calibration import Calibration, CameraKey
from calibrary.evidence.identity import camera_key
from calibrary.evidence.metadata import ImageMetadata
from calibrary.known_camera import KnownCamera
from calibrary.registry.catalogue import Catalogue, load_catalogue, match_image
from calibrary.registry.entries import Entry, read_entries, resolve

__all__ = ["Knowledge", "Known"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Known:
    """What is known of one camera.

    Attributes:
        camera: its row of the catalogue, None for a camera nobody knows.
        siblings: the other cameras that share its Model.
        why: how the row was told, or why there is none.
        calibration: the registry's K at the image's size, where it has one.
    """

    camera: KnownCamera | None = None
    siblings: tuple[KnownCamera, ...] = ()
    why: str | None = None
    calibration: Calibration | None = None

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
    """The registry, where one is given, and the catalogue."""

    catalogue: Catalogue
    entries: Sequence[Entry] | None = None

    @classmethod
    def load(cls, registry: Path | None) -> Knowledge:
        """Read both.

        Raises:
            RegistryError: there is no registry at the path, or an entry in it cannot be read.
        """
        entries = read_entries(registry) if registry is not None else None
        return cls(catalogue=load_catalogue(), entries=entries)

    @property
    def has_registry(self) -> bool:
        """Whether a registry was given."""
        return self.entries is not None

    def resolve(self, key: CameraKey) -> Calibration | None:
        """The registry's K for a camera, None without one; see :func:`calibrary.registry.entries.resolve`."""
        return resolve(self.entries, key) if self.entries is not None else None

    def of(self, metadata: ImageMetadata) -> Known:
        """What is known of the camera that took an image.

        Raises:
            RegistryError: two of the registry's entries fit the camera equally well.
        """
        match = match_image(self.catalogue, metadata)
        inferred = match.camera.sub_camera if match.camera is not None else None
        # No part of the key that groups images, but an entry may be of one firmware only.
        key = replace(camera_key(metadata, inferred), firmware=metadata.software)
        return Known(
            camera=match.camera,
            siblings=match.siblings or match.candidates,
            why=match.reason,
            calibration=self.resolve(key),
        )
