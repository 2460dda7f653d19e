"""Paths of a registry's files: cameras' names in them, allowed paths, and the KEYs that abbreviate them.

A make or model may be any text; its slug is valid on every file system, and two texts have the same slug exactly if
their match keys are equal. A lossless slug contains only ``a-z 0-9 . - _`` (``_`` is a blank). Other names, and those
with a special meaning for a file system or git, end in ``~`` and ten digits of a hash; no other slug contains ``~``. A
KEY is the shortest name of an entry, ``make/model[/variant]``, in any case and spelling.
"""

from __future__ import annotations

import hashlib
import re
import unicodedata
from collections.abc import Callable, Collection, Mapping, Sequence
from difflib import get_close_matches
from functools import lru_cache
from heapq import nlargest
from itertools import repeat
from operator import add, contains
from typing import Final

from calibrary.errors import AmbiguousCameraError, InputError, RegistryError, UnknownCameraError, first_of
from calibrary.known_camera import HEX_DIGITS, SERIAL_HASH_DIGITS, CameraKey, hash_serial, match_key
from calibrary.registry.firmware import FirmwareRange
from calibrary.registry.git.program import is_safe_name

DOCUMENT: Final = "DISTORTION.md"
"""File at the root of a registry that describes the distortion models."""
LONGEST_SLUG: Final = 48
LONGEST_STEM: Final = 32

_LOSSLESS = re.compile(r"[a-z0-9. -]+")
_DEVICES = r"con|prn|aux|nul|conin\$|conout\$|com[0-9]|lpt[0-9]"
_SPECIAL = re.compile(
    # Names with a special meaning for Windows, git or a shell: devices, options, hidden files, git's own names.
    rf"(?:{_DEVICES})(?:[. ].*)?|[-. ].*|.*[. ]|.*\.\..*|\.?git|.*\.(?:lock|yaml)",
    re.DOTALL,
)


@lru_cache(maxsize=1 << 14)
def slug(text: str) -> str:
    """Return a match key as one part of a path: lower-case ASCII, at most 48 characters."""
    key = match_key(text)
    if _LOSSLESS.fullmatch(key) and len(key) <= LONGEST_SLUG and not _SPECIAL.fullmatch(key):
        return key.replace(" ", "_")
    digits = hashlib.sha256(key.encode("utf-8", "surrogatepass")).hexdigest()[:10]
    return f"{_stem(key)}~{digits}"


def scripts(text: str) -> frozenset[str]:
    """Return the scripts of the letters ("LATIN", "CYRILLIC", …); more than one in a name is most likely an error."""
    return frozenset(unicodedata.name(c, "UNKNOWN").partition(" ")[0] for c in text if c.isalpha())


def _stem(key: str) -> str:
    """Return the readable part of a key; the hash that follows makes it unique."""
    shown = re.sub(r"[^a-z0-9. -]", "", key).replace(" ", "_")
    shown = re.sub(r"\.{2,}", ".", shown).lstrip("-._")[:LONGEST_STEM].rstrip("._-")
    if not shown or _SPECIAL.fullmatch(shown.replace("_", " ")):
        return f"x{shown}"
    return shown


CAMERAS = "cameras"
EVENTS: Final = "events/"
"""Folder of the statements on what is approved; see :mod:`calibrary.registry.statements`."""
DEEPEST = 8
SINGLE_FILES = frozenset(
    {
        ".gitattributes",
        ".github/CODEOWNERS",
        ".pre-commit-config.yaml",
        ".vscode/settings.json",
        "CONTRIBUTING.md",
        DOCUMENT,
        "LICENSE",
        "NOTICE",
        "README.md",
        "registry.yaml",
    }
)
WORKFLOW = re.compile(r"\.github/workflows/[a-z0-9][a-z0-9._-]*\.yml\Z")
SCHEMA = re.compile(r"schema/[a-z0-9][a-z0-9._-]*\.json\Z")
STATEMENT = re.compile(
    r"events/(?:[a-z0-9_][a-z0-9._~+-]*/){1,7}\d{4}-\d\d-\d\d-[a-z]+-[a-z0-9._~-]+-[0-9a-f]{32}\.json\Z"
)
NAME = re.compile(r"[a-z0-9_][a-z0-9._~+-]*\Z")


