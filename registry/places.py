"""Which registry a command uses. This module loads fast: a run that uses none asks it too."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from calibrary.arguments import Place
from calibrary.errors import RegistryError, UsageError

CONFIGURATION_FILE: Final = "registry.yaml"
"""File name at the root of a registry."""
ADDRESS: Final = re.compile(r"file:|[a-z][a-z0-9+.-]+://", re.IGNORECASE)
PUBLISHED_FILE: Final = "calibrary-manifest.json"
"""The signed file of a published registry, which leads to all others."""
VARIABLE: Final = "CALIBRARY_REGISTRY"
SEPARATOR: Final = ";"
"""Separates registries in the environment variable; ``:`` occurs in every address."""
NONE: Final = "none"
"""In place of a registry: use none and look for none. ``./none`` is a folder of that name."""
FOLDER: Final = "folder:"
"""Prefix of a path: read the files in this folder, whether or not they are in git."""


def registries(named: Place | Sequence[Place] | None = None, *, needed: bool = False) -> tuple[Place, ...]:
    """Return the registries to use, the first with precedence: the one rule of all commands and of Python.

    They are the first of these that there are:

    1. those that are named, with ``--registry`` or as an argument;
    2. those in ``$CALIBRARY_REGISTRY``, separated by ``;``;
    3. the nearest folder with a registry.yaml: this one, or one above it;
    4. the user's own, if it was created.

    The word ``none`` in place of a name stops the search: no registry is used.

    Args:
        named: folders, ``folder:PATH`` for files without git, and published ones: https:// addresses, or folders with
            their files.
        needed: whether it is an error if there is none.

    Returns:
        Folders and addresses; a named one whether or not it exists: opening it raises a RegistryError.

    Raises:
        UsageError: ``none`` is named together with others.
        RegistryError: a registry is needed, and there is none.
    """
    given = () if named is None else (named,) if isinstance(named, str | Path) else tuple(named)
    found = given or tuple(_in_the_variable()) or tuple(_nearest()) or tuple(_own_registry())
    if NONE in map(str, found):
        if len(found) > 1:
            raise UsageError(f"--registry: {NONE} goes alone; ./{NONE} is a folder of that name")
        found = ()
    if needed and not found:
        raise RegistryError(
            f"no registry: none named with --registry or ${VARIABLE}, no {CONFIGURATION_FILE} in this folder or "
            f"above it, none at {default_place()}; 'calibrary registry init' makes one"
        )
    return found


def one_registry(named: Place | Sequence[Place] | None = None) -> Path:
    """Return the folder of the registry to use, for changes and for the history.

    Args:
        named: as for :func:`registries`; of several in ``$CALIBRARY_REGISTRY``, the first folder is used.

    Raises:
        UsageError: several are named, or a published one.
        RegistryError: there is none, or the variable contains published ones only.
    """
    found = registries(named, needed=True)
    folders = [one for one in found if not is_published(str(one))]
    is_named = named is not None and named != ()
    if is_named and len(found) > 1:
        raise UsageError("--registry: this needs one registry")
    if not folders:
        name = str(found[0]) if is_named else f"${VARIABLE}: {SEPARATOR.join(map(str, found))}"
        kind = UsageError if is_named else RegistryError
        raise kind(
            f"{name}: a published registry is read by 'resolve', 'extract' and 'check'; expected the folder of a "
            "registry: --registry PATH, or --registry folder:PATH without git"
        )
    return Path(folders[0])


def is_published(text: str) -> bool:
    """Return whether a registry is a published one: at an address, or its files in a folder, as on a USB stick."""
    return ADDRESS.match(text) is not None or Path(text.removeprefix(FOLDER), PUBLISHED_FILE).is_file()


def plain_folder(place: Path) -> Path | None:
    """Return the folder of ``folder:PATH``; None for any other place."""
    text = str(place)
    return Path(text.removeprefix(FOLDER)) if text.startswith(FOLDER) else None


def default_place() -> Path:
    """Return the folder of a user's own registry on this system."""
    from platformdirs import user_data_path  # noqa: PLC0415  10 ms; a registry is usually found before it is needed

    return user_data_path("calibrary", appauthor=False) / "registry"


def _in_the_variable() -> Iterator[str]:
    return (part for text in os.environ.get(VARIABLE, "").split(SEPARATOR) if (part := text.strip()))


def _nearest() -> Iterator[Path]:
    with suppress(OSError):  # a folder above may be closed to us, and this one may be gone
        here = Path.cwd()
        for folder in (here, *here.parents):
            if (folder / CONFIGURATION_FILE).is_file():
                yield folder
                return


def _own_registry() -> Iterator[Path]:
    own = default_place()
    if own.exists():
        yield own
