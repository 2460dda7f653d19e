"""Resolving a camera to its entry: by an image of it, by a KEY, or by what the user says of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import date
from functools import partial
from pathlib import Path
from typing import Final

from msgspec import Struct

from calibrary.calibration import Calibration, CameraKey, ImageSize
from calibrary.errors import AmbiguousCameraError, InputError, UnknownCameraError
from calibrary.jobs.exchange.identity import image_day, image_key
from calibrary.jobs.exchange.layers import AskedLayer, Layer, LayerKind, Layers
from calibrary.records import Record, replace
from calibrary.registry.approvals import approvals_of
from calibrary.registry.entry import Entry, Status
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.history import Approval, Recorded, recorded
from calibrary.registry.paths import find_path, find_paths, id_of, proposal_path, unit_folder
from calibrary.registry.resolution import RegistryIndex, RejectedEntry, Resolution
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.stored import StoredEntry
from calibrary.registry.writing import parsed

__all__ = ["Answer", "Question", "ResolutionReport", "answer", "asked", "resolution_report"]

SEVERAL: Final = 8


class Question(Struct, frozen=True, kw_only=True):
    """Which camera is meant.

    Attributes:
        key: the camera, as far as it is known.
        known_by: how that was found out, in words.
        day: of the image; None where there is none, or it states none.
    """

    key: CameraKey
    known_by: str
    day: date | None = None


class Answer(Struct, frozen=True, kw_only=True):
    """What registries say to a question.

    Attributes:
        question: what was asked.
        layers: that were asked.
        resolution: the entry that answers, or what the catalogue says; None where none does.
        near: entries that are near and do not answer, and why not.
    """

    question: Question
    layers: Layers
    resolution: Resolution | None
    near: tuple[RejectedEntry, ...]

    @property
    def layer(self) -> Layer:
        """That answers; the first one where none does."""
        return self.layers.layer_of(self.resolution)

    @property
    def entry(self) -> Entry | None:
        """The registry's entry that answers; None where none does, or the catalogue."""
        is_entry = self.resolution is not None and self.layer.kind is not LayerKind.CATALOGUE
        return self.resolution.entry if self.resolution is not None and is_entry else None


class UsedEntry(Record):
    """The entry that is used for a camera.

    Attributes:
        id: its longest KEY.
        path: of its file.
        label: what its keeper calls the unit.
        status: approved or held.
        reason: why it has this status.
        tolerance: how far a K of this camera may lie from this one, as a share of fx.
        image_size: (width, height) px that the entry itself counts in.
        recorded: who put this calibration into the registry, by the commit that did; None in a plain folder.
        approved: who approved it, and in which commits.
        override: why it is used although it contradicts what is known of its camera; None where it does not.
        proposal: path of what is proposed to take its place; None where nothing is.
    """

    id: str
    path: str
    status: Status
    reason: str | None
    tolerance: float | None
    image_size: ImageSize
    recorded: Recorded | None
    approved: tuple[Approval, ...] = ()
    override: str | None = None
    proposal: str | None = None
    label: str | None = None


class ResolutionReport(Record, tag_field="schema", tag="calibrary/resolution-1"):
    """What calibrary registry resolve --json prints.

    Attributes:
        registry: folder or address of the one that answers, "catalogue" for the one that ships; the first one's where
            none answers.
        commit: that was read; None for a folder without git, and the catalogue.
        layers: every registry that was asked, in their order.
        on: the day that entries had to be valid on.
        camera: that was asked for, as far as it is known.
        known_by: how the camera was found out.
        entry: None where none is used.
        calibration: at the camera's image size.
        why: the reason for the choice.
        disagreements: what registries that are asked later say against it.
        near: entries that are not used, or are less specific; the first few.
        warnings: what to know of the registries: that one cannot be reached, and how old its copy is.
    """

    registry: str
    commit: ObjectId | None
    layers: tuple[AskedLayer, ...]
    on: date | None
    camera: CameraKey
    known_by: str
    entry: UsedEntry | None
    calibration: Calibration | None
    why: str | None
    disagreements: tuple[str, ...]
    near: tuple[RejectedEntry, ...]
    warnings: tuple[str, ...]


def asked(layers: Layers, word: str | None, said: Callable[[CameraKey], CameraKey]) -> Question:
    """The camera that a word and flags mean.

    Args:
        layers: the registries; a KEY is looked up in their order.
        word: an image's file, or a KEY: of an entry, then with all that the entry states; of a model, as it is
            called in the registry or in EXIF. None where the flags say everything.
        said: replaces what is known by what the user states.

    Raises:
        InputError: the image cannot be read, or neither it nor the flags say make and model.
        RegistryError: the KEY is none, or of several models.
    """
    question = _meant(layers, word)
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


def answer(layers: Layers, question: Question, *, on: date | None) -> Answer:
    """What answers, and what is near.

    Args:
        layers: the registries, in the order in which they are asked.
        question: the camera.
        on: the day it is for; None asks nothing of an entry's validity.

    Raises:
        RegistryError: several entries fit equally well, and all are named; or one of them cannot be read.
    """
    found = layers.resolve(question.key, on=on)
    near = found.near if found is not None else layers.near(question.key, on=on)
    return Answer(question=question, layers=layers, resolution=found, near=near)


