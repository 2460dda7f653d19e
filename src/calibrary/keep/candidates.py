"""What a file would be as entries: a calibration of any format, an image by its metadata, or an entry's own YAML."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from calibrary import parsers
from calibrary.calibration import Calibration, CameraKey, Grade
from calibrary.errors import InputError, MissingTagError
from calibrary.keep.operand import Reading, entry_file
from calibrary.parsers.image_names import is_image
from calibrary.parsers.imagery import hash_serial, read_metadata
from calibrary.parsers.imagery.identity import SERIAL_HASH_DIGITS
from calibrary.records import replace
from calibrary.registry.entry import Entry
from calibrary.registry.entry_yaml import parse_entry
from calibrary.registry.firmware import FirmwareRange

__all__ = ["Candidate", "Wish", "candidates"]

OPTIONAL_TEXTS: Final = ("sub_camera", "lens", "capture_mode", "firmware")
OF_THE_MODEL: Final = {Grade.DESIGN, Grade.DERIVED}
HEX: Final = frozenset("0123456789abcdef")
SERIAL_IN_NAME: Final = re.compile(r"(?i)\b(SN|serial)(?:[-_ ][0-9A-Z]*\d{3}|\d{4})[0-9A-Z]*")
"""ZED names its files ``SN12345678.conf``, and so do people."""


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
class Candidate:
    """One camera of a file.

    Attributes:
        entry: as the file and the user say it.
        edited: whether it is an entry's file without a digest, which a person has changed.
        remarks: what is to be said of the reading.
    """

    entry: Entry
    edited: bool = False
    remarks: tuple[str, ...] = ()


def candidates(path: Path, reading: Reading, wish: Wish) -> Iterator[Candidate]:
    """Each camera of a file that was asked for, in its order.

    Raises:
        InputError: it cannot be read, its camera is not known, or K is a guess.
    """
    for found in _read(path, reading, wish):
        entry = found.entry
        calibration = replace(entry.calibration, notes=tuple(dict.fromkeys([*entry.notes, *wish.notes])))
        firmware = wish.firmware or entry.firmware
        yield replace(found, entry=replace(entry, calibration=calibration, firmware=firmware))


def _read(path: Path, reading: Reading, wish: Wish) -> Iterator[Candidate]:
    if not path.exists():
        raise InputError("no such file", source=str(path))
    if not path.is_file():
        raise InputError("is no regular file, wanted one calibration file or image", source=str(path))
    if reading.format is None and (data := entry_file(path)) is not None:
        entry = parse_entry(data, path.name, require_digest=False)
        yield Candidate(entry=_with_key(entry, wish), edited=b"\ndigest:" not in data)
        return
    try:
        calibrations = parsers.read(
            path, format=reading.format, image_size=reading.image_size, options=reading.options
        )
    except MissingTagError as error:
        wants_size = reading.image_size is None and not is_image(path) and "size" in error.message
        if wants_size and "--image-size" not in error.message:
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


def _from_file(calibration: Calibration, path: Path, wish: Wish) -> Candidate:
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
    source = SERIAL_IN_NAME.sub(r"\1…", provenance.source or path.name)
    provenance = replace(provenance, source=source, sha256=sha256)
    camera = _said(wish.key(camera))
    _require_key(camera, path.name)
    if camera.sub_camera and camera.sub_camera == calibration.camera.sub_camera and not is_image(path):
        remarks.append(
            f"the file calls it {camera.sub_camera!r:.80}, a part of its key from now on; where images do not say so, "
            "or a serial number is in it, say --sub-camera NAME, or --sub-camera '' for none"
        )
    provenance = replace(provenance, firmware=camera.firmware or provenance.firmware)
    whole = replace(calibration, camera=replace(camera, firmware=None), provenance=provenance, extras=())
    try:
        return Candidate(entry=Entry.of(whole), remarks=tuple(remarks))
    except InputError as error:
        raise type(error)(error.message, source=path.name, place=error.place) from None


def _with_key(entry: Entry, wish: Wish) -> Entry:
    camera = _said(wish.key(entry.calibration.camera))
    if camera.serial is not None and not _is_hash(camera.serial):
        camera = replace(camera, serial=hash_serial(camera.make, camera.serial))
    provenance = entry.calibration.provenance
    if camera.firmware is not None:
        provenance = replace(provenance, firmware=camera.firmware)
    calibration = replace(entry.calibration, camera=replace(camera, firmware=None), provenance=provenance)
    return replace(entry, calibration=calibration)


def _said(camera: CameraKey) -> CameraKey:
    """The same, where an empty text takes out what a file says and no image will."""
    empty = {name: None for name in OPTIONAL_TEXTS if getattr(camera, name) == ""}
    return replace(camera, **empty)


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
