"""Lookup in several registries in order, and finally in the catalogue."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import Self

from msgspec import Struct

from calibrary.api.registry_results import FleetAnswer
from calibrary.api.stated import CameraLike, hashed, overlay
from calibrary.calibration import Calibration, CameraKey
from calibrary.jobs.exchange.layers import Layers, Place, open_layers
from calibrary.jobs.exchange.resolve import Question, answer, asked
from calibrary.registry.configuration import named_registries

__all__ = ["LayeredView", "resolved"]


class LayeredView(Struct, frozen=True, eq=False, dict=True):
    """Registries in lookup order: folders, and addresses of published ones.

    Attributes:
        layers: the first layer with a matching entry is used; the catalogue is the last one.
    """

    layers: Layers

    @classmethod
    def named(cls, places: Sequence[Place] = (), *, at: str | None = None) -> Self:
        """Return the registries at ``places``, else those given by $CALIBRARY_REGISTRY or the current folder.

        Args:
            places: folders and addresses.
            at: revision; allowed only for a single registry in git.

        Raises:
            RegistryError: no registry is given, or a folder is not a registry.
        """
        return cls(open_layers(named_registries(places), at=at, catalogue=True))

    def resolve(
        self,
        camera: str | Path | Calibration | CameraKey | None = None,
        *,
        stated: CameraLike | None = None,
        on: date | None = None,
    ) -> FleetAnswer:
        """Find the calibration that applies to a camera; see :meth:`calibrary.Fleet.resolve`.

        Raises:
            RegistryError: also if a registry cannot be reached and no earlier one has a matching entry.

        >>> both = LayeredView.named(["fleet", "https://example.com/cameras"])  # doctest: +SKIP
        >>> both.resolve("survey/DJI_0001.JPG").registry  # doctest: +SKIP
        'fleet'
        """
        return resolved(self.layers, camera, stated=stated, on=on)


def resolved(
    layers: Layers,
    camera: str | Path | Calibration | CameraKey | None,
    *,
    stated: CameraLike | None,
    on: date | None,
) -> FleetAnswer:
    """Look up a camera in registries; arguments as for :meth:`LayeredView.resolve`."""
    if camera is None or isinstance(camera, str | Path):
        question = asked(layers, str(camera) if camera is not None else None, overlay(stated))
    else:
        key = camera.camera if isinstance(camera, Calibration) else camera
        known = asked(layers, None, lambda _: overlay(stated)(hashed(key)))
        question = Question(key=known.key, known_by="what was said")
    day = on or question.day or date.today()
    return FleetAnswer(answer(layers, question, on=day), day)