def check_path(path: str) -> str:
    """Return the path, if it is allowed in a registry.

    Raises:
        RegistryError: it is not ``cameras/**.yaml`` or one of the few other allowed files.
    """
    if path in SINGLE_FILES or WORKFLOW.match(path) or SCHEMA.match(path) or STATEMENT.match(path):
        return path
    root, *names = path.split("/")
    if (
        root != CAMERAS
        or not 1 <= len(names) <= DEEPEST
        or not names[-1].endswith(".yaml")
        or any(name.endswith(".yaml") for name in names[:-1])
        or not all(NAME.match(name) and is_safe_name(name) for name in names)
    ):
        raise RegistryError(
            f"{path!r} is not allowed in a registry: expected cameras/<make>/<model>/<variant>.yaml in lower-case "
            f"letters, digits and . _ ~ + -, or one of {', '.join(sorted(SINGLE_FILES))}, schema/*.json, "
            ".github/workflows/*.yml"
        )
    return path


ROOT: Final = "cameras/"
"""Folder of the entries."""
PROPOSED: Final = "@proposed"
"""What follows a path, or a KEY, to name what its file says and too few people have approved yet."""
SUFFIX: Final = ".yaml"
UNIT: Final = "sn-"
"""Prefix of a unit's folder; the hash of the serial number follows."""
SHORTEST_HASH: Final = 4
LONGEST_LEAF: Final = 110

MOST_COMPARED: Final = 500
"""Number of names that are compared letter by letter with a KEY that no entry has."""
MOST_LISTED: Final = 8


def folder_of(make: str, model: str) -> str:
    """Return the folder of a model's entries, with a trailing slash."""
    return f"{ROOT}{slug(make)}/{slug(model)}/"


_PART: Final = "[a-z0-9_][a-z0-9._~-]*"
_LEAF: Final = "[0-9]+x[0-9]+(?:~[0-9a-f]{10}|(?:[+][a-z][a-z0-9._~-]*)*)"
_ENTRY: Final = re.compile(rf"{ROOT}{_PART}/{_PART}/(?:{UNIT}{_PART}/)?{_LEAF}{re.escape(SUFFIX)}")


def is_entry(path: str) -> bool:
    """Return whether a path is one that :func:`path_of` gives; nothing else is read as an entry."""
    return _ENTRY.fullmatch(path) is not None


def path_of(camera: CameraKey, firmware: FirmwareRange | None = None) -> str:
    """Return ``cameras/<make>/<model>/[sn-<serial>/]<width>x<height>[+…].yaml``.

    Every part after the size states its field, and no slug contains ``+``, so different keys have different paths; a
    hash replaces parts that are too long. The file name starts with a digit and a unit's folder with ``sn-``, so that
    they cannot collide.

    Raises:
        InputError: the key has no make, no model or no image size.
    """
    if not camera.make or not camera.model or camera.image_size is None:
        raise InputError(f"{camera} cannot be in a registry, expected make, model and image size")
    width, height = camera.image_size
    parts = [f"{width}x{height}"]
    stated = (("mode", camera.capture_mode), ("sub", camera.sub_camera), ("lens", camera.lens))
    parts += [f"{name}-{slug(text)}" for name, text in stated if text is not None]
    if camera.focal_mm is not None:
        parts.append(f"f{camera.focal_mm!r}".removesuffix(".0"))
    if firmware is not None:
        parts.append(f"fw-{slug(firmware.min)}" if firmware.min else f"fw-to-{slug(firmware.max or '')}")
    leaf = "+".join(parts)
    if len(leaf) > LONGEST_LEAF:
        leaf = f"{parts[0]}~{hashlib.sha256(leaf.encode()).hexdigest()[:10]}"
    unit = f"{UNIT}{slug(camera.serial)}/" if camera.serial is not None else ""
    return f"{folder_of(camera.make, camera.model)}{unit}{leaf}{SUFFIX}"


