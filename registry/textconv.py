"""An entry's file as lines for ``git diff``: one field a line, every digit, and the uncertainty beside its number."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Final

from calibrary.errors import InputError
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import LARGEST_ENTRY, parse_entry
from calibrary.registry.fields import entry_fields, std_of

__all__ = ["entry_rows", "entry_text"]

WIDTH: Final = 24
"""The same in every file, or a longer name would make a difference of every line."""


def entry_text(path: Path) -> str:
    """The lines; for a file that is not an entry its own text, below the error. It never fails."""
    try:
        with path.open("rb") as file:
            data = file.read(LARGEST_ENTRY + 1)
    except OSError as error:
        return f"cannot be read: {error.strerror}\n"
    try:
        entry = parse_entry(data, "this file", require_digest=False)
    except InputError as error:
        return f"{error}\n{_printable(data)}"
    warning = "" if b"\ndigest:" in data else "no digest: changed by hand\n"
    return warning + "".join(f"{line}\n" for line in _lines(entry))


def entry_rows(entry: Entry, digits: Callable[[float], str] = repr) -> list[tuple[str, str]]:
    """Every field of an entry by its name, its uncertainty behind it; no control characters."""
    return [
        (
            name,
            (digits(value) if isinstance(value, float) else _clean(str(value)))
            + _spread(entry, name, digits),
        )
        for name, value in entry_fields(entry).items()
    ]


def _lines(entry: Entry) -> list[str]:
    return [f"{name:<{WIDTH}}  {text}" for name, text in entry_rows(entry)]


def _spread(entry: Entry, name: str, digits: Callable[[float], str]) -> str:
    """The uncertainty of a number of K or the distortion, and its unit."""
    block, _, parameter = name.partition(".")
    std = std_of(entry, parameter) if block in {"intrinsics", "distortion"} else None
    return (f" ± {digits(std)}" if std is not None else "") + (" px" if block == "intrinsics" else "")


def _clean(text: str) -> str:
    return "".join(c if c.isprintable() else f"\\x{ord(c):02x}" for c in text)


def _printable(data: bytes) -> str:
    lines = data.decode("utf-8", "replace").split("\n")
    return "\n".join(map(_clean, lines))
