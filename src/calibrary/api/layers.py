"""Several registries asked in their order, and below them the catalogue."""

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
    """Registries in the order in which they are asked: folders, and addresses of published ones.

    Attributes:
        layers: the first that answers is used; the catalogue comes after all of them.
    """

    layers: Layers

    @classmethod
    def named(cls, places: Sequence[Place] = (), *, at: str | None = None) -> Self:
        """The registries at some places, else those that $CALIBRARY_REGISTRY or the current folder means.

        Args:
            places: folders and addresses.
            at: the revision of the only one, which is in git.

        Raises:
            RegistryError: none is meant, or a folder is not a registry.
        """
        return cls(open_layers(named_registries(places), at=at, catalogue=True))

    def resolve(
        self,
        camera: str | Path | Calibration | CameraKey | None = None,
        *,
        stated: CameraLike | None = None,
        on: date | None = None,
    ) -> FleetAnswer:
        """The calibration that applies to a camera; see :meth:`calibrary.Fleet.resolve`.

        Raises:
            RegistryError: also where a registry cannot be reached before one has answered.

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
    """What registries say of a camera; arguments as of :meth:`LayeredView.resolve`."""
    if camera is None or isinstance(camera, str | Path):
        question = asked(layers, str(camera) if camera is not None else None, overlay(stated))
    else:
        key = camera.camera if isinstance(camera, Calibration) else camera
        known = asked(layers, None, lambda _: overlay(stated)(hashed(key)))
        question = Question(key=known.key, known_by="what was said")
    day = on or question.day or date.today()
    return FleetAnswer(answer(layers, question, on=day), day)