def id_of(path: str) -> str:
    """Return an entry's id, its longest KEY: its path without ``cameras/`` and ``.yaml``."""
    return file_path(path).removeprefix(ROOT).removesuffix(SUFFIX)


def is_proposal(name: str) -> bool:
    """Return whether a name is of what is only proposed."""
    return name.endswith(PROPOSED)


def proposed_name(path: str) -> str:
    """Return the name of what the file of an entry says and is only proposed."""
    return f"{file_path(path)}{PROPOSED}"


def file_path(name: str) -> str:
    """Return the path of the file of an entry, or of what is proposed for it."""
    return name.removesuffix(PROPOSED)


def model_folder(path: str) -> str:
    """Return the folder of an entry's make and model, ``cameras/dji/fc6310r``."""
    return "/".join(path.split("/")[:3])


def find_path(paths: Collection[str], key: str) -> str:
    """Return the one entry that a KEY names.

    Args:
        paths: paths of all entries.
        key: ``make/model[/variant]`` or a shorter form: ``fc6310r``, ``dji/fc6310r``, ``dji/fc6310r/5472``; make and
            model may be written as in EXIF.

    Raises:
        UnknownCameraError: no entry matches; the message lists similar names.
        RegistryError: several entries match; the message lists them.
    """
    return single_match(find_paths(paths, key), paths, key)


def single_match(found: Sequence[str], paths: Collection[str], key: str) -> str:
    """Return the single match of a KEY; errors as for :func:`find_path`."""
    if len(found) == 1:
        return found[0]
    if not found:
        raise UnknownCameraError(f"{key}: no such camera in the registry{_suggestion(paths, key)}")
    listed = first_of(map(id_of, found), MOST_LISTED)
    raise AmbiguousCameraError(f"{key} fits {len(found)} entries: {listed}; name one of them")


def unit_paths(
    paths: Collection[str],
    key: str,
    *,
    labels: Callable[[], Mapping[str, str]],
    makes: Callable[[], Mapping[str, str]],
) -> list[str]:
    """Return every entry of the units that a KEY may name: by label, serial number, or the beginning of its hash.

    Args:
        paths: paths of all entries.
        key: one of these, optionally with a slash and the beginning of the variant: ``P4R-03``, ``1ZNBJ1A00C00ED``,
            ``0e25/5472``.
        labels: returns the label of each entry that has one, by path.
        makes: returns the makes of the units as written in their entries, by folder name.
    """
    word, _, variant = key.removeprefix(ROOT).strip("/").partition("/")
    named = match_key(word)
    labelled = [path for path, label in labels().items() if match_key(label) == named and path in paths]
    if not labelled:
        by_unit: dict[str, list[str]] = {}
        # Few of 100 000 paths are of a unit.
        for path in (path for path in paths if f"/{UNIT}" in path):
            if (unit := unit_folder(path)) is not None:
                by_unit.setdefault(unit, []).append(path)
        units = _by_hash(by_unit, word) or _by_serial(by_unit, word, makes)
        labelled = [path for unit in units for path in by_unit[unit]]
    return sorted(path for path in labelled if id_of(path).rpartition("/")[2].startswith(variant.lower()))


def unit_folder(path: str) -> str | None:
    """Return the folder in ``cameras/`` of an entry's unit; None for an entry of all units of its model."""
    folder = file_path(path).rpartition("/")[0]
    return f"{folder}/" if folder.rpartition("/")[2].startswith(UNIT) else None


def _by_hash(units: Collection[str], word: str) -> set[str]:
    digits = word.lower().removeprefix(UNIT)
    if len(digits) < SHORTEST_HASH or len(digits) > SERIAL_HASH_DIGITS or not {*digits} <= HEX_DIGITS:
        return set()
    return {unit for unit in units if unit.rpartition(f"/{UNIT}")[2].startswith(digits)}


