"""Which registry is meant: the one that was named, the one around here, or a user's own."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Final

from platformdirs import user_data_path

from calibrary.errors import RegistryError

__all__ = ["MARKER", "VARIABLE", "default_place", "find_registry", "require_registry"]

MARKER: Final = "registry.yaml"
"""The file at a registry's root."""

VARIABLE: Final = "CALIBRARY_REGISTRY"


def find_registry(named: Path | None = None, *, environment: Mapping[str, str] | None = None) -> Path | None:
    """The registry's folder: as named, else ``$CALIBRARY_REGISTRY``, else around here, else a user's own.

    Args:
        named: on the command line.
        environment: in place of the process's own.

    Returns:
        None where there is none yet. What is named is returned whether or not it is there.
    """
    if named is not None:
        return named
    variable = (os.environ if environment is None else environment).get(VARIABLE)
    if variable:
        return Path(variable)
    here = Path.cwd()
    for folder in (here, *here.parents):
        if (folder / MARKER).is_file():
            return folder
    own = default_place()
    return own if own.exists() else None


def require_registry(named: Path | None = None) -> Path:
    """The same, where there has to be one.

    Raises:
        RegistryError: there is none; the message says how to come by one.
    """
    place = find_registry(named)
    if place is None:
        raise RegistryError(
            f"no registry: none named with --registry or ${VARIABLE}, no {MARKER} in this folder or above it, none "
            f"at {default_place()}; 'calibrary registry init' makes one"
        )
    return place


def default_place() -> Path:
    """Where a user's own registry lies on this system."""
    return user_data_path("calibrary", appauthor=False) / "registry"
