"""What is added to a registry: a file of any format, an image, an entry; a folder of these, the catalogue.

Of a folder and of the catalogue, one commit or none is made, in which what cannot be added is told and does not hold up
the rest.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final

from msgspec import Struct

from calibrary import parsers
from calibrary.admission import refuse_implausible
from calibrary.arguments import Reading, Stated, Terms
from calibrary.calibration import Calibration, CameraKey, Grade
from calibrary.errors import CalibraryError, InputError, RegistryError
from calibrary.evidence.identity import firmware
from calibrary.jobs.files import choose, read_file
from calibrary.jobs.fleet import Details
from calibrary.jobs.layers.catalogue_entries import KIND, catalogue_entries
from calibrary.jobs.survey.known import contradictions
from calibrary.parsers.files import sha256_of
from calibrary.parsers.format import NOT_UNDERSTOOD
from calibrary.parsers.imagery import read_metadata
from calibrary.progress import log
from calibrary.records import replace
from calibrary.registry.entry import UNSTATED, Entry, Status, Validity, digest
from calibrary.registry.entry_yaml import entry_file, entry_yaml, parse_entry
from calibrary.registry.fields import differences
from calibrary.registry.paths import proposed_name
from calibrary.registry.proposals import (
    AddedSource,
    Fate,
    Proposals,
    checked,
    judged,
    propose,
)
from calibrary.registry.registry import Registry
from calibrary.registry.snapshot import Snapshot
from calibrary.registry.stating import Change
from calibrary.validation import Severity

OPTIONAL_TEXTS: Final = ("sub_camera", "lens", "capture_mode", "firmware")
OF_THE_MODEL: Final = {Grade.DESIGN, Grade.DERIVED}
SERIAL_IN_NAME: Final = re.compile(r"(?i)\b(SN|serial)(?:[-_ ][0-9A-Z]*\d{3}|\d{4})[0-9A-Z]*")
"""Serial number in a file name, such as ZED's ``SN12345678.conf``."""
SKIPPED_FOLDERS: Final = frozenset({".git"})


class Said(Struct, frozen=True, kw_only=True):
    """What the user says of the entries to add.

    Attributes:
        reading: settings for the files, and which camera of several.
        camera: replaces fields of a file's camera by those that the user states.
        stated: how it was calibrated.
        details: what the entry states besides.
        terms: on what terms the registry changes.
    """

    reading: Reading
    camera: Callable[[CameraKey], CameraKey]
    stated: Stated
    details: Details
    terms: Terms

    @property
    def validity(self) -> Validity | None:
        """Days of images that the entry applies to; None keeps those of an entry's file."""
        return Validity.between(self.terms.valid_from, self.terms.valid_until)


def add_file(registry: Registry, path: Path, said: Said) -> Proposals:
    """Make the entries of a file, compare them with the current ones and check them; nothing is written.

    Args:
        registry: to add to.
        path: a calibration file of any format, an image, or an entry's YAML, with or without a digest.
        said: what the file does not state.

    Raises:
        InputError: the file cannot be read, its camera is unknown, or K was not measured or is implausible.
    """
    if not path.exists():
        raise InputError("no such file", source=str(path))
    if not path.is_file():
        raise InputError("is not a regular file, expected one calibration file or image", source=str(path))
    data = entry_file(path) if said.reading.format is None else None
    if data is not None:
        found = [_from_entry(parse_entry(data, path.name, require_digest=False), said)]
    else:
        source = _Source.of(path)
        calibrations = read_file(path, said.reading)
        if said.reading.camera is not None:
            calibrations = [choose(calibrations, said.reading.camera, source=path.name)]
        if not said.terms.force:
            refuse_implausible(calibrations, path.name)
        found = [_from_calibration(one, source, said) for one in calibrations]
    _refuse_same_path([entry for entry, _ in found], path.name)
    proposals = propose(
        registry.branch(said.terms.branch),
        [entry for entry, _ in found],
        said.terms,
        edited=data is not None and b"\ndigest:" not in data,
        written=data,
    )
    items = [
        replace(one, warnings=(*warnings, *one.warnings)) if warnings else one
        for one, (_, warnings) in zip(proposals.items, found, strict=True)
    ]
    return replace(proposals, items=tuple(items))


