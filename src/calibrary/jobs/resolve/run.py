"""Resolution of a camera to its registry entry: by an image, by a KEY, or by the user's statements."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from datetime import date
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from calibrary.arguments import CameraLike
from calibrary.calibration import Calibration, CameraKey, ImageSize, Intrinsics
from calibrary.catalogue import identified, load_catalogue, overlay
from calibrary.errors import AmbiguousCameraError, InputError, UnknownCameraError, first_of
from calibrary.evidence.metadata import ImageMetadata
from calibrary.jobs.layers import AskedLayer, Layer, LayerKind, Layers
from calibrary.jobs.resolve import names_image
from calibrary.jobs.use import Allowed
from calibrary.pages.notebook import in_notebook
from calibrary.policy import FLEET, Policy
from calibrary.records import Json, Record, from_json, replace
from calibrary.registry.entry import Entry, Status
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.history import Approval, Recorded, approvals_of, recorded
from calibrary.registry.paths import PROPOSED, file_path, find_path, find_paths, id_of, unit_folder
from calibrary.registry.resolution import RegistryIndex, RejectedEntry, Resolution
from calibrary.registry.snapshot import Snapshot, StoredEntry

if TYPE_CHECKING:
    from calibrary.jobs.survey import Weighed

SEVERAL: Final = 8


class _Asked(NamedTuple):
    """The camera to resolve as far as it is known, how that was determined, the date of the image, and the image."""

    key: CameraKey
    known_by: str
    day: date | None = None
    metadata: ImageMetadata | None = None


class UsedEntry(Record):
    """The entry that is used for a camera.

    Attributes:
        id: its longest KEY.
        path: of its file.
        label: label of the unit.
        status: approved.
        reason: why it has this status.
        tolerance: largest allowed difference of a K of this camera from this one, as a fraction of fx.
        image_size: (width, height) px of the entry itself.
        recorded: who added this calibration to the registry, from the commit; None in a plain folder, and if the
            history was not asked for.
        approved: who approved it, and in which commits, if the history was asked for.
        override: why it is used although it contradicts what is known about its camera; None if it does not.
        proposal: KEY of what is proposed to replace it; None if nothing is.
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


class PossibleK(Record):
    """K of an entry at the size of an image, by one of the ways in which the image may have come from its frame.

    Attributes:
        intrinsics: K.
        steps: what was done to the frame, in words.
        assumptions: what is taken for granted.
    """

    intrinsics: Intrinsics
    steps: tuple[str, ...] = ()
    assumptions: tuple[str, ...] = ()


