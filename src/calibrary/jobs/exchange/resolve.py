"""Resolving a camera to its entry: by an image of it, by a KEY, or by what the user says of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import Final

from calibrary.calibration import CameraKey
from calibrary.errors import InputError, RegistryError
from calibrary.jobs.exchange.identity import image_key
from calibrary.parsers.image_names import is_image
from calibrary.records import Json, replace, to_json
from calibrary.registry.entry import Entry
from calibrary.registry.history import recorded, recorded_json
from calibrary.registry.paths import find_path, find_paths, id_of
from calibrary.registry.resolution import RegistryIndex, RejectedEntry, Resolution
from calibrary.registry.snapshot import Snapshot, StoredEntry
from calibrary.registry.writing import parsed

__all__ = ["Answer", "Question", "answer", "answer_json", "asked"]

SEVERAL: Final = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """Which camera is meant.

    Attributes:
        key: the camera, as far as it is known.
        known_by: how that was found out, in words.
        index: the entries to ask, where finding out took listing them.
    """

    key: CameraKey
    known_by: str
    index: RegistryIndex | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What a registry says to a question.

    Attributes:
        question: what was asked.
        resolution: the entry that answers; None where none does.
        near: entries that are near and do not answer, and why not.
    """

    question: Question
    resolution: Resolution | None
    near: tuple[RejectedEntry, ...]


def asked(snapshot: Snapshot, word: str | None, said: Callable[[CameraKey], CameraKey]) -> Question:
    """The camera that a word and flags mean.

    Args:
        snapshot: of the registry.
        word: an image's file, or a KEY: of an entry, then with all that the entry states; of a model, as it is
            called in the registry or in EXIF. None where the flags say everything.
        said: puts what was said in the place of what is known.

    Raises:
        InputError: the image cannot be read, or neither it nor the flags say make and model.
        RegistryError: the KEY is none, or of several models.
    """
    question = _meant(snapshot, word)
    key = said(question.key)
    missing = [name for name in ("make", "model") if not (getattr(key, name) or "").strip()]
    if missing:
        flags = " ".join(f"--{name} NAME" for name in missing)
        raise InputError(
            f"the camera's {' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} not known, and a registry "
            f"finds cameras by them; state it with {flags}",
            source=word,
        )
    return replace(question, key=key)


def answer(snapshot: Snapshot, question: Question, *, on: date | None) -> Answer:
    """What answers, and what is near.

    Args:
        snapshot: of the registry.
        question: the camera.
        on: the day it is for; None asks nothing of an entry's validity.

    Raises:
        RegistryError: several entries fit equally well, and all are named; or one of them cannot be read.
    """
    index = question.index or snapshot.index_for(question.key)
    resolution = index.resolve(question.key, on=on)
    near = resolution.near if resolution is not None else index.near(question.key, on=on)
    return Answer(question=question, resolution=resolution, near=near)


def answer_json(snapshot: Snapshot, found: Answer, *, on: date | None) -> dict[str, Json]:
    """The JSON form of an answer (schemas/resolution-1.schema.json)."""
    resolution = found.resolution
    near: list[Json] = [{"path": item.path, "reason": item.reason} for item in found.near]
    document: dict[str, Json] = {
        "schema": "calibrary/resolution-1",
        "registry": str(snapshot.place),
        "commit": snapshot.commit,
        "on": on.isoformat() if on is not None else None,
        "camera": to_json(found.question.key),
        "known_by": found.question.known_by,
        "entry": None,
        "calibration": None,
        "why": None,
        "near": near,
    }
    if resolution is not None:
        entry = resolution.entry
        document["entry"] = {
            "id": id_of(resolution.path),
            "path": resolution.path,
            "status": entry.status.value,
            "reason": entry.reason,
            "tolerance": entry.tolerance,
            "image_size": list(entry.calibration.intrinsics.image_size),
            "recorded": _recorded(snapshot, resolution),
        }
        document["calibration"] = to_json(resolution.calibration)
        document["why"] = resolution.why
    return document


def _recorded(snapshot: Snapshot, found: Resolution) -> dict[str, Json] | None:
    if snapshot.repo is None or snapshot.commit is None:
        return None
    stored = StoredEntry(entry=found.entry, path=found.path, oid=None, commit=snapshot.commit)
    return recorded_json(recorded(snapshot.repo, stored))


def _meant(snapshot: Snapshot, word: str | None) -> Question:
    if word is None:
        return Question(key=CameraKey(), known_by="what was said")
    path = Path(word)
    if path.is_file():
        if not is_image(path):
            raise InputError(
                "is not an image; 'calibrary registry add FILE' takes a calibration file, and resolve an image of the "
                "camera, or its KEY",
                source=word,
            )
        told = image_key(path)
        return Question(key=told.key, known_by=f"the image: {told.why}")
    if is_image(path):
        raise InputError("no such file", source=word)
    return _of_key(snapshot, word)


def _of_key(snapshot: Snapshot, word: str) -> Question:
    index = snapshot.index()
    paths = find_paths(index.paths, word)
    if not paths:
        return _by_name(index, word)
    models = {tuple(id_of(path).split("/")[:2]) for path in paths}
    if len(models) > 1:
        names = sorted("/".join(model) for model in models)
        more = f" and {len(names) - SEVERAL} more" if len(names) > SEVERAL else ""
        raise RegistryError(
            f"{word} fits {len(names)} models: {', '.join(names[:SEVERAL])}{more}; name one of them"
        )
    return Question(key=_stated(snapshot, paths), known_by=f"the KEY {word}", index=index)


def _stated(snapshot: Snapshot, paths: Sequence[str]) -> CameraKey:
    """All that a single entry states; of several of a model, what they have in common."""
    first = _entry(snapshot, paths[0])
    camera = first.calibration.camera
    if len(paths) > 1:
        return CameraKey(make=camera.make, model=camera.model)
    firmware = first.firmware
    return replace(camera, firmware=(firmware.min or firmware.max) if firmware is not None else None)


def _by_name(index: RegistryIndex, word: str) -> Question:
    """Make and model as EXIF writes them: an entry may know them as another name of its camera."""
    make, _, model = (part.strip() for part in word.partition("/"))
    key = CameraKey(make=make, model=model)
    if not make or not model or not (index.resolve(key) or index.near(key)):
        # Nothing is so called; this says what nearly is.
        find_path(index.paths, word)
    return Question(key=key, known_by=f"the KEY {word}", index=index)


def _entry(snapshot: Snapshot, path: str) -> Entry:
    return parsed(snapshot.read(path), path, require_digest=False)
