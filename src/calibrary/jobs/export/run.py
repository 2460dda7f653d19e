"""Export of a whole registry for other programs: one file, a file for each entry, a table, or one YAML.

Calibration formats are written by their own writers and read back for verification: entries that a format
cannot represent are omitted and reported, and so is how exactly it represents the others.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Callable, Collection, Sequence
from functools import partial
from pathlib import Path
from typing import Annotated, Final, TypeAlias

from calibrary import parsers
from calibrary.atomic import check_folder, write_files
from calibrary.calibration import Calibration
from calibrary.errors import InputError, RegistryError, UnsupportedModelError
from calibrary.jobs.export.opensfm_names import odm_entry_names
from calibrary.parsers.format import Fidelity, Fit, Format, WriteVerdict, in_words
from calibrary.parsers.writing import check_limit, format_to_write
from calibrary.records import Json, Meta, Record, encoded, replace
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.git.objects import ObjectId
from calibrary.registry.paths import id_of
from calibrary.registry.snapshot import Snapshot, StoredEntry
from calibrary.registry.spreadsheet import csv_text

ODM: Final = "odm_cameras"
ROS: Final = "ros_camera_info"

Encode: TypeAlias = Callable[..., tuple[bytes, WriteVerdict]]
""":func:`calibrary.parsers.encode` in the format, on the caller's terms."""

TABLES: Final = ("csv", "yaml")

COLUMNS: Final = (
    "id",
    "status",
    "grade",
    "make",
    "model",
    "sub_camera",
    "lens",
    "focal_mm",
    "capture_mode",
    "width_px",
    "height_px",
    "serial_hash",
    "firmware_min",
    "firmware_max",
    "fx",
    "fy",
    "cx",
    "cy",
    "skew",
    "pixel_origin",
    "distortion",
    "coefficients",
    "rms_px",
    "source",
    "sha256",
    "date",
)


class Exported(Record):
    """An exported entry.

    Attributes:
        entry: id of the entry.
        file: file name, relative to the folder if there are several files.
        verdict: how exactly the file represents the entry; a table contains the numbers themselves.
        rms_px, max_px: distance between the projections of the same rays.
        radius_px: distance from the principal point up to which it was measured; None for the whole image.
        lost_px: how far the distortion that the file lacks moves pixels, at most.
    """

    entry: str
    file: str
    verdict: Fidelity = Fidelity.EXACT
    rms_px: Annotated[float, Meta(ge=0)] = 0.0
    max_px: Annotated[float, Meta(ge=0)] = 0.0
    radius_px: Annotated[float, Meta(ge=0)] | None = None
    lost_px: Annotated[float, Meta(ge=0)] = 0.0

    def __str__(self) -> str:
        return in_words(self.verdict, self.rms_px, self.max_px, self.radius_px, (), self.lost_px)


class NotExported(Record):
    """An entry that was not exported.

    Attributes:
        entry: id of the entry.
        reason: why it was not exported.
    """

    entry: str
    reason: str


class ExportReport(Record, tag_field="schema", tag="calibrary/registry-export-1"):
    """Output of ``calibrary registry export --json``.

    Attributes:
        commit: of the registry; None for a plain folder.
        format: name of the format.
        written: the exported entries.
        left_out: entries that the format cannot represent, or not together with the others.
        dropped: data that the format cannot represent, in words.
    """

    commit: ObjectId | None = None
    format: str
    written: tuple[Exported, ...]
    left_out: tuple[NotExported, ...] = ()
    dropped: tuple[str, ...] = ()


def export(
    snapshot: Snapshot,
    form: str | None,
    out: Path,
    *,
    statuses: Collection[str],
    max_error_px: float | None = None,
    drop_distortion: bool = False,
) -> ExportReport:
    """Write the entries of a registry in a format; for arguments and errors see :meth:`calibrary.Fleet.export`."""
    form = form or ("csv" if out.suffix == ".csv" else None)
    record = check_target(form, out, max_error_px=max_error_px)
    unread: dict[str, InputError] = {}
    every = [*snapshot.entries(unread.__setitem__), *(snapshot.proposals() if "draft" in statuses else ())]
    stored = [one for one in every if one.entry.status.value in statuses]
    if not stored and unread:
        raise RegistryError(str(next(iter(unread.values()))))
    if not stored:
        waiting = snapshot.all_proposed() or "'calibrary registry list' shows what there is"
        raise InputError(f"no entry to export; {waiting}")
    if record is None:
        write_files({out: _csv(stored) if form == "csv" else _yaml(stored)})
        written = tuple(Exported(entry=one.id, file=out.name) for one in stored)
        done = ExportReport(format=str(form), written=written)
    else:
        encode = partial(
            parsers.encode, format=record, max_error_px=max_error_px, drop_distortion=drop_distortion
        )
        done = (_one_file if _is_one_file(record, out) else _folder)(stored, record, out, encode)
    left_out = (
        *done.left_out,
        *(NotExported(entry=id_of(path), reason=str(why)) for path, why in unread.items()),
    )
    return replace(done, commit=snapshot.commit, left_out=left_out)


