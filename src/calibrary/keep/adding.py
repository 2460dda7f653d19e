"""Adding calibrations to a registry: read, keyed, held beside what stands there, checked, and only then written."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Final

from calibrary import parsers
from calibrary.calibration import Calibration, CameraKey, Grade
from calibrary.errors import InputError, MissingTagError, RegistryError
from calibrary.keep.admission import objections
from calibrary.keep.fields import FieldChange, differences
from calibrary.keep.keeper import Keeper, note_of
from calibrary.keep.operand import Reading, entry_file
from calibrary.parsers.image_names import is_image
from calibrary.parsers.imagery import SERIAL_HASH_DIGITS, hash_serial, read_metadata
from calibrary.registry.check import CheckFinding
from calibrary.registry.digest import digest
from calibrary.registry.entry import UNSTATED, Entry, Status
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.firmware import FirmwareRange
from calibrary.registry.writing import Written, identity

__all__ = ["Proposal", "Wish", "propose", "write_proposals"]

BY_HAND: Final = "numbers changed by hand"
OF_THE_ADDING: Final = ("tool", "date", "operator")
OF_THE_MODEL: Final = {Grade.DESIGN, Grade.DERIVED}
HEX: Final = frozenset("0123456789abcdef")


@dataclass(frozen=True, slots=True, kw_only=True)
class Wish:
    """What the user said of the entries to be.

    Attributes:
        key: puts what was said of the camera in the place of what the file says.
        firmware: of which firmware the entry shall be.
        notes: added to the file's own.
        reason: for the history, and for the approval.
        operator: who answers for it; git's user where it is None.
        approve: whether it shall be used at once.
        override_held: whether it may take the place of an entry that a person pinned.
    """

    key: Callable[[CameraKey], CameraKey] = lambda known: known
    firmware: FirmwareRange | None = None
    notes: tuple[str, ...] = ()
    reason: str | None = None
    operator: str | None = None
    approve: bool = False
    override_held: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """One entry as it would be written.

    Attributes:
        entry: what it would be.
        standing: what stands at its path, None for nothing or for what cannot be read.
        base: the id of the content that stands there; the write holds only while it is still this one.
        changes: field by field; everything of a new entry, nothing where all is there already.
        remarks: what a person should know before agreeing.
    """

    entry: Entry
    standing: Entry | None
    base: str | None
    changes: tuple[FieldChange, ...]
    remarks: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Found:
    """What a file holds of one camera, and what is to be said of it."""

    entry: Entry
    edited: bool = False
    remarks: tuple[str, ...] = ()


def propose(
    keeper: Keeper, path: Path, reading: Reading, wish: Wish
) -> tuple[tuple[Proposal, ...], tuple[CheckFinding, ...]]:
    """The entries that a file would become, and what the registry's check says of them.

    Args:
        keeper: of the registry.
        path: a calibration file of any format, an image, or an entry's YAML, with or without a digest.
        reading: answers to what the file leaves open, and which camera of several.
        wish: what the user said besides.

    Raises:
        InputError: it cannot be read, its camera is not known, or K is a guess.
        RegistryError: a person pinned the entry that stands there.
    """
    today = datetime.now(UTC).date().isoformat()
    operator = wish.operator or identity(keeper.registry.store)[0].name
    proposals = [
        _proposal(keeper, _as_wished(found, wish), wish, (operator, today))
        for found in _read(path, reading, wish)
    ]
    _refuse_same_place(proposals, path.name)
    due = [proposal.entry for proposal in proposals if proposal.changes]
    return tuple(proposals), objections(keeper, due) if due else ()


def write_proposals(
    keeper: Keeper, proposals: Sequence[Proposal], wish: Wish, *, source: Path | None = None
) -> Written:
    """Write them as one commit.

    Args:
        keeper: of the registry.
        proposals: as they were shown.
        wish: as it was said.
        source: the file they came from; where that is the entry in the work tree, edited by hand, the commit
            takes its place.

    Raises:
        EntryConflictError: somebody has changed one since it was shown; nothing was written.
        RegistryError: they cannot be written.
    """
    due = [proposal for proposal in proposals if proposal.changes]
    entries = [proposal.entry for proposal in due]
    verb = "Add" if all(proposal.base is None for proposal in due) else "Update"
    named = entries[0].id if len(entries) == 1 else f"{len(entries)} cameras"
    ending = ", approved" if wish.approve else ""
    note = note_of(f"{verb} {named}{ending}", entries, wish.reason)
    with _aside(keeper, source, due):
        return keeper.save([(proposal.entry, proposal.base) for proposal in due], note)


def _read(path: Path, reading: Reading, wish: Wish) -> Iterator[_Found]:
    if not path.exists():
        raise InputError("no such file", source=str(path))
    if not path.is_file():
        raise InputError("is no regular file, wanted one calibration file or image", source=str(path))
    if reading.format is None and (data := entry_file(path)) is not None:
        entry = parse_entry(data, path.name, require_digest=False)
        yield _Found(entry=_with_key(entry, wish), edited=b"\ndigest:" not in data)
        return
    try:
        calibrations = parsers.read(
            path, format=reading.format, image_size=reading.image_size, options=reading.options
        )
    except MissingTagError as error:
        if reading.image_size is None and "size" in error.message and "--image-size" not in error.message:
            raise MissingTagError(
                f"{error.message}; say --image-size WxH", source=error.source, place=error.place
            ) from None
        raise
    for calibration in _chosen(calibrations, reading.camera, path.name):
        yield _from_file(calibration, path, wish)


def _chosen(calibrations: Sequence[Calibration], camera: int | None, source: str) -> Sequence[Calibration]:
    if camera is None:
        return calibrations
    if not 1 <= camera <= len(calibrations):
        raise InputError(f"has no camera {camera}, it holds {len(calibrations)}", source=source)
    return calibrations[camera - 1 : camera]


def _from_file(calibration: Calibration, path: Path, wish: Wish) -> _Found:
    """An entry of what another program wrote; what only that program needs stays behind.

    A file's extras may hold anything: serial numbers, names of people and folders. None of them enters.
    """
    remarks = []
    if calibration.extras:
        names = ", ".join(sorted({name for name, _ in calibration.extras})[:6])
        remarks.append(f"left out, since nobody reviewed it: {names}")
    camera = calibration.camera
    if is_image(path):
        if camera.serial is not None and calibration.grade in OF_THE_MODEL:
            remarks.append(f"a K of grade {calibration.grade.value} is the model's, so no unit is named")
            camera = replace(camera, serial=None)
        if camera.firmware is None:
            camera = replace(camera, firmware=read_metadata(path).software)
    provenance = calibration.provenance
    with path.open("rb") as file:
        sha256 = provenance.sha256 or hashlib.file_digest(file, "sha256").hexdigest()
    provenance = replace(provenance, source=provenance.source or path.name, sha256=sha256)
    camera = wish.key(camera)
    _require_key(camera, path.name)
    provenance = replace(provenance, firmware=camera.firmware or provenance.firmware)
    whole = replace(
        calibration, camera=replace(camera, firmware=None), provenance=provenance, extras=()
    )
    try:
        return _Found(entry=Entry.of(whole), remarks=tuple(remarks))
    except InputError as error:
        raise type(error)(error.message, source=path.name, place=error.place) from None


def _with_key(entry: Entry, wish: Wish) -> Entry:
    camera = wish.key(entry.calibration.camera)
    if camera.serial is not None and not _is_hash(camera.serial):
        camera = replace(camera, serial=hash_serial(camera.make, camera.serial))
    provenance = entry.calibration.provenance
    if camera.firmware is not None:
        provenance = replace(provenance, firmware=camera.firmware)
    calibration = replace(
        entry.calibration, camera=replace(camera, firmware=None), provenance=provenance
    )
    return replace(entry, calibration=calibration)


def _is_hash(serial: str) -> bool:
    return len(serial) == SERIAL_HASH_DIGITS and set(serial) <= HEX


def _require_key(camera: CameraKey, source: str) -> None:
    missing = [name for name in ("make", "model") if not (getattr(camera, name) or "").strip()]
    if missing:
        flags = " ".join(f"--{name} NAME" for name in missing)
        raise InputError(
            f"does not say the camera's {' and '.join(missing)}, by which an entry is found; say {flags}",
            source=source,
        )


def _as_wished(found: _Found, wish: Wish) -> _Found:
    entry = found.entry
    calibration = replace(entry.calibration, notes=tuple(dict.fromkeys([*entry.notes, *wish.notes])))
    firmware = wish.firmware or entry.firmware
    return replace(found, entry=replace(entry, calibration=calibration, firmware=firmware))


def _proposal(keeper: Keeper, found: _Found, wish: Wish, adding: tuple[str, str]) -> Proposal:
    entry, remarks = found.entry, list(found.remarks)
    base = keeper.registry.snapshot().paths.get(entry.path)
    standing = None
    if base is not None:
        try:
            standing = parse_entry(keeper.registry.store.blob(base), entry.path)
        except InputError as error:
            remarks.append(f"what stands there cannot be read and is replaced: {error}")
    if standing is not None and standing.status is Status.HELD and not wish.override_held:
        why = f" ({standing.reason})" if standing.reason else ""
        raise RegistryError(
            f"{entry.id} is held{why}: a person pinned it; nothing was written. --override-held takes its place"
        )
    entry = _signed(_kept(entry, standing), standing, found.edited, adding)
    if standing is not None:
        as_it_was = replace(entry, status=standing.status, reason=standing.reason)
        if not differences(standing, as_it_was) and (not wish.approve or standing.is_usable):
            return Proposal(
                entry=standing, standing=standing, base=base, changes=(), remarks=tuple(remarks)
            )
    status = Status.APPROVED if wish.approve else Status.DRAFT
    entry = replace(entry, status=status, reason=wish.reason if wish.approve else None)
    if standing is not None and standing.is_usable and not wish.approve:
        remarks.append(
            f"it is {standing.status.value} now and becomes a draft, so no K of this camera is used until it is "
            "approved; --approve does that at once"
        )
    return Proposal(
        entry=entry,
        standing=standing,
        base=base,
        changes=differences(standing, entry),
        remarks=tuple(remarks),
    )


def _kept(entry: Entry, standing: Entry | None) -> Entry:
    """With what a registry knows of a camera and no calibration file says."""
    if standing is None:
        return entry
    extensions = {
        name: value
        for name, value in standing.extensions.items()
        if name.startswith(("x-", "camera/")) or (name.startswith("sensor/") and entry.sensor is None)
    }
    return replace(
        entry,
        aliases=entry.aliases or standing.aliases,
        sensor=entry.sensor or standing.sensor,
        tolerance=entry.tolerance if entry.tolerance is not None else standing.tolerance,
        supersedes=entry.supersedes or standing.supersedes,
        extensions={**extensions, **entry.extensions},
    )


def _signed(entry: Entry, standing: Entry | None, edited: bool, adding: tuple[str, str]) -> Entry:
    """With its provenance complete: what the file does not say of the making is said of the adding."""
    made = entry.calibration.provenance
    operator, today = adding
    if edited and standing is not None and made == standing.calibration.provenance:
        if digest(entry.calibration, entry.sensor) != digest(standing.calibration, standing.sensor):
            by_hand = (*(text for text in made.assumptions if text != BY_HAND), BY_HAND)
            made = replace(made, assumptions=by_hand, date=today, operator=operator)
    elif made == UNSTATED:
        made = replace(made, kind="by-hand")
    if standing is not None and made.sha256 is not None and made.sha256 == standing.calibration.provenance.sha256:
        # The same file added again: who added it, and when, has not changed by that.
        before = standing.calibration.provenance
        said = {name: getattr(before, name) for name in OF_THE_ADDING if getattr(made, name) is None}
        made = replace(made, **said)
    made = replace(
        made,
        tool=made.tool or f"calibrary {version('calibrary')}",
        date=made.date or today,
        operator=made.operator or operator,
    )
    return replace(entry, calibration=replace(entry.calibration, provenance=made))


def _refuse_same_place(proposals: Sequence[Proposal], source: str) -> None:
    seen: set[str] = set()
    for proposal in proposals:
        if proposal.entry.path in seen:
            raise InputError(
                f"holds several cameras that would all be {proposal.entry.id}; choose one with --camera N and say what "
                "tells it from the others: --sub-camera, --lens or --serial",
                source=source,
            )
        seen.add(proposal.entry.path)


@contextmanager
def _aside(keeper: Keeper, source: Path | None, due: Sequence[Proposal]) -> Iterator[None]:
    """Put the work tree's own file aside while the commit of what was edited in it takes its place."""
    store = keeper.registry.store
    own = next(
        (one for one in due if source is not None and source.resolve() == store.path / one.entry.path), None
    )
    if source is None or own is None or store.work_tree is None:
        yield
        return
    edited, kept = source.read_bytes(), store.git_dir / "calibrary-edited.yaml"
    kept.write_bytes(edited)
    if own.base is not None:
        source.write_bytes(store.blob(own.base))
    else:
        source.unlink()
    try:
        yield
    except BaseException:
        source.write_bytes(edited)
        raise
    finally:
        with suppress(OSError):
            kept.unlink()
