"""An entry in a form for other registries: generalised to its model, with the evidence, and without private data.

Only the fields named here are written, so that a field added to entries later stays private by default. The K of one
unit is evidence for its model, not a calibration of it: its grade becomes ``derived``, and the measured values go into
``x-evidence``, so that they are not taken for the uncertainty of other units.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from calibrary.atomic import write_files
from calibrary.calibration import Calibration, CameraKey, Grade, Provenance, Quality
from calibrary.errors import RegistryError
from calibrary.provenance import ABOUT, HOW_MADE, SourceFile, label
from calibrary.records import Record, replace
from calibrary.registry.entry import UNSTATED, USUAL_TOLERANCE, Entry, Status, digest
from calibrary.registry.entry_yaml import entry_yaml
from calibrary.registry.paths import folder_of, proposal_path
from calibrary.registry.snapshot import Snapshot, StoredEntry

EVIDENCE: Final = "x-evidence"
MEASURED: Final = frozenset({Grade.CALIBRATED, Grade.ADJUSTED})
SUFFIX: Final = re.compile(r"[.][a-z0-9]{1,8}")
OF_ONE_UNIT: Final = (
    "K and distortion were measured on one unit, as x-evidence says; of another unit of this model they are an "
    "estimate"
)


class Contribution(Record, tag_field="schema", tag="calibrary/registry-contribution-1"):
    """Output of ``calibrary registry export KEY --public --json``.

    Attributes:
        entry: id of the entry in this registry.
        file: written file.
        path: path of the file in the target registry.
        digest: digest of its numbers.
        grade: its grade; for the K of one unit at most derived.
        left_out: fields of the entry that are not in the file.
    """

    entry: str
    file: str
    path: str
    digest: str
    grade: Grade
    left_out: tuple[str, ...]


def contribute(snapshot: Snapshot, key: str, out: Path) -> Contribution:
    """Write an entry as a proposal for another registry.

    Args:
        snapshot: state of the registry.
        key: key of the entry, without a revision.
        out: output folder: a clone of the other registry, or any other folder.

    Raises:
        RegistryError: the entry does not exist, is not approved, or cannot be generalised to its model.
        InputError: the file cannot be written.
    """
    stored = snapshot.get(key)
    entry = general_entry(stored, snapshot)
    path = proposal_path(entry.path)
    write_files({out / path: entry_yaml(entry)})
    return Contribution(
        entry=stored.id,
        file=str(out / path),
        path=path,
        digest=digest(entry.calibration, entry.sensor),
        grade=entry.calibration.grade,
        left_out=tuple(_left_out(stored.entry)),
    )


def general_entry(stored: StoredEntry, snapshot: Snapshot) -> Entry:
    """Return an entry for the model, as a draft, from an entry that may be of one unit.

    Raises:
        RegistryError: the entry is not approved, or cannot be generalised to its model.
    """
    entry = stored.entry
    calibration, made = entry.calibration, entry.calibration.provenance
    if (reason := _reason_against(stored, snapshot)) is not None:
        raise RegistryError(f"{stored.id}: {reason}")
    camera = calibration.camera
    is_of_one_unit = calibration.grade in MEASURED
    general = Calibration(
        camera=CameraKey(
            make=camera.make,
            model=camera.model,
            sub_camera=camera.sub_camera,
            lens=camera.lens,
            focal_mm=camera.focal_mm,
            capture_mode=camera.capture_mode,
            image_size=camera.image_size,
        ),
        intrinsics=calibration.intrinsics,
        distortion=calibration.distortion,
        grade=Grade.DERIVED if is_of_one_unit else calibration.grade,
        quality=None if is_of_one_unit else calibration.quality,
        provenance=_without_names(made),
        notes=(OF_ONE_UNIT,) if is_of_one_unit else (),
    )
    return Entry(
        calibration=general,
        status=Status.DRAFT,
        firmware=entry.firmware,
        aliases=entry.aliases,
        sensor=entry.sensor,
        tolerance=max(entry.tolerance or 0.0, USUAL_TOLERANCE) if is_of_one_unit else entry.tolerance,
        extensions={EVIDENCE: _evidence(calibration)} if is_of_one_unit else {},
    )


def _reason_against(stored: StoredEntry, snapshot: Snapshot) -> str | None:
    """Return why an entry cannot be contributed; None if it can."""
    entry = stored.entry
    made = entry.calibration.provenance
    if not entry.is_usable:
        return f"is {entry.status.value}; only an approved or held entry is contributed"
    if entry.override is not None:
        return (
            "contradicts what is known of its camera, which was overridden here; others cannot rely on that: "
            f"{entry.override}"
        )
    if made == UNSTATED or made.kind == "manual":
        return "rests on what a person stated and on no source that others could check"
    if entry.calibration.grade in MEASURED:
        for other in _units(stored, snapshot):
            off = other.entry.calibration.intrinsics.fx / entry.calibration.intrinsics.fx - 1.0
            if abs(off) > USUAL_TOLERANCE:
                return (
                    f"is of one unit, and {other.id} of another has an fx {off:+.1%} off: no unit's K is that of the "
                    "model"
                )
    return None


def _units(stored: StoredEntry, snapshot: Snapshot) -> Iterator[StoredEntry]:
    """Yield the other usable entries that differ from this one only in the unit."""
    camera = stored.entry.calibration.camera
    folder = folder_of(camera.make or "", camera.model or "")
    for path in sorted(path for path in snapshot.paths if path.startswith(folder) and path != stored.path):
        other = snapshot.at(path)
        if other is None or not other.entry.is_usable:
            continue
        if replace(other.entry.calibration.camera, serial=camera.serial) == camera:
            yield other


def _without_names(made: Provenance) -> Provenance:
    """Return what is public of the provenance, and its files by their digests instead of their names."""
    source = f"source{_suffix(made.source)}" if made.source is not None else None
    if made.sha256 is not None:
        source = f"sha256-{made.sha256[:12]}{_suffix(made.source)}"
    return Provenance(
        **{name: getattr(made, name) for name, one in ABOUT.items() if one.public},
        source=source,
        sources=tuple(
            SourceFile(name=f"frame-{at}{_suffix(one.name)}", sha256=one.sha256)
            for at, one in enumerate(made.sources, start=1)
        ),
    )


def _suffix(name: str | None) -> str:
    suffix = Path(name or "").suffix.lower()
    return suffix if SUFFIX.fullmatch(suffix) else ""


def _evidence(calibration: Calibration) -> dict[str, Any]:
    """Return the values measured on the one unit."""
    quality = calibration.quality or Quality()
    stated: dict[str, Any] = {
        "grade": calibration.grade.value,
        "units": 1,
        "rms_px": quality.rms_px,
        "views": quality.views,
        "points": quality.points,
        "coverage": quality.coverage,
        "kappa2": quality.kappa2,
        "std": dict(quality.std) or (quality.covariance.std if quality.covariance is not None else {}),
    }
    return {name: value for name, value in stated.items() if value not in (None, {})}


def _left_out(entry: Entry) -> Iterator[str]:
    """Yield the names of the fields that are not contributed."""
    made = entry.calibration.provenance
    stated = {
        "serial": entry.calibration.camera.serial,
        **{label(name): getattr(made, name) for name in HOW_MADE if not ABOUT[name].public},
        "file names": made.source or made.sources,
        "notes": entry.notes,
        "reason": entry.reason,
        "validity": entry.validity,
        "supersedes": entry.supersedes,
        "label": entry.label,
        "tags": entry.tags,
    }
    yield from (name for name, value in stated.items() if value)
    yield from sorted(entry.extensions)