def check_target(form: str | None, out: Path, *, max_error_px: float | None) -> Format | None:
    """Check before the entries are read that the output can be written; returns the format, None for a table.

    Raises:
        InputError: ``out`` is of another kind or not writable, or the limit is invalid.
        UnknownFormatError: the format is unknown.
        UnsupportedModelError: the format cannot be written.
    """
    if max_error_px is not None:
        check_limit(max_error_px)
    record = None if form in TABLES else format_to_write(form, out)
    if record is None and out.is_dir():
        raise InputError("is a folder, expected the name of a file", source=str(out))
    if record is None or _is_one_file(record, out):
        check_folder(out)
    elif out.is_file():
        raise InputError("is a file, expected a folder for a file of each entry", source=str(out))
    else:
        check_folder(out / "entry")
    return record


def _is_one_file(record: Format, out: Path) -> bool:
    several = record.capacity is not None and record.capacity.several_cameras
    return several and bool(out.suffix) and not out.is_dir()


def _exported(entry_id: str, file: str, fit: Fit) -> Exported:
    return Exported(
        entry=entry_id,
        file=file,
        verdict=fit.outcome,
        rms_px=fit.rms_px,
        max_px=fit.max_px,
        radius_px=fit.compared_px,
        lost_px=fit.lost_px,
    )


def _one_file(stored: Sequence[StoredEntry], record: Format, out: Path, encode: Encode) -> ExportReport:
    """Export to one file; of entries with the same name in the format, the least specific one is written."""
    left = _namesakes(stored, record, out, encode)
    stored = [one for one in stored if one.id not in left]
    try:
        data, verdict = _encoded(stored, out, encode)
    except UnsupportedModelError:
        # One unsuitable entry prevents the whole file, so find out which.
        left |= _refused(stored, out, encode)
        stored = [one for one in stored if one.id not in left]
        if not stored:
            raise UnsupportedModelError(
                f"{record.name} holds none of the {len(left)} entries: {next(iter(left.values()))}"
            ) from None
        data, verdict = _encoded(stored, out, encode)
    write_files({out: _as_odm_names_them(stored, data) if record.name == ODM else data})
    return ExportReport(
        format=record.name,
        written=tuple(
            _exported(one.id, out.name, fit) for one, fit in zip(stored, verdict.fits, strict=True)
        ),
        left_out=tuple(NotExported(entry=name, reason=reason) for name, reason in sorted(left.items())),
        dropped=verdict.dropped,
    )


def _encoded(stored: Sequence[StoredEntry], out: Path, encode: Encode) -> tuple[bytes, WriteVerdict]:
    calibrations = [one.entry.calibration for one in stored]
    return encode(calibrations, name=out.name)


def _refused(stored: Sequence[StoredEntry], out: Path, encode: Encode) -> dict[str, str]:
    """The entries that the format cannot represent, with the reason."""
    left = {}
    for one in stored:
        try:
            _encoded([one], out, encode)
        except InputError as error:
            left[one.id] = error.message
    return left


def _namesakes(stored: Sequence[StoredEntry], record: Format, out: Path, encode: Encode) -> dict[str, str]:
    """Entries with the same name in the file as an earlier one: a program would never find the second."""
    models: dict[tuple[object, ...], list[StoredEntry]] = {}
    for one in stored:
        camera = one.entry.calibration.camera
        models.setdefault((camera.make, camera.model, camera.image_size), []).append(one)
    left: dict[str, str] = {}
    for alike in models.values():
        names: dict[str, str] = {}
        for one in sorted(alike, key=_by_specificity) if len(alike) > 1 else ():
            try:
                data = _encoded([one], out, encode)[0]
            except InputError:
                continue
            own = odm_entry_names(one.entry.calibration) if record.name == ODM else _name_in(data)
            taken = next((name for name in sorted(own) if name in names), None)
            if taken is not None:
                left[one.id] = f"{record.name} calls it {taken!r}, as it does {names[taken]}"
            else:
                names |= dict.fromkeys(own, one.id)
    return left


def _as_odm_names_them(stored: Sequence[StoredEntry], data: bytes) -> bytes:
    """``cameras.json`` with each camera under every name that ODM may derive from its images."""
    cameras: list[Json] = [*json.loads(data).values()]
    return encoded(
        {
            name: camera
            for one, camera in zip(stored, cameras, strict=True)
            for name in sorted(odm_entry_names(one.entry.calibration))
        }
    )


