"""Files of which a key or value that states the lens was changed at random.

The key is spelled otherwise, or the value wrapped, put in quotes, or made longer. A mutant loses its lens if it is read
with another distortion than the original, and that is not unknown.
"""

from __future__ import annotations

import json
import random
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

from calibrary import parsers
from calibrary.calibration import Calibration
from calibrary.distortion import Distortion, exact
from calibrary.errors import InputError
from calibrary.parsers.format import Format
from calibrary.records import Json
from tests.parsers.cameras import SIZE
from tests.parsers.test_contract import FILES, sample

LOST = "LOST"
Mutant = tuple[str, bytes]

LENS_KEY = re.compile(
    r"[\w.\-]*(?:dist|radial|tangential|coef|(?<![a-z])[kp]_?\d\b|(?<![a-z])kc\b|(?<![A-Za-z])D\b)[\w.\-]*",
    re.IGNORECASE,
)
SPELLINGS: Sequence[Callable[[str], str]] = (
    str.upper,
    str.lower,
    lambda key: f"{key}_",
    lambda key: f"my_{key}",
    lambda key: f"{key}_px",
    lambda key: key.replace("_", "-") if "_" in key else f"lens_{key}",
    lambda key: key[:-1] + key[-1] * 2,
    lambda _: "distortion_vector",
    lambda _: "dist_coefs",
    lambda _: "radial",
)
VALUES: Sequence[Callable[[Json], Json]] = (
    lambda value: {"value": value},
    lambda value: {"k": {"values": value}},
    lambda value: [value],
    lambda value: " ".join(map(str, value)) if isinstance(value, list) else str(value),
    lambda value: [*value, 0.00123] if isinstance(value, list) else value,
)


def mutants_of(data: bytes, seed: int) -> Iterator[Mutant]:
    """Changed files without end, with what was changed."""
    rng = random.Random(seed)  # noqa: S311  mutants need no secret
    text = data.decode("utf-8", "strict")
    try:
        document: Json = json.loads(text)
    except ValueError:
        yield from _of_text(text, rng)
    else:
        yield from _of_json(document, rng)


def _of_json(document: Json, rng: random.Random) -> Iterator[Mutant]:
    places = [(holder, key) for holder, key in _keys(document) if LENS_KEY.fullmatch(key)]
    while places:
        holder, key = rng.choice(places)
        before = dict(holder)
        if rng.random() < 0.6:
            other = rng.choice(SPELLINGS)(key)
            changed = {other if name == key else name: value for name, value in before.items()}
            what = f"{key} → {other}"
        else:
            changed = {**before, key: rng.choice(VALUES)(before[key])}
            what = f"{key}: {str(before[key])[:30]} → {str(changed[key])[:40]}"
        holder.clear()
        holder.update(changed)
        yield what, json.dumps(document).encode()
        holder.clear()
        holder.update(before)


def _keys(value: Json) -> Iterator[tuple[dict[str, Json], str]]:
    if isinstance(value, dict):
        for key, item in value.items():
            yield value, key
            yield from _keys(item)
    elif isinstance(value, list):
        for item in value:
            yield from _keys(item)


def _of_text(text: str, rng: random.Random) -> Iterator[Mutant]:
    """A key of a line, or an element with its end."""
    found = [
        match
        for pattern in (
            r"</?([A-Za-z_][\w.\-]*)>",
            r"\b([A-Za-z_][\w.\-]*)\s*=",
            r"^[ \t\-]*[\"']?([A-Za-z_][\w.\-]*)[\"']?\s*:",
        )
        for match in re.finditer(pattern, text, re.MULTILINE)
        if LENS_KEY.fullmatch(match[1])
    ]
    while found:
        match = rng.choice(found)
        other = rng.choice(SPELLINGS)(match[1])
        if match[0].startswith("<"):
            changed = re.sub(rf"(</?){re.escape(match[1])}>", rf"\g<1>{other}>", text)
        else:
            changed = text[: match.start(1)] + other + text[match.end(1) :]
        yield f"{match[1]} → {other}", changed.encode()


def outcome(
    read: Callable[[bytes], Sequence[Calibration]], original: Sequence[Calibration], data: bytes
) -> str:
    """What became of a mutant: refused, the same, unknown, or lost."""
    try:
        found = read(data)
    except InputError:
        return "refused"
    said = [note for item in found for note in (*item.notes, *item.provenance.assumptions)]
    lenses = [item.distortion for item in found]
    if lenses == [item.distortion for item in original]:
        return "the same"
    if len(found) == len(original) and all(
        lens is None or _is_the_same(lens, item.distortion)
        for lens, item in zip(lenses, original, strict=True)
    ):
        if None not in lenses:
            return "the same"
        return "unknown, named" if any("not understood" in note for note in said) else "unknown"
    return LOST if len(found) == len(original) else "other cameras"


def _is_the_same(lens: Distortion, other: Distortion | None) -> bool:
    """Whether two lenses are equal, one perhaps with coefficients of a longer model that are zero."""
    return other is not None and (exact(lens, type(other)) == other or exact(other, type(lens)) == lens)


def _reader(
    record: Format | None, name: str, options: Mapping[str, str], beside: Mapping[str, bytes]
) -> Callable[[bytes], Sequence[Calibration]]:
    read = partial(parsers.decode, name=name, format=record, options=options, companion=beside.get)

    def sized(data: bytes) -> Sequence[Calibration]:
        try:
            return read(data)
        except InputError as error:
            if "image size" not in str(error):
                raise
            return read(data, image_size=SIZE)

    return sized


def mutated(count: int, *, seed: int, paths: Sequence[Path] = ()) -> Iterator[tuple[str, str, str]]:
    """What became of mutants: the file, what was changed, the outcome.

    Args:
        count: of mutants, in turn of the files.
        seed: of the changes.
        paths: files; without any, the small ones of all formats that state a lens.
    """
    usable = []
    for name, data, read in _files(paths):
        try:
            original = read(data)
            mutants = mutants_of(data, seed)
            next(mutants)
        except (InputError, UnicodeDecodeError, StopIteration):
            continue
        if any(item.distortion is not None and item.distortion.coefficients for item in original):
            usable.append((name, original, mutants, read))
    for index in range(count):
        name, original, mutants, read = usable[index % len(usable)]
        what, data = next(mutants)
        yield name, what, outcome(read, original, data)


def _files(paths: Sequence[Path]) -> Iterator[tuple[str, bytes, Callable[[bytes], Sequence[Calibration]]]]:
    if paths:
        for path in paths:
            yield path.name, path.read_bytes(), _reader(None, path.name, {}, {})
        return
    for each in FILES:
        record, name = each.values
        assert isinstance(record, Format)
        assert isinstance(name, str)
        one = sample(record, name)
        yield f"{record.name} {name}", one.data, _reader(record, name, one.options, one.beside)