class FleetAnswer(Record, tag_field="schema", tag="calibrary/resolution-1"):
    """Answer of one or several registries for a camera; output of ``calibrary registry resolve --json``.

    Attributes:
        registry: folder or address of the registry with the entry, "catalogue" for the shipped catalogue; the
            first registry if none has one.
        commit: the commit that was read; None for a folder without git, and the catalogue.
        layers: all registries that were queried, in order.
        on: the date on which entries had to be valid.
        camera: the camera to resolve, as far as it is known.
        known_by: how the camera was determined.
        entry: the entry in use; None if there is none, or it is the catalogue's.
        calibration: at the camera's image size; None if no entry applies, or a solver may do nothing with its K.
        why: the reason for the choice.
        disagreements: what contradicts the K and is not believed, and registries with lower precedence.
        near: the first few entries that are not used or are less specific.
        warnings: on the registries: unreachable servers, and the age of copies.
        path: of the entry in its registry or in the catalogue.
        possible: K of an entry that may not be used, by each way in which it may be of the image.
        remedy: what to do if K may not be used, or only with care; None if there is nothing to do.
        allowed: what a solver may do with K, and why; None if no entry applies.

    >>> answer = calibrary.open_registry("fleet").resolve("survey/DJI_0001.JPG")
    >>> answer.status.value, answer.why
    ('approved', 'cameras/dji/fc6310r/5472x3648.yaml is of this model')
    """

    _unwritten = frozenset({"path", "allowed"})

    registry: str
    commit: ObjectId | None
    layers: tuple[AskedLayer, ...]
    on: date
    camera: CameraKey
    known_by: str
    entry: UsedEntry | None
    calibration: Calibration | None
    why: str | None
    disagreements: tuple[str, ...]
    near: tuple[RejectedEntry, ...]
    warnings: tuple[str, ...]
    path: str | None = None
    possible: tuple[PossibleK, ...] = ()
    remedy: str | None = None
    allowed: Allowed | None = None

    def __hash__(self) -> int:
        """Of what was asked, and where the answer lies; what was found has maps, which have none."""
        return hash((self.registry, self.commit, self.on, self.camera, self.path))

    @property
    def use(self) -> str | None:
        """What a solver may do with K: fixed, start or none; None if no entry applies."""
        return self.allowed.use.value if self.allowed is not None else None

    @property
    def use_reason(self) -> str | None:
        """Why."""
        return self.allowed.why if self.allowed is not None else None

    def _wire(self, document: dict[str, Json]) -> dict[str, Json]:
        return document | {"use": self.use, "use_reason": self.use_reason}

    @classmethod
    def _unwire(cls, document: dict[str, Json]) -> dict[str, Any]:
        use, why = document.pop("use", None), document.pop("use_reason", None)
        said = from_json(Allowed, {"use": use, "why": why}) if use is not None else None
        return document | {"allowed": said}

    @classmethod
    def _wire_schema(cls, schema: dict[str, Any], _defs: dict[str, Any]) -> dict[str, Any]:
        said = {
            "use": "what a solver may do with it: fixed, start or none; null if no entry applies",
            "use_reason": "why",
        }
        text = {"type": ["string", "null"]}
        schema["properties"] |= {name: text | {"description": words} for name, words in said.items()}
        schema["required"] += said
        return schema

    @property
    def status(self) -> Status | None:
        """Status of the entry: approved."""
        return self.entry.status if self.entry is not None else None

    def _repr_html_(self) -> str:
        """The answer and its K as HTML, for notebooks."""
        return in_notebook(self)


def resolved(
    layers: Layers,
    camera: str | Path | Calibration | CameraKey | None,
    *,
    stated: CameraLike | None = None,
    on: date | None = None,
    history: bool = False,
) -> FleetAnswer:
    """Resolve a camera to the entry that applies, and list similar entries.

    Args:
        layers: the registries, in order of precedence; a KEY is looked up in their order.
        camera: an image, the KEY of an entry, which then gives all its fields, or of a model as written in the registry
            or in EXIF; a calibration, or a camera key. None if ``stated`` says everything.
        stated: replaces known fields.
        on: day on which the entry must be valid; None for that of the image, else today.
        history: whether to look up who added and approved the entry; it takes longer than all else.

    Raises:
        InputError: the image cannot be read, or make and model are unknown.
        RegistryError: the KEY does not exist or matches several models, several entries fit equally well (all are
            named), or one of them cannot be read.
    """
    if camera is None or isinstance(camera, str | Path):
        word = str(camera) if camera is not None else None
        asked = _asked_by(layers, word)
        key = overlay(stated)(asked.key)
    else:
        word, asked = None, _Asked(CameraKey(), "what was said")
        key = overlay(stated)(camera.camera if isinstance(camera, Calibration) else camera)
    _refuse_nameless(key, word)
    day = on or asked.day or date.today()
    found = layers.resolve(key, on=day)
    near = found.near if found is not None else layers.near(key, on=day)
    layer = layers.layer_of(found)
    is_entry = found is not None and layer.kind is not LayerKind.CATALOGUE
    weighed = _weighed(found, asked.metadata, layer, key.image_size) if found is not None else None
    return FleetAnswer(
        registry=layer.name,
        commit=layer.commit,
        layers=tuple(one.report() for one in layers.layers),
        on=day,
        camera=key,
        known_by=asked.known_by,
        entry=_used(layer, found, history=history) if found is not None and is_entry else None,
        calibration=_of_camera(weighed.calibration, found)
        if weighed is not None and found is not None
        else None,
        why=found.why if found is not None else None,
        disagreements=(*(one.message for one in weighed.disbelieved), *found.disagreements)
        if found is not None and weighed is not None
        else (),
        near=near,
        warnings=layers.warnings,
        path=found.path if found is not None else None,
        possible=_possible(weighed) if weighed is not None and weighed.calibration is None else (),
        remedy=weighed.findings[0].remedy if weighed is not None and weighed.findings else None,
        allowed=weighed.use if weighed is not None else None,
    )