def add_folder(
    registry: Registry, folder: Path, said: Said, *, progress: Callable[[int, int], None] | None = None
) -> Proposals:
    """Make the entries of all calibration files in a folder; nothing is written.

    Args:
        registry: to add to.
        folder: read with all sub-folders; links to folders are not followed, and images are skipped, because a
            folder of images is a flight, not a set of calibrations.
        said: what the files do not state.
        progress: called with the number of files done and the total.

    Raises:
        RegistryError: the folder cannot be read. A file that cannot be added is one of the sources of the result.
    """
    files = list(_files(folder))
    sources: list[AddedSource] = []
    due: dict[str, tuple[Change, str]] = {}
    for at, path in enumerate(files, start=1):
        for one, change in _of_file(registry, path, path.relative_to(folder).as_posix(), said):
            sources.append(one if change is None else _taken_in(due, one, change))
        if progress is not None:
            progress(at, len(files))
    name = folder.resolve().name or "a folder"
    proposed = [change for change, _ in due.values()]
    snapshot, what = registry.branch(said.terms.branch), f"the calibrations of {name}"
    return _without_bad(snapshot, what, sources, proposed, said.terms.override)


def add_catalogue(registry: Registry, terms: Terms) -> Proposals:
    """Make a draft for every camera of the built-in catalogue for which K can be derived; nothing is written.

    An earlier entry from the catalogue that is still a draft is updated; any other entry stays unchanged.
    """
    entries, left = catalogue_entries()
    snapshot = registry.branch(terms.branch)
    sources = [AddedSource(source=camera.title, fate=Fate.LEFT, reason=camera.reason) for camera in left]
    due = []
    for entry in entries:
        is_there, current = entry.path in snapshot.cameras, _readable(snapshot, entry.path)
        fate, reason = _fate(entry, current) if is_there else (Fate.NEW, None)
        source = entry.calibration.provenance.tag or entry.id
        sources.append(AddedSource(source=source, fate=fate, entry=entry.id, reason=reason))
        if fate in {Fate.NEW, Fate.CHANGED}:
            due.append(
                Change(
                    action="add",
                    before=current,
                    after=entry,
                    data=entry_yaml(entry),
                    base=snapshot.cameras.get(entry.path),
                    fields=differences(current, entry),
                )
            )
    return _without_bad(snapshot, "the catalogue of known cameras", sources, due)


def _files(folder: Path) -> Iterator[Path]:
    def refuse(error: OSError) -> None:
        raise RegistryError(f"{error.filename}: cannot be read: {error.strerror}") from None

    for here, folders, names in os.walk(folder, onerror=refuse):
        folders[:] = sorted(name for name in folders if name not in SKIPPED_FOLDERS)
        for name in sorted(names):
            path = Path(here, name)
            if not name.startswith(".") and path.is_file() and not parsers.is_image_file(path):
                yield path


def _of_file(
    registry: Registry, path: Path, source: str, said: Said
) -> Iterator[tuple[AddedSource, Change | None]]:
    try:
        proposals = add_file(registry, path, said)
    except CalibraryError as error:
        log.info("not added: %s", error)
        failure = str(error).removeprefix(f"{path.name}: ").removeprefix(f"{path}: ")
        yield AddedSource(source=source, fate=Fate.FAILED, reason=failure), None
        return
    for one in proposals.items:
        fate = Fate.SAME if not one.fields else Fate.NEW if one.is_new else Fate.CHANGED
        reason = "; ".join((*_moved(one), *one.warnings)) or None
        yield AddedSource(source=source, fate=fate, entry=one.id, reason=reason), one


def _moved(one: Change) -> Iterator[str]:
    """Describe how far K moved: the word "changed" alone is no basis for a decision."""
    if one.before is not None and one.fields:
        before, after = (each.calibration.intrinsics for each in (one.before, one.after))
        if before != after:
            yield f"fx {before.fx:.6g} → {after.fx:.6g} px ({after.fx / before.fx - 1.0:+.2%})"


