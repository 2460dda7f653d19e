"""KEY: the shortest way to say which entry, ``make/model[/variant]``, in any case and spelling."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from difflib import get_close_matches
from typing import Final

from calibrary.errors import RegistryError, UnknownCameraError
from calibrary.registry.entry import ROOT, SUFFIX
from calibrary.registry.slug import slug

__all__ = ["find_path", "find_paths", "id_of"]

MOST_LISTED: Final = 8


def id_of(path: str) -> str:
    """An entry's id, which is also its longest KEY: its path without ``cameras/`` and ``.yaml``."""
    return path.removeprefix(ROOT).removesuffix(SUFFIX)


def find_path(paths: Collection[str], key: str) -> str:
    """The one entry that a KEY means.

    Args:
        paths: of all entries.
        key: ``make/model[/variant]`` or a part that ends it early: ``fc6310r``, ``dji/fc6310r``,
            ``dji/fc6310r/5472``; make and model may be written as EXIF writes them.

    Raises:
        UnknownCameraError: none; the message names those that are nearly so called.
        RegistryError: several; the message names them.
    """
    found = find_paths(paths, key)
    if len(found) == 1:
        return found[0]
    if not found:
        raise UnknownCameraError(f"{key}: no such camera in the registry{_nearly(paths, key)}")
    listed = ", ".join(id_of(path) for path in found[:MOST_LISTED])
    more = f" and {len(found) - MOST_LISTED} more" if len(found) > MOST_LISTED else ""
    raise RegistryError(f"{key} fits {len(found)} entries: {listed}{more}; name one of them")


def find_paths(paths: Collection[str], key: str) -> list[str]:
    """Every entry that a KEY may mean, sorted; an exact id, or the plain entry of a model, means itself alone."""
    path = f"{ROOT}{key.strip('/')}{SUFFIX}" if not key.startswith(ROOT) else key
    for exact in (path, path.lower()):
        if exact in paths:
            return [exact]
    asked = [part for part in key.removeprefix(ROOT).removesuffix(SUFFIX).split("/") if part.strip()]
    if not asked:
        return []
    found = [path for path in paths if _fits(id_of(path).split("/"), asked)]
    return sorted(found)


def _fits(parts: Sequence[str], asked: Sequence[str]) -> bool:
    """Whether the words asked for are an entry's own: from its make on, or from its model on."""
    return any(_fits_from(parts[start:], asked) for start in (0, 1))


def _fits_from(parts: Sequence[str], asked: Sequence[str]) -> bool:
    if len(asked) > len(parts) or not parts:
        return False
    *whole, last = asked
    if not all(_is(part, word) for part, word in zip(parts, whole, strict=False)):
        return False
    part, is_variant = parts[len(whole)], parts[len(whole)] == parts[-1]
    # A make or model is said in full; what comes after it may be cut short.
    return part.startswith(last.lower()) if is_variant else _is(part, last)


def _is(part: str, word: str) -> bool:
    """Whether a word names a part of a path: as the path writes it, or as EXIF does."""
    return part == word.lower() or part == slug(word)


def _nearly(paths: Collection[str], key: str) -> str:
    words = [word for word in key.lower().split("/") if word]
    if not words:
        return ""
    names = sorted({"/".join(id_of(path).split("/")[:2]) for path in paths})
    by_model = {name.rpartition("/")[2]: name for name in names}
    close = get_close_matches("/".join(words[:2]), names, n=3, cutoff=0.5)
    close += [by_model[model] for model in get_close_matches(words[-1], by_model, n=3, cutoff=0.6)]
    near = list(dict.fromkeys(close))[:3]
    if near:
        return f"; nearest: {', '.join(near)}"
    return "; it holds no entry yet: 'calibrary registry add' puts one in" if not names else ""