def resolution_report(found: Answer, *, on: date | None) -> ResolutionReport:
    """An answer as ``registry resolve --json`` prints it."""
    resolution, layer = found.resolution, found.layer
    return ResolutionReport(
        registry=layer.name,
        commit=layer.commit,
        layers=tuple(one.report() for one in found.layers.layers),
        on=on,
        camera=found.question.key,
        known_by=found.question.known_by,
        entry=_used(layer, resolution) if resolution is not None and found.entry is not None else None,
        calibration=resolution.calibration if resolution is not None else None,
        why=resolution.why if resolution is not None else None,
        disagreements=resolution.disagreements if resolution is not None else (),
        near=found.near,
        warnings=found.layers.warnings,
    )


def _used(layer: Layer, found: Resolution) -> UsedEntry:
    entry, put, snapshot = found.entry, None, layer.snapshot
    approved: tuple[Approval, ...] = ()
    if snapshot is not None and snapshot.repo is not None and snapshot.commit is not None:
        stored = StoredEntry(entry=entry, path=found.path, oid=None, commit=found.revision or snapshot.commit)
        put, approved = recorded(snapshot.repo, stored), approvals_of(snapshot.repo, stored)
    beside = proposal_path(found.path)
    return UsedEntry(
        id=id_of(found.path),
        path=found.path,
        status=entry.status,
        reason=entry.reason,
        tolerance=entry.tolerance,
        image_size=entry.calibration.intrinsics.image_size,
        recorded=put,
        approved=approved,
        override=entry.override,
        proposal=beside if snapshot is not None and beside in snapshot.proposed else None,
        label=entry.label,
    )


def _meant(layers: Layers, word: str | None) -> Question:
    if word is None:
        return Question(key=CameraKey(), known_by="what was said")
    path = Path(word)
    if path.is_file():
        from calibrary.parsers import is_image_file  # noqa: PLC0415  the formats, which KEYs do not need

        if not is_image_file(path):
            raise InputError(
                "is not an image; 'calibrary registry add FILE' takes a calibration file, and resolve an image of the "
                "camera, or its KEY",
                source=word,
            )
        found = image_key(path)
        return Question(key=found.key, known_by=f"the image: {found.why}", day=image_day(path))
    if path.suffix and _is_image(path):
        raise InputError("no such file", source=word)
    return Question(key=_of_word(layers, word), known_by=f"the KEY {word}")


def _is_image(path: Path) -> bool:
    from calibrary.parsers.image_names import is_image  # noqa: PLC0415  as above

    return is_image(path)


def _of_word(layers: Layers, word: str) -> CameraKey:
    """The camera that a KEY means in the first registry that has it; else by its make and model as EXIF writes them.

    Raises:
        RegistryError: the KEY is of several models, or of none; the message says what is nearly so called.
    """
    for layer in layers.layers:
        snapshot = layer.snapshot
        if snapshot is not None and (paths := snapshot.in_use(word)):
            return _of_paths(word, paths, partial(_entry, snapshot))
    make, _, rest = (part.strip() for part in word.partition("/"))
    model, _, variant = rest.partition("/")
    serial = variant.removeprefix("sn-").partition("/")[0] if variant.startswith("sn-") else None
    named = CameraKey(make=make, model=rest)
    for layer in layers.layers if make and rest else ():
        index = layer.index_for(named)
        if index.resolve(named) or index.near(named):
            return named
        part = CameraKey(make=make, model=model, serial=serial)
        if variant and isinstance(index := layer.index_for(part), RegistryIndex):
            found = index.candidates(part)
            if paths := find_paths(found, word):
                return _of_paths(word, paths, found.__getitem__)
    first = layers.layers[0]
    if first.snapshot is not None:
        # Nothing is so called; this says what nearly is.
        find_path(first.snapshot.paths, word)
    raise UnknownCameraError(
        f"{word}: no such camera in {', '.join(layer.name for layer in layers.layers)}; a published registry is asked "
        "by make and model, as in dji/fc6310r"
    )


def _of_paths(word: str, paths: Sequence[str], entry_at: Callable[[str], Entry]) -> CameraKey:
    """All that a single entry states; of several of a model or a unit, what they have in common."""
    models = {tuple(id_of(path).split("/")[:2]) for path in paths}
    if len(models) > 1:
        names = sorted("/".join(model) for model in models)
        more = f" and {len(names) - SEVERAL} more" if len(names) > SEVERAL else ""
        raise AmbiguousCameraError(
            f"{word} fits {len(names)} models: {', '.join(names[:SEVERAL])}{more}; name one of them"
        )
    first = entry_at(paths[0])
    camera = first.calibration.camera
    if len(paths) > 1:
        serial = camera.serial if len({unit_folder(path) for path in paths}) == 1 else None
        return CameraKey(make=camera.make, model=camera.model, serial=serial)
    firmware = first.firmware
    return replace(camera, firmware=(firmware.min or firmware.max) if firmware is not None else None)


def _entry(snapshot: Snapshot, path: str) -> Entry:
    return parsed(snapshot.read(path), path, require_digest=False)
