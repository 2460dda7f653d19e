"""Adding files to a registry: a calibration of any format, an image by its metadata, or an entry's own YAML."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from msgspec import Struct, field

from calibrary import parsers
from calibrary.calibration import Calibration, CameraKey, Grade, Provenance
from calibrary.errors import InputError
from calibrary.evidence.identity import firmware
from calibrary.jobs.exchange.argument import entry_file
from calibrary.jobs.exchange.reading import Reading, choose
from calibrary.known_camera import hash_serial, is_serial_hash
from calibrary.parsers.imagery import read_metadata
from calibrary.parsers.plausible import refuse_implausible
from calibrary.records import replace
from calibrary.registry.entry import UNSTATED, Entry, Validity
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.firmware import FirmwareRange
from calibrary.registry.git.writing import Written
from calibrary.registry.proposals import Proposals
from calibrary.registry.registry import Registry

__all__ = ["AddRequest", "Stated", "propose_file", "save_file"]

OPTIONAL_TEXTS: Final = ("sub_camera", "lens", "capture_mode", "firmware")
OF_THE_MODEL: Final = {Grade.DESIGN, Grade.DERIVED}
SERIAL_IN_NAME: Final = re.compile(r"(?i)\b(SN|serial)(?:[-_ ][0-9A-Z]*\d{3}|\d{4})[0-9A-Z]*")
"""ZED names its files ``SN12345678.conf``, and so do people."""


class Stated(Struct, frozen=True, kw_only=True):
    """What the user states of a calibration's making; None leaves it to the source.

    Attributes:
        date: when it was made, 2019-03-05.
        tool: which program made it.
        operator: who made it.
    """

    date: str | None = None
    tool: str | None = None
    operator: str | None = None

    def of(self, made: Provenance) -> Provenance:
        """The provenance with what is stated instead of what the source says."""
        names = ("date", "tool", "operator")
        stated = {name: value for name in names if (value := getattr(self, name)) is not None}
        return replace(made, **stated) if stated else made

    def warnings(self, made: Provenance) -> Iterator[str]:
        """Where the source says something else."""
        for name in ("date", "tool", "operator"):
            said, found = getattr(self, name), getattr(made, name)
            if said is not None and found is not None and said != found:
                yield f"the source states the {name} {found!r:.80}, and --{name} replaces it"


class AddRequest(Struct, frozen=True, kw_only=True):
    """What the user states of the entries that are added.

    Attributes:
        key: replaces what the file states of the camera with what the user states.
        stated: of the calibration's making.
        firmware: the firmware range of the entry.
        notes: added to the file's own.
        reason: for the history, and for the approval.
        approve: whether the entries are approved at once.
        override_held: whether it may replace an entry that is held.
        force: why to take a K that contradicts what is known of its camera.
        branch: on which they are proposed; None for the one that is checked out.
        validity: the days that images may be of for them; None leaves what an entry's file states.
        label: what the keeper calls the unit; None leaves what it is called.
        tags: added to those of the entry.
    """

    key: Callable[[CameraKey], CameraKey] = lambda known: known
    stated: Stated = field(default_factory=Stated)
    firmware: FirmwareRange | None = None
    notes: tuple[str, ...] = ()
    reason: str | None = None
    approve: bool = False
    override_held: bool = False
    force: str | None = None
    branch: str | None = None
    validity: Validity | None = None
    label: str | None = None
    tags: tuple[str, ...] = ()


def propose_file(registry: Registry, path: Path, reading: Reading, request: AddRequest) -> Proposals:
    """The entries that a file would become, beside the current ones and checked; nothing is written.

    Args:
        registry: to add to.
        path: a calibration file of any format, an image, or an entry's YAML, with or without a digest.
        reading: answers to what the file leaves open, and which camera of several.
        request: what the user said besides.

    Raises:
        InputError: it cannot be read, its camera is not known, K is a guess, or that of no camera.
        RegistryError: the current entry is held and ``override_held`` is false.
    """
    if not path.exists():
        raise InputError("no such file", source=str(path))
    if not path.is_file():
        raise InputError("is not a regular file, expected one calibration file or image", source=str(path))
    data = entry_file(path) if reading.format is None else None
    if data is not None:
        found = [_from_entry(parse_entry(data, path.name, require_digest=False), request)]
    else:
        source = _Source.of(path)
        calibrations = reading.read(path)
        if reading.camera is not None:
            calibrations = [choose(calibrations, reading.camera, source=path.name)]
        if not request.force:
            refuse_implausible(calibrations, path.name)
        found = [_from_calibration(one, source, request) for one in calibrations]
    _refuse_same_path([entry for entry, _ in found], path.name)
    proposals = registry.propose(
        [entry for entry, _ in found],
        approve=request.approve,
        reason=request.reason,
        override_held=request.override_held,
        force=request.force,
        branch=request.branch,
        edited=data is not None and b"\ndigest:" not in data,
    )
    items = [
        replace(one, warnings=(*warnings, *one.warnings)) if warnings else one
        for one, (_, warnings) in zip(proposals.items, found, strict=True)
    ]
    return replace(proposals, items=tuple(items))


def save_file(
    registry: Registry,
    proposals: Proposals,
    path: Path,
    *,
    reason: str | None = None,
    branch: str | None = None,
) -> Written:
    """Write what a file became as one commit.

    Where the file is the entry in the registry's work tree, edited by hand, the commit takes its place.

    Raises:
        FileConflictError: an entry was changed since it was shown; nothing was written.
        RegistryError: a check failed, or it cannot be written.
    """
    with _restore_on_failure(registry, path, proposals):
        return registry.save(proposals, reason=reason, branch=branch)


class _Source(Struct, frozen=True, kw_only=True):
    """A file that calibrations are read from."""

    name: str
    sha256: str
    is_image: bool
    software: str | None

    @classmethod
    def of(cls, path: Path) -> _Source:
        with path.open("rb") as file:
            sha256 = hashlib.file_digest(file, "sha256").hexdigest()
        image = parsers.is_image_file(path)
        software = firmware(read_metadata(path)) if image else None
        return cls(name=path.name, sha256=sha256, is_image=image, software=software)


def _from_calibration(
    calibration: Calibration, source: _Source, request: AddRequest
) -> tuple[Entry, tuple[str, ...]]:
    """An entry from another program's calibration; what only that program needs is not imported.

    A file's extras may hold anything: serial numbers, names of people and folders. None of them is imported.
    """
    warnings = []
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
    camera = _said(request.key(camera))
    _require_key(camera, source.name)
    if camera.sub_camera and camera.sub_camera == calibration.camera.sub_camera and not source.is_image:
        warnings.append(
            f"the file states the sub-camera {camera.sub_camera!r:.80}, which becomes part of the key; where images do "
            "not state it, or it contains a serial number, set --sub-camera NAME, or --sub-camera '' for none"
        )
    made = calibration.provenance
    warnings += request.stated.warnings(made)
    named = replace(
        made,
        source=SERIAL_IN_NAME.sub(r"\1…", made.source or source.name),
        sha256=made.sha256 or source.sha256,
        firmware=camera.firmware or made.firmware,
        **{
            name: getattr(request.stated, name) or getattr(made, name)
            for name in ("date", "tool", "operator")
        },
    )
    size = calibration.intrinsics.image_size
    try:
        return Entry(
            calibration=replace(
                calibration,
                camera=replace(camera, firmware=None, image_size=size),
                provenance=named,
                notes=_notes(calibration, request),
                extras=(),
            ),
            firmware=request.firmware,
            validity=request.validity,
            label=request.label,
            tags=request.tags,
        ), tuple(warnings)
    except InputError as error:
        raise type(error)(error.message, source=source.name, place=error.place) from None


def _from_entry(entry: Entry, request: AddRequest) -> tuple[Entry, tuple[str, ...]]:
    """An entry's own file, perhaps edited by hand."""
    camera = _said(request.key(entry.calibration.camera))
    if camera.serial is not None and not is_serial_hash(camera.serial):
        camera = replace(camera, serial=hash_serial(camera.make, camera.serial))
    made = entry.calibration.provenance
    warnings = tuple(request.stated.warnings(made))
    if made == UNSTATED:
        made = replace(made, kind="by-hand")
    made = request.stated.of(made)
    if camera.firmware is not None:
        made = replace(made, firmware=camera.firmware)
    calibration = replace(
        entry.calibration,
        camera=replace(camera, firmware=None),
        provenance=made,
        notes=_notes(entry.calibration, request),
    )
    firmware, validity = request.firmware or entry.firmware, request.validity or entry.validity
    named = replace(entry, label=request.label or entry.label, tags=(*entry.tags, *request.tags))
    return replace(named, calibration=calibration, firmware=firmware, validity=validity), warnings


def _notes(calibration: Calibration, request: AddRequest) -> tuple[str, ...]:
    return tuple(dict.fromkeys([*calibration.notes, *request.notes]))


def _said(camera: CameraKey) -> CameraKey:
    """The key without the fields that the user emptied."""
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


@contextmanager
def _restore_on_failure(registry: Registry, source: Path, proposals: Proposals) -> Iterator[None]:
    """Replace an edited entry by the current one while the commit is written, and restore the edit if that fails."""
    repo, here = registry.repo, source.resolve()
    own = {path for one in proposals.due for path in (one.path, one.entry.path)}
    path = next((path for path in own if here == repo.path / path), None)
    tip = repo.tip()
    if path is None or repo.work_tree is None or tip is None:
        yield
        return
    # If the process is killed meanwhile, the edit is in git's own folder.
    edited, kept = source.read_bytes(), repo.git_dir / "calibrary-edited.yaml"
    kept.unlink(missing_ok=True)
    with kept.open("xb") as file:
        file.write(edited)
    committed = repo.read(tip, path)
    if committed is not None:
        source.write_bytes(committed.data)
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
