"""An entry as flat fields, and two entries field by field: what a person reviews, line by line."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

from calibrary.records import Json, to_json
from calibrary.registry.entry import Entry

__all__ = ["K_NAMES", "Field", "FieldChange", "change_json", "differences", "entry_fields", "std_of"]

Field: TypeAlias = str | int | float | bool | None

K_NAMES: Final = ("fx", "fy", "cx", "cy", "skew")


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldChange:
    """One field that two entries say differently.

    Attributes:
        name: dotted, as the file nests it: "intrinsics.fx".
        before, after: None where an entry does not say it.
        delta: after less before, of numbers that mean the same in both.
        z: delta in standard deviations of the difference, where both entries state theirs.
    """

    name: str
    before: Field
    after: Field
    delta: float | None = None
    z: float | None = None


def entry_fields(entry: Entry) -> dict[str, Field]:
    """Everything that an entry says, in the order of its file; what it does not say is left out."""
    whole = to_json(entry.calibration)
    calibration = {name: whole[name] for name in ("camera", "intrinsics", "distortion")}
    firmware, sensor, validity = entry.firmware, entry.sensor, entry.validity
    fields: dict[str, Json] = {
        "status": entry.status.value,
        "reason": entry.reason,
        **calibration,
        "firmware": {"min": firmware.min, "max": firmware.max} if firmware is not None else None,
        "sensor": {name: getattr(sensor, name) for name in ("width_mm", "height_mm", "pitch_um")}
        if sensor is not None
        else None,
        "grade": whole["grade"],
        "quality": _without_matrix(whole["quality"]),
        "provenance": whole["provenance"],
        "validity": str(validity) if validity is not None else None,
        "tolerance": entry.tolerance,
        "aliases": [f"{alias.make} {alias.model}" for alias in entry.aliases],
        "supersedes": entry.supersedes,
        "notes": whole["notes"],
        "extras": dict(entry.calibration.extras),
    }
    flat = dict(_flat("", fields))
    # Both are said elsewhere: the origin is the same everywhere, and K's frame is the camera's.
    for name in ("intrinsics.pixel_origin", "intrinsics.image_size"):
        flat.pop(name, None)
    if entry.calibration.distortion is None:
        flat["distortion"] = "unknown"
    return flat | {name: _text(value) for name, value in entry.extensions.items()}


def differences(before: Entry | None, after: Entry) -> tuple[FieldChange, ...]:
    """What one entry says otherwise than another, in the order of the file; everything where there is no other."""
    old, new = entry_fields(before) if before is not None else {}, entry_fields(after)
    return tuple(
        _change(name, old.get(name), new.get(name), before, after)
        for name in _in_order([*old], [*new])
        if not _same(old.get(name), new.get(name))
    )


def change_json(change: FieldChange) -> dict[str, Json]:
    """The JSON form of one change."""
    return {
        "field": change.name,
        "before": change.before,
        "after": change.after,
        "delta": change.delta,
        "z": change.z,
    }


def _in_order(old: Sequence[str], new: Sequence[str]) -> list[str]:
    """All names in the order of the new ones, each that is gone behind the one it stood behind."""
    names = [*new]
    for at, name in enumerate(old):
        if name not in names:
            names.insert(names.index(old[at - 1]) + 1 if at else 0, name)
    return names


def _same(one: Field, other: Field) -> bool:
    return type(one) is type(other) and one == other


def _change(name: str, old: Field, new: Field, before: Entry | None, after: Entry) -> FieldChange:
    delta = z = None
    if before is not None and _are_numbers(old, new) and _mean_the_same(name, before, after):
        delta = float(new) - float(old)  # type: ignore[arg-type]  # numbers, as just asked
        stds = [std_of(entry, name.rpartition(".")[2]) for entry in (before, after)]
        block = name.partition(".")[0]
        if block in {"intrinsics", "distortion"} and stds[0] is not None and stds[1] is not None:
            spread = math.hypot(stds[0], stds[1])
            z = delta / spread if spread > 0 else None
    return FieldChange(name=name, before=old, after=new, delta=delta, z=z)


def _are_numbers(*values: Field) -> bool:
    return all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)


def _mean_the_same(name: str, before: Entry, after: Entry) -> bool:
    one, other = before.calibration, after.calibration
    if name.startswith("distortion."):
        return type(one.distortion) is type(other.distortion)
    return not name.startswith("intrinsics.") or one.intrinsics.image_size == other.intrinsics.image_size


def std_of(entry: Entry, name: str) -> float | None:
    """The standard deviation of a parameter: the covariance's, else the one that is stated by itself."""
    quality = entry.calibration.quality
    if quality is None:
        return None
    spread = quality.covariance.std if quality.covariance is not None else {}
    return spread.get(name, quality.std.get(name))


def _without_matrix(quality: Json) -> Json:
    """A covariance by its names and a short digest: 45 numbers tell a reader nothing, their change does."""
    if not isinstance(quality, dict) or not isinstance(covariance := quality["covariance"], dict):
        return quality
    digest = hashlib.sha256(json.dumps(covariance).encode()).hexdigest()[:12]
    names = covariance["names"]
    of = ", ".join(map(str, names)) if isinstance(names, list) else ""
    return {**quality, "covariance": f"of {of} ({digest})"}


def _flat(prefix: str, fields: Mapping[str, Json]) -> Iterator[tuple[str, Field]]:
    for name, value in fields.items():
        if isinstance(value, dict):
            yield from _flat(f"{prefix}{name}.", value)
        elif isinstance(value, list):
            if value:
                yield f"{prefix}{name}", _joined(value)
        elif value is not None:
            yield f"{prefix}{name}", value


def _joined(values: list[Json]) -> str:
    if all(isinstance(value, int) for value in values):
        return "×".join(map(str, values))
    return "; ".join(value if isinstance(value, str) else _text(value) for value in values)


def _text(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, sort_keys=True)