def _possible(weighed: Weighed) -> tuple[PossibleK, ...]:
    return tuple(
        PossibleK(
            intrinsics=one.calibration.intrinsics, steps=one.reading.steps, assumptions=one.reading.assumes
        )
        for one in weighed.ways
    )


def _refuse_nameless(key: CameraKey, word: str | None) -> None:
    """Refuse a camera without make or model.

    Raises:
        InputError: it has none.
    """
    missing = [name for name in ("make", "model") if not (getattr(key, name) or "").strip()]
    if missing:
        flags = " ".join(f"--{name} NAME" for name in missing)
        raise InputError(
            f"the camera's {' and '.join(missing)} {'is' if len(missing) == 1 else 'are'} not known, and a registry "
            f"finds cameras by them; state it with {flags}",
            source=word,
        )


MOST_ALONE: Final = 256
_alone: dict[tuple[int, str, ImageSize | None], tuple[Entry, Policy, Weighed]] = {}


def _weighed(
    found: Resolution, metadata: ImageMetadata | None, layer: Layer, size: ImageSize | None
) -> Weighed:
    """The entry among all that the image states of its camera; without an image, by its size alone.

    The entries of a state stay in memory, and a program resolves camera after camera: what is alone is weighed once.
    """
    policy, at = _policy(layer), (id(found.entry), found.path, size)
    known = _alone.get(at) if metadata is None else None
    if known is not None and known[0] is found.entry and known[1] is policy:
        return known[2]
    from calibrary.jobs.survey import Survey, of_entry, of_images  # noqa: PLC0415  for those that answer

    entry = of_entry(found, policy, rests_on="catalogue" if layer.kind is LayerKind.CATALOGUE else None)
    if metadata is None:
        alone = ImageMetadata(size=size or entry.calibration.intrinsics.image_size)
        weighed = Survey(alone, [entry], policy).weigh(entry)
        if len(_alone) >= MOST_ALONE:
            _alone.clear()
        _alone[at] = (found.entry, policy, weighed)
        return weighed
    # An answer to a KEY needs no readers of images.
    from calibrary.jobs.extract.judging import state_of_image  # noqa: PLC0415  the reason above

    camera = found.calibration.camera
    state, evidence = state_of_image(metadata, policy)
    claims = [entry, *of_images(evidence, camera, policy)]
    return Survey(metadata, claims, policy, original=state.original).weigh(entry)


def _of_camera(calibration: Calibration | None, found: Resolution) -> Calibration | None:
    return replace(calibration, camera=found.calibration.camera) if calibration is not None else None


def _policy(layer: Layer) -> Policy:
    return layer.snapshot.policy if layer.snapshot is not None else FLEET


def _used(layer: Layer, found: Resolution, *, history: bool) -> UsedEntry:
    entry, put, snapshot = found.entry, None, layer.snapshot
    approved: tuple[Approval, ...] = ()
    if history and snapshot is not None and snapshot.repo is not None and snapshot.commit is not None:
        standing = None if found.is_of_its_day else snapshot.standing(found.path)
        stored = StoredEntry(
            entry=entry, path=found.path, oid=None, commit=snapshot.commit, standing=standing
        )
        put, approved = recorded(snapshot.repo, stored), approvals_of(snapshot.repo, stored)
    waits = snapshot is not None and snapshot.standing(found.path).is_proposed
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
        proposal=f"{id_of(found.path)}{PROPOSED}" if waits else None,
        label=entry.label,
    )