def _taken_in(due: dict[str, tuple[Change, str]], one: AddedSource, change: Change) -> AddedSource:
    """Add a change to ``due``; a second file of the same camera is ignored if equal and fails if different."""
    if one.fate is Fate.SAME:
        return one
    first, source = due.setdefault(change.path, (change, one.source))
    if first is change:
        return one
    if _numbers(first.after) == _numbers(change.after):
        return replace(one, fate=Fate.SAME, reason=f"the same numbers as in {source}")
    reason = (
        f"{source} has other numbers for the same camera; add the right one by itself, or distinguish "
        "the two cameras with --lens, --sub-camera or --serial"
    )
    return replace(one, fate=Fate.FAILED, reason=reason)


def _readable(snapshot: Snapshot, path: str) -> Entry | None:
    try:
        stored = snapshot.at(proposed_name(path)) or snapshot.at(path)
    except CalibraryError:
        return None
    return stored.entry if stored is not None else None


def _fate(entry: Entry, current: Entry | None) -> tuple[Fate, str | None]:
    if current is None:
        return Fate.LEFT, "the current entry cannot be read: 'calibrary registry check' gives the reason"
    made = current.calibration.provenance
    if made.kind != KIND:
        grade = current.calibration.grade.value
        return Fate.LEFT, f"there is already an entry of grade {grade}, {made.kind}"
    if _of_catalogue(entry) == _of_catalogue(current):
        return Fate.SAME, None
    if current.status is not Status.DRAFT:
        return Fate.LEFT, f"it is {current.status.value}; the catalogue has changed since"
    return Fate.CHANGED, None


def _numbers(entry: Entry) -> str:
    return digest(entry.calibration, entry.sensor, entry.rig)


def _of_catalogue(entry: Entry) -> tuple[object, ...]:
    """The parts of an entry that come from the catalogue, independent of the program version that wrote it."""
    return _numbers(entry), entry.aliases, entry.tolerance, entry.notes


def _without_bad(
    snapshot: Snapshot,
    what: str,
    sources: Sequence[AddedSource],
    proposed: Sequence[Change],
    override: str | None = None,
) -> Proposals:
    """Leave out the entries that fail a check, so that one bad file does not hold up the others."""
    looked = checked(snapshot, proposed)
    found = looked.findings
    errors: dict[str, str] = {}
    for finding in judged(snapshot, looked, contradictions, override).findings:
        if finding.severity is Severity.ERROR:
            errors.setdefault(finding.place or "", finding.message)
    bad = {one.id: errors[one.path] for one in proposed if one.path in errors}
    good = tuple(one for one in proposed if one.path not in errors)
    return Proposals(
        items=good,
        findings=tuple(one for one in found if one.severity is not Severity.ERROR),
        title=f"Import {what}: {len(good)} {'entry' if len(good) == 1 else 'entries'}",
        sources=tuple(
            replace(one, fate=Fate.FAILED, reason=bad[one.entry])
            if one.entry in bad and one.fate in {Fate.NEW, Fate.CHANGED}
            else one
            for one in sources
        ),
    )


class _Source(Struct, frozen=True, kw_only=True):
    """A file with calibrations."""

    name: str
    sha256: str
    is_image: bool
    software: str | None

    @classmethod
    def of(cls, path: Path) -> _Source:
        image = parsers.is_image_file(path)
        software = firmware(read_metadata(path)) if image else None
        return cls(name=path.name, sha256=sha256_of(path), is_image=image, software=software)


