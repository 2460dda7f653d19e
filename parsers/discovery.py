"""Finding the formats: the modules in ``formats/``, the table of refused ones, and those of other packages.

Nothing is imported before it is asked for, so that ``import calibrary.parsers`` stays light.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from importlib.metadata import entry_points
from pkgutil import iter_modules
from types import MappingProxyType

from calibrary.errors import InputError
from calibrary.parsers import formats as folder
from calibrary.parsers.format import Format
from calibrary.parsers.refused import REFUSED

__all__ = ["GROUP", "format_named", "known_formats"]

GROUP = "calibrary.formats"
"""The entry-point group by which other packages add formats."""


def format_named(name: str) -> Format:
    """The format of that name.

    Raises:
        InputError: there is none; the message lists those there are.
    """
    if name in _module_names():
        return _built_in(name)
    try:
        return known_formats()[name]
    except KeyError:
        names = ", ".join(known_formats())
        raise InputError(f"there is no format {name!r}; there are {names}") from None


@cache
def known_formats() -> Mapping[str, Format]:
    """All formats by name, in alphabetical order.

    A registered format that cannot be loaded, or that takes a name already taken, is left out with a
    warning: other files stay readable.
    """
    found = {name: _built_in(name) for name in _module_names()}
    found |= {record.name: record for record in REFUSED}
    for point in entry_points(group=GROUP):
        try:
            record = point.load()
        except Exception as error:  # noqa: BLE001  foreign code may fail in any way at import
            _complain(f"{point.value} cannot be loaded: {error}")
            continue
        if not isinstance(record, Format):
            _complain(f"{point.value} is not a calibrary.parsers.format.Format")
        elif record.name in found:
            _complain(f"{point.value} calls itself {record.name!r}, which is taken")
        else:
            found[record.name] = record
    return MappingProxyType(dict(sorted(found.items())))


@cache
def _module_names() -> frozenset[str]:
    """Modules whose name starts with an underscore are helpers of their neighbours."""
    return frozenset(
        module.name for module in iter_modules(folder.__path__) if not module.name.startswith("_")
    )


@cache
def _built_in(name: str) -> Format:
    record = import_module(f"{folder.__name__}.{name}").FORMAT
    if not isinstance(record, Format) or record.name != name:
        raise InputError(f"{folder.__name__}.{name} must hold FORMAT, a Format of the same name")
    return record


def _complain(what: str) -> None:
    warnings.warn(f"entry point of {GROUP}: {what}; it is left out", RuntimeWarning, stacklevel=4)