def _asked_by(layers: Layers, word: str | None) -> _Asked:
    if word is None:
        return _Asked(key=CameraKey(), known_by="what was said")
    if names_image(word):
        if not os.path.isfile(word):  # noqa: PTH113  as there
            raise InputError("no such file", source=word)
        from calibrary.parsers.imagery import read_metadata  # noqa: PLC0415  a KEY needs no readers of images

        metadata = read_metadata(Path(word))
        found = identified(metadata, load_catalogue())
        return _Asked(found.key, f"the image: {found.why}", _image_day(Path(word)), metadata)
    if os.path.isfile(word):  # noqa: PTH113  as there
        raise InputError(
            "is not an image; 'calibrary registry add FILE' takes a calibration file, and resolve an image of the "
            "camera, or its KEY",
            source=word,
        )
    return _Asked(key=_of_word(layers, word), known_by=f"the KEY {word}")


def _image_day(path: Path) -> date | None:
    """The date of an image by the camera's clock, on which an entry must be valid.

    None if the image states no date or cannot be read; the reading of its metadata reports the error.
    """
    from calibrary.parsers.imagery.taken import taken_on  # noqa: PLC0415  as in _asked_by

    try:
        return taken_on(path)
    except (InputError, OSError):
        return None


def _of_word(layers: Layers, word: str) -> CameraKey:
    """The camera of a KEY in the first registry that has it; else by make and model as written in EXIF.

    Raises:
        RegistryError: the KEY matches several models or none; the message lists similar names.
    """
    for layer in layers.layers:
        snapshot = layer.snapshot
        if snapshot is not None and (matching := snapshot.matching(word)):
            # Of what is only proposed the camera is known, and that there is no K to use.
            return _of_paths(word, [*map(file_path, matching)], partial(_entry, snapshot))
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
        # No entry has this name; raise the error that lists similar ones.
        find_path(first.snapshot.cameras, word)
    raise UnknownCameraError(
        f"{word}: no such camera in {', '.join(layer.name for layer in layers.layers)}; a published registry is asked "
        "with an image, or by make and model, as in dji/fc6310r; a unit by --make, --model and --serial as in EXIF"
    )


def _of_paths(word: str, paths: Sequence[str], entry_at: Callable[[str], Entry]) -> CameraKey:
    """The camera key of a single entry; for several entries of a model or unit, the fields they have in common."""
    models = {tuple(id_of(path).split("/")[:2]) for path in paths}
    if len(models) > 1:
        names = sorted("/".join(model) for model in models)
        raise AmbiguousCameraError(
            f"{word} fits {len(names)} models: {first_of(names, SEVERAL)}; name one of them"
        )
    first = entry_at(paths[0])
    camera = first.calibration.camera
    if len(paths) > 1:
        serial = camera.serial if len({unit_folder(path) for path in paths}) == 1 else None
        return CameraKey(make=camera.make, model=camera.model, serial=serial)
    firmware = first.firmware
    return replace(camera, firmware=(firmware.min or firmware.max) if firmware is not None else None)


def _entry(snapshot: Snapshot, path: str) -> Entry:
    if snapshot.repo is not None:
        # The entries of a model that was asked for stay in memory, for a KEY as for an image.
        make, model, variant, *_ = id_of(path).split("/")
        serial = variant.removeprefix("sn-") if variant.startswith("sn-") else None
        key = CameraKey(make=make, model=model, serial=serial)
        if (entry := snapshot.index_for(key).candidates(key).get(path)) is not None:
            return entry
    return snapshot.entry(path)
