"""Addition of files to a registry: a calibration of any format, an image with metadata, or an entry's YAML."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from msgspec import Struct, field

from calibrary import parsers
from calibrary.arguments import Reading, Stated
from calibrary.calibration import Calibration, CameraKey, Grade
from calibrary.errors import InputError
from calibrary.evidence.identity import firmware
from calibrary.jobs.files.argument import entry_file
from calibrary.jobs.files.reading import choose, read_file
from calibrary.known_camera import hash_serial, is_serial_hash
from calibrary.parsers.imagery import read_metadata
from calibrary.parsers.plausible import refuse_implausible
from calibrary.records import replace
from calibrary.registry.entry import UNSTATED, Entry, Validity
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.firmware import FirmwareRange
from calibrary.registry.git.writing import Written
from calibrary.registry.proposals import Proposals, propose, save
from calibrary.registry.registry import Registry

__all__ = ["AddRequest", "propose_file", "save_file"]

OPTIONAL_TEXTS: Final = ("sub_camera", "lens", "capture_mode", "firmware")
OF_THE_MODEL: Final = {Grade.DESIGN, Grade.DERIVED}
SERIAL_IN_NAME: Final = re.compile(r"(?i)\b(SN|serial)(?:[-_ ][0-9A-Z]*\d{3}|\d{4})[0-9A-Z]*")
"""Serial number in a file name, such as ZED's ``SN12345678.conf``."""


class AddRequest(Struct, frozen=True, kw_only=True):
    """The user's statements on the entries to add.

    Attributes:
        key: replaces camera fields of the file by those that the user states.
        stated: provenance of the calibration.
        firmware: firmware range of the entry.
        notes: appended to the notes of the file.
        reason: for the history, and for the approval.
        approve: whether to approve the entries at once.
        override_held: whether to allow replacing a held entry.
        force: reason to accept a K that contradicts what is known about its camera.
        branch: branch for the proposal; None for the one that is checked out.
        validity: dates of images that the entry applies to; None keeps the value in the entry's file.
        label: label of the unit; None keeps the present one.
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
    """Make the entries of a file, compare them with the current ones and check them; writes nothing.

    Args:
        registry: to add to.
        path: a calibration file of any format, an image, or an entry's YAML, with or without a digest.
        reading: what the file does not state, and which camera of several to use.
        request: the user's other statements.

    Raises:
        InputError: the file cannot be read, its camera is unknown, or K was not measured or is implausible.
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
        calibrations = read_file(path, reading)
        if reading.camera is not None:
            calibrations = [choose(calibrations, reading.camera, source=path.name)]
        if not request.force:
            refuse_implausible(calibrations, path.name)
        found = [_from_calibration(one, source, request) for one in calibrations]
    _refuse_same_path([entry for entry, _ in found], path.name)
    proposals = propose(
        registry.branch(request.branch),
        [entry for entry, _ in found],
        approve=request.approve,
        reason=request.reason,
        override_held=request.override_held,
        force=request.force,
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
    """Write the proposed entries as one commit.

    If the file is an entry in the registry's work tree that was edited by hand, the commit replaces it.

    Raises:
        FileConflictError: an entry has changed since it was shown; nothing was written.
        RegistryError: a check failed, or the registry cannot be written.
    """
    with _restore_on_failure(registry, path, proposals):
        return save(registry, proposals, reason=reason, branch=branch)


class _Source(Struct, frozen=True, kw_only=True):
    """A file with calibrations."""

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
    """Make an entry from another program's calibration, without data that only that program needs.

    A file's extras may contain serial numbers and names of people or folders, so none of them is imported.
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
        request.stated.of(made),
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
    """Make an entry from an entry's file, which may have been edited by hand."""
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
    # If the process is killed meanwhile, the edit can be found in the .git folder.
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