def _from_calibration(calibration: Calibration, source: _Source, said: Said) -> tuple[Entry, tuple[str, ...]]:
    """Make an entry from another program's calibration, without data that only that program needs.

    A file's extras may contain serial numbers and names of people or folders, so none of them is imported.
    """
    warnings = []
    stated = dict(calibration.extras).get(NOT_UNDERSTOOD)
    if stated is not None:
        raise InputError(
            f"the file states a distortion that was not understood, {stated}; an entry of K alone would lose it: state "
            "it in the format's own words",
            source=source.name,
        )
    if calibration.extras:
        names = ", ".join(sorted({name for name, _ in calibration.extras})[:6])
        warnings.append(f"fields of the file that only its program uses stay out of the entry: {names}")
    camera = calibration.camera
    if source.is_image:
        if camera.serial is not None and calibration.grade in OF_THE_MODEL:
            warnings.append(
                f"a K of grade {calibration.grade.value} is of the model, so no serial number is stored"
            )
            camera = replace(camera, serial=None)
        if camera.firmware is None and source.software is not None:
            camera = replace(camera, firmware=source.software)
    camera = _without_empty(said.camera(camera))
    _require_key(camera, source.name)
    if calibration.camera.model or calibration.extras:
        warnings += _of_another(calibration, camera)
    if camera.sub_camera and camera.sub_camera == calibration.camera.sub_camera and not source.is_image:
        warnings.append(
            f"the file states the sub-camera {camera.sub_camera!r:.80}, which becomes part of the key; where images do "
            "not state it, or it contains a serial number, set --sub-camera NAME, or --sub-camera '' for none"
        )
    made = calibration.provenance
    warnings += said.stated.warnings(made)
    named = replace(
        said.stated.of(made),
        source=SERIAL_IN_NAME.sub(r"\1…", made.source or source.name),
        sha256=made.sha256 or source.sha256,
        firmware=camera.firmware or made.firmware,
    )
    size = calibration.intrinsics.image_size
    try:
        return Entry(
            calibration=replace(
                calibration,
                camera=replace(camera, firmware=None, image_size=size),
                provenance=named,
                notes=_notes(calibration, said),
                extras=(),
            ),
            firmware=said.details.firmware_range,
            validity=said.validity,
            label=said.details.label,
            tags=tuple(said.details.tags),
        ), tuple(warnings)
    except InputError as error:
        raise type(error)(error.message, source=source.name, place=error.place) from None


def _from_entry(entry: Entry, said: Said) -> tuple[Entry, tuple[str, ...]]:
    """Make an entry from an entry's file, which may have been edited by hand."""
    camera = _without_empty(said.camera(entry.calibration.camera))
    made = entry.calibration.provenance
    warnings = tuple(said.stated.warnings(made))
    if made == UNSTATED:
        made = replace(made, kind="by-hand")
    made = said.stated.of(made)
    if camera.firmware is not None:
        made = replace(made, firmware=camera.firmware)
    calibration = replace(
        entry.calibration,
        camera=replace(camera, firmware=None),
        provenance=made,
        notes=_notes(entry.calibration, said),
    )
    firmware, validity = said.details.firmware_range or entry.firmware, said.validity or entry.validity
    named = replace(entry, label=said.details.label or entry.label, tags=(*entry.tags, *said.details.tags))
    return replace(named, calibration=calibration, firmware=firmware, validity=validity), warnings


def _of_another(calibration: Calibration, camera: CameraKey) -> Iterator[str]:
    """Warning on a file that names another camera than the one that it is added as."""
    from calibrary.jobs.survey.limits import foreign  # noqa: PLC0415  most files name none

    another = foreign(calibration, replace(camera, sub_camera=None, serial=None))
    if another is not None:
        yield f"the file names another camera: {another.replace('these images are', 'it is added as one')}"


def _notes(calibration: Calibration, said: Said) -> tuple[str, ...]:
    return tuple(dict.fromkeys([*calibration.notes, *said.details.notes]))


def _without_empty(camera: CameraKey) -> CameraKey:
    """The key without the fields that the user set to empty text."""
    empty = {name: None for name in OPTIONAL_TEXTS if getattr(camera, name) == ""}
    return replace(camera, **empty) if empty else camera


def _require_key(camera: CameraKey, source: str) -> None:
    missing = [name for name in ("make", "model") if not (getattr(camera, name) or "").strip()]
    if missing:
        flags = " ".join(f"--{name} NAME" for name in missing)
        raise InputError(
            f"does not state the camera's {' and '.join(missing)}, by which an entry is found; state it with {flags}",
            source=source,
        )


def _refuse_same_path(entries: Sequence[Entry], source: str) -> None:
    seen: set[str] = set()
    for entry in entries:
        if entry.path in seen:
            raise InputError(
                f"contains several cameras that would all be {entry.id}; choose one with --camera N and "
                "distinguish it from the others with --sub-camera, --lens or --serial",
                source=source,
            )
        seen.add(entry.path)