def _by_serial(units: Collection[str], word: str, makes: Callable[[], Mapping[str, str]]) -> set[str]:
    """Return the units with this serial number, given as it is or (by default) as its hash."""
    if not word or not units:
        return set()
    hashes = {folder: hash_serial(make, word) for folder, make in makes().items()}
    return {
        unit
        for unit in units
        if unit.rpartition(f"/{UNIT}")[2][:-1] in {slug(word), hashes.get(unit.split("/")[1])}
    }


def find_paths(paths: Collection[str], key: str) -> list[str]:
    """Return all entries that a KEY may name, sorted; an exact id, or a model's plain entry, matches only itself."""
    path = f"{ROOT}{key.strip('/')}{SUFFIX}" if not key.startswith(ROOT) else key
    for exact in (path, path.lower()):
        if exact in paths:
            return [exact]
    asked = [part for part in key.removeprefix(ROOT).removesuffix(SUFFIX).split("/") if part.strip()]
    if not asked:
        return []
    # Few of 100 000 paths contain the last word at all.
    low, slugged = asked[-1].lower(), slug(asked[-1])
    near = (path for path in paths if low in path or slugged in path)
    return sorted(path for path in near if _fits(id_of(path).split("/"), asked))


def _fits(parts: Sequence[str], asked: Sequence[str]) -> bool:
    """Return whether the words match an entry, from its make on, or from its model on."""
    return any(_fits_from(parts[start:], asked) for start in (0, 1))


def _fits_from(parts: Sequence[str], asked: Sequence[str]) -> bool:
    if len(asked) > len(parts) or not parts:
        return False
    *whole, last = asked
    if not all(_is(part, word) or _is_unit(part, word) for part, word in zip(parts, whole, strict=False)):
        return False
    part, is_variant = parts[len(whole)], parts[len(whole)] == parts[-1]
    # Make and model must be complete; what follows may be shortened, also the folder of a unit.
    if part.startswith(UNIT) and last.lower().startswith(UNIT):
        return part.startswith(last.lower())
    return part.startswith(last.lower()) if is_variant else _is(part, last)


def _is_unit(part: str, word: str) -> bool:
    """Return whether a word is the beginning of a unit's folder name: ``sn-0e25``."""
    return part.startswith(UNIT) and len(word) > len(UNIT) and part.startswith(word.lower())


def _is(part: str, word: str) -> bool:
    """Return whether a word names a part of a path, written as in the path or as in EXIF."""
    return part == word.lower() or part == slug(word)


def _suggestion(paths: Collection[str], key: str) -> str:
    words = [word for word in key.lower().split("/") if word]
    if not words:
        return ""
    names = sorted({"/".join(path.split("/", 3)[1:3]) for path in paths})
    by_model = {name.rpartition("/")[2]: name for name in names}
    close = _close("/".join(words[:2]), names, cutoff=0.5)
    close += [by_model[model] for model in _close(words[-1], [*by_model], cutoff=0.6)]
    near = list(dict.fromkeys(close))[:3]
    if near:
        return f"; nearest: {', '.join(near)}"
    return "; it holds no entry yet: 'calibrary registry add' puts one in" if not names else ""


def _close(word: str, names: list[str], *, cutoff: float) -> list[str]:
    """Return up to three names similar to the word, among those that share the most pairs of letters with it.

    difflib alone would take seconds for 100 000 names.
    """
    if len(names) > MOST_COMPARED:
        shared: list[int] = [0] * len(names)
        for pair in {word[at : at + 2] for at in range(max(1, len(word) - 1))}:
            shared = [*map(add, shared, map(contains, names, repeat(pair)))]
        names = [name for _, name in nlargest(MOST_COMPARED, zip(shared, names, strict=True))]
    return get_close_matches(word, names, n=3, cutoff=cutoff)
