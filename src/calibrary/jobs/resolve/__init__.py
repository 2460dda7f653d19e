"""Find the calibration that applies to a camera, in one registry or in several.

>>> from calibrary.jobs.resolve import resolve
>>> answer = resolve("survey/DJI_0001.JPG", registry="fleet")
>>> answer.status, answer.calibration.intrinsics.fx
(<Status.APPROVED: 'approved'>, 3659.5)
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from msgspec import Meta

from calibrary.arguments import File, Place
from calibrary.errors import UsageError
from calibrary.known_camera import CameraKey

if TYPE_CHECKING:
    from calibrary.jobs.resolve.run import FleetAnswer

__all__ = ["names_image", "resolve"]


def resolve(
    what: File | None = None,
    *,
    camera: CameraKey | None = None,
    on: date | None = None,
    at: Annotated[str, Meta(title="REV")] | None = None,
    registry: Place | Sequence[Place] | None = None,
    history: bool = False,
) -> FleetAnswer:
    """Find the calibration that applies to a camera.

    Args:
        what: image or KEY, if no flags state the camera.
        camera: what is known of the camera, in place of what the image or the entry states.
        on: day for which the entry has to be valid (default: the day of the image, or else today).
        at: as the registry was at a commit, tag, branch or day.
        registry: a folder, or the address of a published registry; if you give several, the first that answers is
            used; calibrary registry --help explains the default.
        history: also say who added and approved the entry.

    Raises:
        UsageError: nothing says which camera.
        InputError: the image cannot be read, or make and model are unknown.
        RegistryError: a registry cannot be read or reached and no earlier one has a matching entry, the KEY matches
            several models, or several entries fit equally well; the message names them.
    """
    from calibrary.jobs.layers import open_layers
    from calibrary.jobs.resolve.run import resolved
    from calibrary.registry.places import registries

    if what is None and camera in {None, CameraKey()}:
        raise UsageError("say which camera: an image of it, its KEY, or --make and --model")
    layers = open_layers(registries(registry, needed=True), at=at, catalogue=True)
    return resolved(layers, what, stated=camera, on=on, history=history)


def names_image(word: str) -> bool:
    """Whether a word names an image, and not a KEY; a file by its content, what is missing by its name."""
    is_file = os.path.isfile(word)  # noqa: PTH113  that of a Path fails of a word too long for a name
    # A KEY needs neither the formats nor the readers of metadata.
    if not (is_file or Path(word).suffix):
        return False
    from calibrary.parsers import is_image_file
    from calibrary.parsers.files import is_image

    return is_image_file(Path(word)) if is_file else is_image(word)