def _by_specificity(one: StoredEntry) -> tuple[bool | str, ...]:
    camera = one.entry.calibration.camera
    said = (camera.serial, one.entry.firmware, camera.capture_mode, camera.lens, camera.focal_mm)
    return (*(value is not None for value in said), one.path)


def _name_in(data: bytes) -> set[str]:
    """Names of the cameras in a file, if the format identifies cameras by name."""
    try:
        document = json.loads(data)
    except ValueError:
        return set()
    return set(document) if isinstance(document, dict) and len(document) == 1 else set()


def _folder(stored: Sequence[StoredEntry], record: Format, out: Path, encode: Encode) -> ExportReport:
    """Export to a file for each entry, named after the entry; for ROS after the camera."""
    files: dict[Path, bytes] = {}
    written, left, dropped = [], [], dict[str, None]()
    names = _ros_names(stored) if record.name == ROS else {}
    for one in stored:
        called = names.get(one.id, one.id.replace("/", "__"))
        name = f"{called}{record.suffixes[0]}"
        calibration = _with_ros_name(one.entry.calibration, called) if names else one.entry.calibration
        if out / name in files:
            left.append(NotExported(entry=one.id, reason=f"another entry is {name} already"))
            continue
        try:
            data, verdict = encode([calibration], name=name)
        except InputError as error:
            left.append(NotExported(entry=one.id, reason=error.message))
            continue
        files[out / name] = data
        dropped |= dict.fromkeys(verdict.dropped)
        written.append(_exported(one.id, name, verdict.fits[0]))
    if not files:
        raise UnsupportedModelError(f"{record.name} holds none of the {len(left)} entries: {left[0].reason}")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"cannot be created: {error.strerror}", source=str(out)) from None
    write_files(files)
    return ExportReport(
        format=record.name, written=tuple(written), left_out=tuple(left), dropped=tuple(dropped)
    )


def _ros_names(stored: Sequence[StoredEntry]) -> dict[str, str]:
    """Camera names by entry id: the label of a unit with a single entry, else the id.

    The driver's name of a camera determines which calibration file is loaded: ``camera_info_manager`` inserts it into
    the URL (``file:///fleet/${NAME}.yaml``, ``resolveURL``), accepts only letters, digits and underscores
    (``setCameraName``), and warns if the file states another (``loadCalibrationFile``).
    """
    labels = Counter(one.entry.label for one in stored)
    named = {one.id: one.entry.label if labels[one.entry.label] == 1 else None for one in stored}
    return {key: _plain(label or "") or _plain(key) for key, label in named.items()}


def _with_ros_name(calibration: Calibration, name: str) -> Calibration:
    """The calibration with an extra that makes its ROS file state the name."""
    key = f"{ROS}/camera_name"
    others = (one for one in calibration.extras if one[0] != key)
    return replace(calibration, extras=(*others, (key, json.dumps(name))))


def _plain(text: str) -> str:
    return re.sub(r"[^0-9A-Za-z]+", "_", text).strip("_")


def _csv(stored: Sequence[StoredEntry]) -> bytes:
    rows = (_row(one) for one in stored)
    return csv_text(COLUMNS, ([row[name] for name in COLUMNS] for row in rows)).encode()


def _row(one: StoredEntry) -> dict[str, str | float | None]:
    entry, calibration = one.entry, one.entry.calibration
    camera, K, lens, made = (
        calibration.camera,
        calibration.intrinsics,
        calibration.distortion,
        calibration.provenance,
    )
    return {
        "id": one.id,
        "status": entry.status.value,
        "grade": calibration.grade.value,
        "make": camera.make,
        "model": camera.model,
        "sub_camera": camera.sub_camera,
        "lens": camera.lens,
        "focal_mm": camera.focal_mm,
        "capture_mode": camera.capture_mode,
        "width_px": K.image_size[0],
        "height_px": K.image_size[1],
        "serial_hash": camera.serial,
        "firmware_min": entry.firmware.min if entry.firmware is not None else None,
        "firmware_max": entry.firmware.max if entry.firmware is not None else None,
        "fx": K.fx,
        "fy": K.fy,
        "cx": K.cx,
        "cy": K.cy,
        "skew": K.skew,
        "pixel_origin": "corner",
        "distortion": lens.model if lens is not None else "unknown",
        "coefficients": " ".join(f"{name}={value!r}" for name, value in lens.coefficients.items())
        if lens
        else "",
        "rms_px": calibration.quality.rms_px if calibration.quality is not None else None,
        "source": made.source or made.kind,
        "sha256": made.sha256,
        "date": made.date,
    }


def _yaml(stored: Sequence[StoredEntry]) -> bytes:
    """The entry files as the documents of one YAML stream."""
    parts = [b"---\n# " + one.path.encode() + b"\n" + entry_yaml(one.entry) for one in stored]
    return b"".join(parts)
